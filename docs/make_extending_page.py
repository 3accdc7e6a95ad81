"""Put the files of the example package into `docs/how-to/extending.md`.

    python docs/make_extending_page.py

Run it after a change to `examples/`; `tests/project/test_docs.py` asks for it.
"""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).with_name("how-to") / "extending.md"
ROOT = PAGE.parents[2]
_INCLUDED = re.compile(r"(`(examples/[\w/.-]+)`:\n\n```(?:python|toml)\n).*?(^```$)", re.M | re.S)


def updated(text: str) -> str:
    """Return a page with each file that it shows as the file is now."""

    def renewed(found: re.Match[str]) -> str:
        return found[1] + (ROOT / found[2]).read_text("utf-8") + found[3]

    return _INCLUDED.sub(renewed, text)


if __name__ == "__main__":
    PAGE.write_text(updated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
