"""Run the commands of the documentation in temporary folders, and list those that fail.

    python docs/run_commands.py [--seconds 600] [--show] [PAGE ...]    # all pages: some hours

The commands of a page run in one folder, in their order. It has the files that the page shows and
names, and a result of `station-keeping`. Left out: commands that stand for others
(SCENARIO, ...), need other files, install something, or do not end; and the gallery, which
`make_pictures.py` makes.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LEFT_OUT = re.compile(
    r"\.\.\.|[A-Z]{4,}|pip install|-m venv|pytest|pre-commit|sphinx-build|crinoid live|scheduler"
    r"|crinoid train|--peers|-m \w+\.page|reef|git |\$ "
)
"""Commands that stand for others, install something, or need hours, other programs or a person."""
RUN = re.compile(r"(\.venv/bin/)?crinoid |(\w+=\S+ )?python (docs/|examples/|-m [bv])")
NAMED = re.compile(r"`([\w-]+\.(?:toml|csv))`[^`\n]*:\n\n```\w*\n(.*?)^```", re.M | re.S)
LATER = re.compile(r"```toml\n((?:(?!```).)*)```\n+Save it as `([\w-]+\.toml)`", re.S)
WRITTEN = re.compile(r"^%%writefile ([\w-]+\.(?:toml|csv))\n(.*?)^```", re.M | re.S)
MISTAKE = re.compile(r"^\$ .*\ncrinoid: ", re.M)


def files(text: str) -> dict[str, str]:
    """Return the files that a page names, before or after it shows them, and those of its cells."""
    named = {name: body for body, name in LATER.findall(text)}
    return dict(NAMED.findall(text)) | named | dict(WRITTEN.findall(text))


def lines(text: str) -> list[str]:
    """Return the shell commands of a page, each once."""
    found = []
    for language, block in re.findall(r"^```([^\n]*)\n(.*?)^```", text, re.M | re.S):
        if language not in ("", "bash", "console"):
            continue
        joined = MISTAKE.sub("", block).replace("\\\n", " ")
        shown = re.findall(r"^\$ (.*)$", joined, re.M)  # with its output
        for line in shown or joined.splitlines():
            if RUN.match(line) and not LEFT_OUT.search(line):
                found.append(line.replace(".venv/bin/", ""))
    return list(dict.fromkeys(found))


def lacks(line: str, folder: Path, absent: set[str]) -> bool:
    """Return whether a command reads a file that is not there, or a folder not written before.

    The output of such a command is ``absent`` for later ones.
    """
    words = shlex.split(line)
    read = [word for one, word in pairwise(words) if one == "--set" or not one.startswith("-")]
    names = [word.rpartition("=")[2] for word in read]
    named = [name for name in names if re.fullmatch(r"[\w./-]+\.(toml|nc|csv|mcap|eqx)", name)]
    if absent.isdisjoint(names) and all((folder / name).exists() for name in named):
        return False
    absent |= {word for one, word in pairwise(words) if one == "--out"}
    return True


def run(page: Path, result: Path, seconds: float, *, show: bool) -> list[str]:
    """Run the commands of a page; return those that fail."""
    text = page.read_text("utf-8")
    failed: list[str] = []
    absent: set[str] = set()
    with tempfile.TemporaryDirectory() as folder:
        for name, body in files(text).items():
            (Path(folder) / name).write_text(body, "utf-8")
        for name in ("benchmarks", "docs", "examples", "validation"):
            (Path(folder) / name).symlink_to(ROOT / name)
        shutil.copytree(result, Path(folder) / "results" / "station-keeping")
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        for line in lines(text):
            if lacks(line, Path(folder), absent):
                print(f"skipped          {line}", flush=True)
                continue
            start = time.perf_counter()
            try:
                ended = subprocess.run(
                    ["bash", "-o", "pipefail", "-c", line],
                    cwd=folder,
                    env=os.environ | {"PATH": path},
                    capture_output=True,
                    text=True,
                    timeout=seconds,
                )
                if show:
                    print(ended.stdout, ended.stderr, sep="", flush=True)
                code, said = ended.returncode, ended.stderr.strip().splitlines()[-3:]
            except subprocess.TimeoutExpired:
                code, said = "timeout", []
            print(f"{code!s:8} {time.perf_counter() - start:5.0f} s  {line}", flush=True)
            if code != 0:
                failed.append("\n    ".join([f"{page.relative_to(ROOT)}: {line}", *said]))
    return failed


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("pages", nargs="*", type=Path)
    parser.add_argument("--seconds", type=float, default=600.0, help="longest time of a command")
    parser.add_argument("--show", action="store_true", help="print what the commands print")
    given = parser.parse_args()
    everything = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    pages = [page.resolve() for page in given.pages] or [
        page for page in everything if "_build" not in page.parts and page.stem != "gallery"
    ]
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "station-keeping"
        line = [sys.executable, "-m", "crinoid", "run", "station-keeping", "--out", str(made)]
        subprocess.run(line, check=True, capture_output=True)
        failures = [
            each for page in pages for each in run(page, made, given.seconds, show=given.show)
        ]
    print("\n".join(["", f"{len(failures)} failed", *failures]))
    sys.exit(bool(failures))
