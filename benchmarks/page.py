"""Write the tables and figures of `docs/performance.md` from the files of `python -m benchmarks`.

    python -m benchmarks.page FOLDER ...

Each folder has a `bench.json`; of a benchmark in several of them the last one counts.
"""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
from PIL import Image

from benchmarks.command import BENCH, shown
from benchmarks.figure import draw_benchmark
from benchmarks.registry import title
from crinoid.view.figures import style

PAGE = Path(__file__).parents[1] / "docs" / "performance.md"
IMAGES = PAGE.parent / "images" / "performance"
MOST_BYTES, COLOURS, DPI = 40_000, 256, 110

Part = dict[str, Any]


def measured(file: Part) -> list[str]:
    """Return the names of the benchmarks that have rows."""
    return [name for name, part in file["benchmarks"].items() if part["rows"]]


def conditions(files: list[Part]) -> str:
    """Return the commands, and what their numbers depend on."""
    commands = [
        " ".join(["python -m benchmarks", *measured(file), *(["--peers"] if file["peers"] else [])])
        for file in files
    ]
    machine, versions = files[0]["machine"], files[0]["versions"]
    about = ", ".join(f"{name} {number}" for name, number in versions.items())
    where = f"{machine['cores']} cores ({machine['processor']}), {machine['system']}"
    return "\n".join(["```", *commands, "```", "", f"{files[0]['date']}, {where}, {about}."])


def tables(rows: list[Part]) -> list[str]:
    """Return a table for each quantity, without the curves, which the figure shows."""
    rows = [row for row in rows if "error" not in row["at"]]
    lines = []
    for quantity in dict.fromkeys(row["quantity"] for row in rows):
        own = [row for row in rows if row["quantity"] == quantity]
        keys = [key for key in own[0]["at"] if len({row["at"].get(key) for row in own}) > 1]
        heads = [*(["engine"] if len({row["engine"] for row in rows}) > 1 else []), *keys]
        spread = any(row["least"] < row["most"] for row in own)
        values = ("median", "least", "most") if spread else ("median",)
        titles = [
            quantity,
            *(head.replace("_", " ") for head in heads),
            *(values if spread else [""]),
        ]
        lines += [_row(titles), "|---" * (1 + len(heads)) + "|---:" * len(values) + "|"]
        for row in own:
            at = [row["engine"] if head == "engine" else f"{row['at'][head]:.3g}" for head in heads]
            lines.append(_row([row["name"], *at, *(shown(row[v], row["unit"]) for v in values)]))
        lines.append("")
    return lines


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def section(name: str, file: Part) -> str:
    """Return figure, tables and remarks of a benchmark."""
    part = file["benchmarks"][name]
    lines = [f"![{title(name)}](images/performance/{name}.png)", "", *tables(part["rows"])]
    lines += [f"- {remark}." for remark in part["remarks"]]
    if name == "precision" and file["peers"]:
        lines += ["", "| Engine | Leaves out, or does otherwise |", "|---|---|"]
        lines += [_row([peer["name"], peer["leaves out"]]) for peer in file["peers"]]
    return "\n".join(lines).rstrip()


def draw(name: str, part: Part) -> None:
    """Write a figure in few colours."""
    picture = io.BytesIO()
    with mpl.rc_context({**style.STYLE, "savefig.dpi": DPI}):
        draw_benchmark(title(name), part["rows"]).savefig(picture, facecolor="white")
    path = IMAGES / f"{name}.png"
    Image.open(picture).convert("RGB").quantize(COLOURS, method=Image.Quantize.FASTOCTREE).save(
        path, optimize=True
    )
    if (size := path.stat().st_size) > MOST_BYTES:
        sys.exit(f"{path}: {size} bytes; must be at most {MOST_BYTES}")


def main() -> None:
    """Write page and figures."""
    files = [json.loads((Path(name) / BENCH).read_text("utf-8")) for name in sys.argv[1:]]
    parts = {name: file for file in files for name in measured(file)}
    texts = {"conditions": conditions(files)}
    texts |= {name: section(name, file) for name, file in parts.items()}
    IMAGES.mkdir(parents=True, exist_ok=True)
    for name, file in parts.items():
        draw(name, file["benchmarks"][name])
    page = PAGE.read_text(encoding="utf-8")
    for name, text in texts.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        head, rest = page.split(begin)
        page = f"{head}{begin}\n\n{text}\n\n{end}{rest.split(end)[1]}"
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
