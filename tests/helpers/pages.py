"""Pages: their tags and their packed numbers."""

import base64
import zlib
from html.parser import HTMLParser

import numpy as np


def unpacked(text, said):
    """Take numbers apart as `unpack.js` does."""
    raw = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8)
    count, wide = said["count"], said["wide"]
    planes = raw[said["at"] : said["at"] + count * wide].reshape(wide, count)
    changes = np.ascontiguousarray(planes.T).view(f"<u{wide}").reshape(-1, said["row"])
    return said["low"] + said["step"] * np.cumsum(changes, axis=0, dtype=changes.dtype)


def positions(numbers, member, records):
    """Return where a page has the nodes of an arm, and to how much it rounds."""
    root, offset = member["root"], member["offset"]
    apart = unpacked(numbers, offset).reshape(records, member["nodes"], -1)
    at = unpacked(numbers, root)[:, [0, 2] if apart.shape[2] == 2 else slice(None)]
    return at[:, None] + apart, root["step"] + offset["step"]


class Tags(HTMLParser):
    """Tags of a page with their attributes, its tables' rows, and its texts by id or tag."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.inside, self.texts, self.rows = [], [], {}, []
        self.feed(page)

    def attributes(self, name):
        """Return those of all tags of a name."""
        return [attributes for tag, attributes in self.tags if tag == name]

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.inside.append(dict(attrs).get("id") or tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        if self.inside:
            self.inside.pop()

    def handle_data(self, data):
        where = self.inside[-1] if self.inside else ""
        self.texts[where] = self.texts.get(where, "") + data
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data


HOSTILE = "</script><img src=x onerror=alert(1)>&amp;\"'$title ${style}<!--"
