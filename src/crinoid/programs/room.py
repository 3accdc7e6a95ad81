"""Memory maps that compiled code takes: a process has only so many."""

import gc
from pathlib import Path

import jax


def make_room() -> None:
    """Let go of compiled code where it fills half of what there is room for."""
    if _crowded():
        jax.clear_caches()
        gc.collect()


def _crowded() -> bool:
    """Tell whether compiled code fills half of the memory maps that Linux gives a process.

    A program takes some; a process that has none left crashes. Other systems do not count them.
    """
    try:
        most = int(Path("/proc/sys/vm/max_map_count").read_text())
        return 2 * Path("/proc/self/maps").read_bytes().count(b"\n") > most
    except OSError:
        return False
