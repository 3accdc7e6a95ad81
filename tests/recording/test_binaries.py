"""Binary files of instruments: a file of a profiler, written byte by byte, and its current."""

import logging
import struct
import sys

import numpy as np
import pytest

from crinoid.recording import read_dataset
from helpers.refusals import mistake
from helpers.styles import BED, COUNT, Played, over, straight

RANGES = np.array([0.5, 1.5, 2.5])
"""Heights of the cells above the instrument (m)."""
INSTRUMENT, EARTH = 0b01000, 0b11000
"""Frames of the velocity, in bits 3 and 4 of a byte of PD0."""
STEP = 600


def ensemble(index, velocity, frame, heading):
    """Return an instant in the format PD0: velocities (cell, 4) in m/s, heading in degrees."""
    cells = len(velocity)
    fixed = struct.pack(
        "<H8B3H4BH4B2h2B2H4BH",
        *(0x0000, 8, 0, 0b10001010, 1, 0, 0, 4, cells),  # up, 20 degrees, 300 kHz
        *(1, 100, 10, 1, 64, 9, 0, 2000, STEP // 60, 0, 0, frame),  # cells of 1 m
        *(0, 0, 0, 0, round(100 * RANGES[0]), 50, 0, 0, 0, 0, 0),
    )
    clock = (24, 3, 1, 6 + index * STEP // 3600, index * STEP // 60 % 60, 0, 0)
    variable = struct.pack(
        "<HH8B4H4h6B8bL",
        *(0x0080, index + 1, *clock, 0, 0, 1500, 195, round(100 * heading)),
        # an instrument that looks up is turned over by its roll
        *(0, 0, 35, 1000, *(6 * (0,)), *(8 * (0,)), 0),
    )
    speeds = np.round(1000 * np.asarray(velocity)).astype("<i2").tobytes()
    parts = [fixed, variable, struct.pack("<H", 0x0100) + speeds]
    parts += [struct.pack("<H", code) + bytes(4 * cells * [100]) for code in (0x200, 0x300, 0x400)]
    head = 6 + 2 * len(parts)
    offsets = head + np.cumsum([0, *map(len, parts)])
    text = struct.pack("<2BHBB", 0x7F, 0x7F, offsets[-1], 0, len(parts))
    text += offsets[:-1].astype("<u2").tobytes() + b"".join(parts)
    return text + struct.pack("<H", sum(text) & 0xFFFF)


def profiler(frame, name):
    """Return what writes a file of a profiler that looks up, heading east."""

    def write(folder):
        # mhkit drops the last instant
        east, north = over(straight, RANGES + BED, COUNT + 1)
        pair = (east, north) if frame == EARTH else (north, east)
        rows = np.stack([*pair, 0 * east, 0 * east], axis=-1)
        path = folder / name
        path.write_bytes(b"".join(ensemble(k, row, frame, 90.0) for k, row in enumerate(rows)))
        return path

    return write


@pytest.mark.parametrize(
    ("frame", "name", "place"),
    [
        (EARTH, "adcp.000", {}),
        (INSTRUMENT, "current.dat", {"velocity": ["vel[E]", "vel[N]", "0"]}),  # up has round-off
    ],
)
def test_a_profile_in_a_binary_file_is_played(tmp_path, capfd, monkeypatch, frame, name, place):
    pytest.importorskip("mhkit", reason="mhkit is not installed")
    monkeypatch.setattr(logging.root, "handlers", [])
    Played(profiler(frame, name), tuple(RANGES + BED), place=place).check(tmp_path)
    assert "".join(capfd.readouterr()) == ""
    assert logging.root.handlers == []


@pytest.mark.parametrize("name", ["a.ad2cp", "a.000"])
def test_a_binary_file_without_mhkit_is_refused_with_a_hint(tmp_path, monkeypatch, name):
    monkeypatch.setitem(sys.modules, "mhkit", None)
    line = mistake(read_dataset, str(profiler(EARTH, name)(tmp_path)))
    assert line.endswith('reading it needs mhkit: pip install "crinoid[instruments]"')
