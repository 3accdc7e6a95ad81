"""The installation: versions, devices, optional parts, caches, disk, and a solve of one second."""

import os
import platform
import re
import shutil
import time
from collections import defaultdict
from importlib.metadata import requires
from pathlib import Path

import jax
import numpy as np
from rich.table import Table

from crinoid.cli.command import MISSED, console
from crinoid.cli.display import new_table, say_notes
from crinoid.foundation.cache_folder import cache_folder
from crinoid.foundation.cores import cores
from crinoid.foundation.version import version_of, versions
from crinoid.scenario import Scenario
from crinoid.simulation import SimulationError, simulate

_AMONG = ("test", "lint", "docs", "dev", "peers")  # extras for work on crinoid itself
_EXTRA = re.compile(r"([\w.-]+)[^;]*;\s*extra == ['\"](\w+)['\"]")
_LITTLE = 1e9  # free disk space below which a note says so (bytes)
_TIP, _TOLERANCE = (0.45959395, -10.18278911), 1e-6
"""Where the tip of `_CASE` ends (m), on all machines to far below the tolerance."""
_CASE = Scenario(
    arm={"nodes": 6, "youngs_modulus": 1e6},
    flow=[{"kind": "uniform", "velocity": [0.0, -0.3], "ramp_time": 0.5}],
    simulation={"duration": 1.0},
)


def examine() -> tuple[str, int]:
    """Print the state of the installation; return its fault, if any, and the exit code of one."""
    notes: list[str] = []
    console.print(_about())
    console.print(_parts())
    console.print(_places(notes))
    wrong = _solve()
    say_notes(notes)
    return wrong, MISSED


def _about() -> Table:
    rows = [*versions().items(), ("system", platform.platform()), ("cores", str(cores()))]
    rows += [("device of JAX", f"{each.platform}, {each.device_kind}") for each in jax.devices()]
    return new_table("Versions and devices", ("", ""), rows)


def _parts() -> Table:
    """Return the packages of optional parts, and commands that install missing ones."""
    parts: dict[str, list[str]] = defaultdict(list)
    for each in requires("crinoid") or ():
        found = _EXTRA.match(each)
        if found and found[2] not in _AMONG and found[1] != "crinoid":
            parts[found[2]].append(found[1])
    rows = []
    for part, names in sorted(parts.items()):
        lacking = [name for name in names if not version_of(name)]
        there = [f"{name} {version_of(name)}" for name in names if name not in lacking]
        remedy = f'pip install "crinoid[{part}]"' if lacking else ""
        rows.append((part, ", ".join(there) or "-", remedy))
    return new_table("Optional parts", ("", "installed", "to install the rest"), rows)


def _places(notes: list[str]) -> Table:
    """Return folders of caches and results, and note faults of these."""
    programs = cache_folder(os.environ.get("JAX_COMPILATION_CACHE_DIR"))
    size = sum(file.stat().st_size for file in programs.rglob("*") if file.is_file())
    if not jax.config.values["jax_enable_compilation_cache"]:
        notes.append("compiled programs are not saved: JAX_ENABLE_COMPILATION_CACHE is false")
    here = Path.cwd()
    free = shutil.disk_usage(here).free
    for folder in (here, programs):
        if folder.exists() and not os.access(folder, os.W_OK):
            notes.append(f"{folder} cannot be written to")
    if free < _LITTLE:
        notes.append(f"only {free / 1e6:.0f} MB are free where results are written")
    rows = [
        ("compiled programs", str(programs), f"{size / 1e6:.0f} MB"),
        ("working folder", str(here), f"{free / 1e9:.1f} GB free"),
    ]
    return new_table("Folders", ("", "", ""), rows)


def _solve() -> str:
    """Solve one second of an arm, and compare the place of its tip with the known one."""
    begun = time.perf_counter()
    try:
        with console.status("compiling and solving 1 s of an arm"):
            data = simulate(_CASE).dataset
    except SimulationError as error:
        return f"this installation cannot solve an arm: {error}"
    elapsed, running = time.perf_counter() - begun, data.attrs["wall_time"]
    tip = data["tip_position"].values[-1]
    away = float(np.abs(tip - _TIP).max())
    spent = f"{1e3 * running:.0f} ms, and {elapsed - running:.1f} s to prepare and compile it"
    console.print(f"1 s of an arm: {spent}; tip {away:.1g} m from its known place", soft_wrap=True)
    if not away < _TOLERANCE:
        found = f"tip at {tip.round(8).tolist()}, not {list(_TIP)}"
        return f"this installation computes another motion: {found}"
    return ""
