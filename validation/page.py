"""Write `docs/validation.md` and its figures from what `python -m validation` wrote.

    python -m validation --all --peers --out results/validation
    python -m validation.page results/validation

Figures go to `docs/images/validation`, in 256 colours.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from PIL import Image

PAGE = Path(__file__).parents[1] / "docs" / "validation.md"
FIGURES = PAGE.parent / "images" / "validation"
BYTES = 40_000
"""Largest size of a figure."""

HEAD = """# Validation

Each case compares crinoid with a known answer: a solution on paper, numbers in print, an
experiment, or another program. The cases are functions in `validation/cases` of the repository.
In a clone these commands make this page:

```
python -m validation --all --peers --out results/validation
python -m validation.page results/validation
```

Without options `python -m validation` runs the short cases that need no other program. Names choose
cases, written into `results/validation-CASE`; `--list` shows the names. The exit code is 1 where an
error exceeds its tolerance, printed **bold** here, or a required peer (`--peers`, or a named case)
is not installed.
`validation.json` has all checks, `CASE.png` the figure and `CASE.toml` the scenario of a case.
"""


def page(record: dict[str, Any]) -> str:
    """Return the page of a record."""
    cases, checks = record["cases"], record["checks"]
    held = sum(check["holds"] for check in checks)
    parts = [
        HEAD,
        f"Run on {record['date'][:10]} with crinoid {record['crinoid']}, JAX {record['jax']} and "
        f"Python {record['python']} ({record['machine']}): {held} of {len(checks)} checks hold.\n",
        "| Case | Reference | Checks | Order | Time (s) |\n|---|---|---|---|---|",
    ]
    for case in cases:
        own = [check for check in checks if check["name"] == case["name"]]
        order = own[0]["order"] if own else None
        cells = (
            f"[{case['name']}](#{case['name']})",
            case["kind"],
            _held(own) if own else case["trouble"],
            "" if order is None else f"{order:.2f}",
            f"{case['seconds']:.0f}",
        )
        parts.append(f"| {' | '.join(cells)} |")
    parts += [section(case, checks) for case in cases]
    return "\n".join(parts) + "\n"


def _held(checks: list[dict[str, Any]]) -> str:
    """Return the number of checks, and in bold that of those that hold where not all do."""
    held = sum(check["holds"] for check in checks)
    return str(held) if held == len(checks) else f"**{held} of {len(checks)}**"


def section(case: dict[str, Any], checks: Iterable[dict[str, Any]]) -> str:
    """Return the section of a case."""
    name = case["name"]
    parts = [f"\n## {name}\n\n{case['title']}\n"]
    for word, key in (("Reference", "source"), ("Method", "method"), ("Tolerance", "reason")):
        parts.append(f"- {word}: {case[key]}")
    if case["trouble"]:
        return "\n".join([*parts, f"\n{case['trouble'].capitalize()}."])
    parts.append("\n| Quantity | Reference | crinoid | Error | Tolerance |")
    parts.append("|---|---|---|---|---|")
    parts += [row(check) for check in checks if check["name"] == name]
    parts += [f"\n{remark}" for remark in case["remarks"]]
    if f"{name}.png" in case["files"]:
        parts.append(f"\n![Figure of {name}](images/validation/{name}.png)")
    return "\n".join(parts)


def row(check: dict[str, Any]) -> str:
    """Return the row of a check: an error that is too large in bold, a dash for NaN or infinity."""
    unit = "" if check["unit"] == "1" else f" ({check['unit']})"
    factor, share = (100.0, " %") if check["relative"] else (1.0, "")
    numbers = [("6g", 1.0, "", check["reference"]), ("6g", 1.0, "", check["value"])]
    numbers += [("2g", factor, share, check[key]) for key in ("error", "tolerance")]
    cells = [
        "-" if value is None else f"{value * scale:.{digits}}{mark}"
        for digits, scale, mark, value in numbers
    ]
    if not check["holds"]:
        cells[2] = f"**{cells[2]}**"
    return f"| {' | '.join([check['quantity'] + unit, *cells])} |"


def copy_figures(folder: Path, record: dict[str, Any]) -> None:
    """Replace the figures by those of a folder, in 256 colours."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    for path in FIGURES.glob("*.png"):
        path.unlink()
    for name in (name for case in record["cases"] for name in case["files"]):
        if name.endswith(".png"):
            with Image.open(folder / name) as picture:
                picture.convert("RGB").quantize(256).save(FIGURES / name, optimize=True)
            size = (FIGURES / name).stat().st_size
            if size > BYTES:
                raise SystemExit(f"{name}: got {size} bytes; must be at most {BYTES}. Draw less.")


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "results/validation")
    record = json.loads((folder / "validation.json").read_text("utf-8"))
    copy_figures(folder, record)
    PAGE.write_text(page(record), "utf-8")
