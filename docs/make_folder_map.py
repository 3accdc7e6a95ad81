"""Write the map of folders of CONTRIBUTING.md, and into each folder what it may import.

    python docs/make_folder_map.py

Run it after a change to the layers in `pyproject.toml` or to the first line of a folder's
`__init__.py`: `tests/project/test_docs.py` asks for it.
"""

import ast
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "CONTRIBUTING.md"


def layers() -> list[list[str]]:
    """Return the folders, from the highest layer down."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]
    contract = settings["importlinter"]["contracts"][0]
    return [layer.split(" | ") for layer in contract["layers"]]


def home(name: str) -> Path:
    """Return the ``__init__.py`` of a folder."""
    return ROOT / "src" / "crinoid" / name / "__init__.py"


def folder_map() -> str:
    """Return the folders with the first line of each; ``|`` marks those of the layer above."""
    lines = []
    for layer in layers():
        for number, name in enumerate(layer):
            text = ast.get_docstring(ast.parse(home(name).read_text("utf-8"))) or ""
            lines.append(f"{'| ' if number else ''}{name}".ljust(14) + text.partition("\n")[0])
    return "\n".join(lines)


def page() -> str:
    """Return the page with the map up to date."""
    before, start, rest = PAGE.read_text("utf-8").partition("## Folders")
    intro, _, after = rest.partition("```\n")
    return f"{before}{start}{intro}```\n{folder_map()}\n```{after.partition('```')[2]}"


def inits() -> dict[Path, str]:
    """Return each folder's ``__init__.py`` with the line on its imports up to date."""
    found, order = {}, layers()
    for layer, lower in zip(order, [*order[1:], []], strict=True):
        names = " and ".join(f"``{name}``" for name in lower)
        line = f"May import {names} and lower folders." if names else "Imports no other folder."
        for name in layer:
            text = home(name).read_text("utf-8")
            text = re.sub(r"\n\n(May import .*|Imports no other folder\.)\n", "\n", text, count=1)
            first = re.match(r'"""(.*?)("""\n|\n)', text)
            assert first is not None, name
            rest = text[first.end() :]
            if first[2].startswith('"'):
                rest = f'"""\n{rest}'
            found[home(name)] = f'"""{first[1]}\n\n{line}\n{rest}'
    return found


if __name__ == "__main__":
    for path, text in inits().items():
        path.write_text(text, "utf-8")
    PAGE.write_text(page(), "utf-8")
