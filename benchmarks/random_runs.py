"""Runs scenarios drawn at random and shows how each ended, and whether anything passed in silence.

A structure (dimension, nodes, mount, kinds of flow, load, obstacle and motion, controller) is drawn
once for several runs, which share its compiled code; all numbers are drawn for each run. Runs are
short. A run passes in silence if it ended ok with a ledger off by more than 5 % and no note of it,
unless it holds no energy to speak of. With --half each run that ended ok is run again with half
the time step: it passes in silence too if its tip is off by more than 5 % of its motion without a
note, before the run or after it, on the time step, the energy or an instability.

    XLA_FLAGS=--xla_backend_optimization_level=0 python benchmarks/random_runs.py
"""

import argparse
import itertools
import re
import tempfile
import time
import tomllib
import traceback
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.diagnostics.plausibility import plausibility_warnings
from crinoid.elements import ENERGIES
from crinoid.simulation import Progress, play

STEPS = 400
PATIENCE = 60.0
"""Time after which a run is given up (s)."""
TOLD = "the energy ledger"
WARNS = re.compile("time.step|energy|integrator|unstable|contact|obstacle|fold|halv|steps")
"""In a note on a run whose tip may depend on its time step."""
NO_ENERGY = 1e-15
"""Energies and works of which the ledger is round-off (J)."""

FLOWS = ("uniform", "shear", "gust", "sine", "gauss-markov", "turbulence", "waves", "measured")
LOADS = ("tip", "follower", "distributed", "tangential")
OBSTACLES = ("plane", "sphere", "capsule", "cylinder", "free", "flow")
Draw = np.random.Generator


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--each", type=int, default=20, help="runs of one structure")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of the runs to do")
    parser.add_argument("--set", nargs="*", default=[], help="KEY=VALUE in TOML, for all of them")
    parser.add_argument("--half", action="store_true", help="again with half the time step")
    options = parser.parse_args()
    found: dict[str, list[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        records = write_records(Path(folder))
        for number in range(options.runs):
            if options.only and number not in options.only:
                continue
            if number % (4 * options.each) == 0:
                jax.clear_caches()
            structure = draw_structure(
                np.random.default_rng([options.seed, number // options.each]), records
            )
            kind, line = run(number, options.seed, structure, options.set, half=options.half)
            print(line, flush=True)
            found.setdefault(kind, []).append(line)
    print()
    for kind, lines in sorted(found.items()):
        print(f"{len(lines):4d} {kind}")
    listed = ("SILENT", "COARSE", "BROKEN", "SLOW")
    for line in itertools.chain(*(found.get(kind, []) for kind in listed)):
        print(line)


def run(
    number: int, seed: int, structure: dict[str, Any], changes: list[str], *, half: bool = False
) -> tuple[str, str]:
    """Play one run; return how it ended and a line about it."""
    draw = np.random.default_rng([seed, 10**6 + number])
    begun = time.perf_counter()

    def report(progress: Progress) -> None:
        if progress.elapsed > PATIENCE:
            raise TimeoutError(f"{progress.time:.3g} of {progress.duration:.3g} s")

    head = f"{number:3d} {structure['name']}"
    try:
        document = draw_numbers(draw, structure)
        scenario = crinoid.Scenario.from_dict(document)
        if changes:
            pairs = (change.split("=", 1) for change in changes)
            values = {key: tomllib.loads(f"value = {text}")["value"] for key, text in pairs}
            scenario = scenario.with_values(values)
        result = play(Prepared(scenario), report=report)
    except crinoid.ScenarioError as error:
        return "refused", f"{head}: refused: {' '.join(str(error).split())}"
    except TimeoutError as error:
        return "SLOW", f"{head}: too slow, {error} in {PATIENCE:g} s"
    except Exception:
        return "BROKEN", f"{head}: {traceback.format_exc()}"
    simulation, data = scenario.simulation, result.dataset
    head += f" {simulation.integrator[:3]} h={simulation.time_step:.2g}"
    head += f" x{simulation.steps} {time.perf_counter() - begun:.0f}s"
    if not all(np.isfinite(data[name].values).all() for name in data.data_vars if name != "mode"):
        return "BROKEN", f"{head}: not a number"
    off, scale = ledger(data)
    told = any(note.startswith(TOLD) for note in result.notes)
    head += f": ledger {off:.1%} of {scale:.2g} J"
    others = len(result.notes) - told
    text = f"{head}, {'a note of it' if told else 'no note'}, {others} others: {result.status}"
    if result.failure:
        return "failed", text
    warned = [
        note
        for note in [*plausibility_warnings(Prepared(scenario)), *result.notes]
        if WARNS.search(note)
    ]
    if half and not warned:
        finer = scenario.with_values({"simulation.time_step": simulation.time_step / 2})
        try:
            apart = tip_off(data, play(Prepared(finer), report=report).dataset)
        except TimeoutError:
            return "SLOW", f"{text}; half the step"
        text += f"; half the step: tip {apart:.1%}"
        if apart > 0.05:
            return "COARSE", text
    if told:
        note = next(note for note in result.notes if note.startswith(TOLD))
        return "ok with a note on the ledger", f"{text}\n      {note}"
    if off <= 0.05:
        return "ok", text
    if scale < NO_ENERGY:
        return "ok, without energy", text
    return ("SILENT" if moves(data) else "ok, hardly moved"), text


def ledger(data: xr.Dataset) -> tuple[float, float]:
    """Return by how much the ledger is off, as a share of the largest change (J), and that."""
    change = (data["energy"] - data["energy"].isel(time=0)).transpose("time", "kind").values
    stored = np.isin(data["kind"].values, ENERGIES)
    defect = change[:, stored].sum(axis=1) - change[:, ~stored].sum(axis=1)
    scale = float(np.abs(change).max())
    return float(np.abs(defect).max()) / scale if scale else 0.0, scale


def tip_off(data: xr.Dataset, finer: xr.Dataset) -> float:
    """Return by how much the tip is off, as a share of its largest motion."""
    tips = [each["tip_position"].transpose("time", "axis").values for each in (data, finer)]
    count = min(map(len, tips))
    moved = np.abs(tips[1] - tips[1][0]).max()
    arm = float(data["arc_length"][-1])
    return float(np.abs(tips[0][:count] - tips[1][:count]).max() / max(moved, 1e-6 * arm))


def moves(data: xr.Dataset) -> bool:
    """Return whether any node moved by more than a millionth of the arm's length."""
    moved = np.abs(data["position"] - data["position"].isel(time=0)).max()
    return float(moved) > 1e-6 * float(data["arc_length"][-1])


def write_records(folder: Path) -> dict[str, str]:
    """Write current records of one place: one that drifts past the arm, one that moves as one."""
    times = np.arange(0.0, 120.0, 0.5)
    units, paths = {"units": "m s-1"}, {}
    for name, mean in (("drifting", 0.3), ("swinging", 0.02)):
        swing = [mean + 0.1 * np.sin(0.7 * times), 0.05 * np.cos(0.9 * times), 0.1 * np.sin(times)]
        paths[name] = str(folder / f"{name}.nc")
        xr.Dataset(
            {name: ("time", u, units) for name, u in zip("uvw", swing, strict=True)},
            coords={"time": ("time", times, {"units": "s"})},
        ).to_netcdf(paths[name])
    return paths


def draw_structure(draw: Draw, records: dict[str, str]) -> dict[str, Any]:
    """Draw what decides which code is compiled."""

    def some(kinds: tuple[str, ...], most: int) -> list[str]:
        count = int(draw.integers(0, most + 1))
        return sorted(draw.choice(kinds, size=count, replace=False).tolist())

    axes = int(draw.choice([2, 2, 3]))
    structure = {
        "axes": axes,
        "nodes": int(draw.choice([3, 4, 5, 7, 11, 21])),
        "mount": str(draw.choice(["clamped", "clamped", "pinned"])),
        "flows": some(FLOWS, 2),
        "loads": some(LOADS, 1),
        "obstacles": some(OBSTACLES, 1 if draw.random() < 0.5 else 0),
        "motions": some(("slide", "heave", "tilt"), 1 if draw.random() < 0.7 else 0),
        "table": bool(draw.random() < 0.5),
        "control": bool(draw.random() < 0.35),
        "time_step": float(10 ** draw.uniform(-4, -1)),  # of flows drawn for a duration
        "length": None,
        "record": "",
    }
    if "measured" in structure["flows"]:
        # how far a drifting record reaches ahead and back, and so its size, goes by the arm's reach
        kind = str(draw.choice(list(records)))
        structure["record"] = records[kind]
        if kind == "drifting":
            structure["length"] = float(draw.choice([0.2, 0.7, 2.0]))
            structure["motions"] = [m for m in structure["motions"] if m == "tilt"]
    if structure["mount"] == "pinned" and axes == 2:
        structure["motions"] = [m for m in structure["motions"] if m != "tilt"]
    kinds = "+".join(
        structure["flows"] + structure["loads"] + structure["obstacles"] + structure["motions"]
    )
    structure["name"] = f"{axes}D n{structure['nodes']} {structure['mount'][:3]} {kinds or '-'}"
    structure["name"] += " pid" * structure["control"]
    return structure


def draw_numbers(draw: Draw, structure: dict[str, Any]) -> dict[str, Any]:
    """Draw all numbers of a scenario of a structure."""
    axes = structure["axes"]

    def between(low: float, high: float) -> float:
        return float(np.exp(draw.uniform(np.log(low), np.log(high))))

    def vector(size: float) -> list[float]:
        return (size * draw.normal(size=axes) / np.sqrt(axes)).tolist()

    length = structure["length"] or between(0.1, 3.0)
    radius = length * between(0.005, 0.06)
    youngs = between(1e4, 3e8)
    EI = youngs * np.pi * radius**4 / 4
    density = float(draw.choice([0.0, 1.2, 1025.0, 1025.0]))
    drawn_for = any(kind in structure["flows"] for kind in ("gauss-markov", "measured"))
    step = structure["time_step"] if drawn_for else between(1e-4, 0.1)
    step = float(f"{step:.2g}")
    steps = STEPS if drawn_for else int(draw.integers(50, STEPS + 1))
    integrator = str(draw.choice(["newmark", "newmark", "generalized-alpha", "implicit-euler"]))
    speed = 0.5 if density > 100 else 5.0
    arm: dict[str, Any] = {
        "dimension": axes,
        "nodes": structure["nodes"],
        "length": length,
        "radius": radius,
        "youngs_modulus": youngs,
        "density": between(500.0, 3000.0),
        "damping_time": float(draw.choice([0.0, between(1e-4, 0.1)])),
        "rest_curvature": float(draw.choice([0.0, draw.normal() / length])),
    }
    if draw.random() < 0.3:
        arm["radius"] = [radius, radius * draw.uniform(0.3, 1.0)]
    tilt = draw.uniform(-90.0, 90.0)
    base: dict[str, Any] = {"mount": structure["mount"], "tilt_deg": tilt}
    motions = [
        draw_motion(draw, channel, structure["table"], length, step * steps, between)
        for channel in structure["motions"]
    ]
    document: dict[str, Any] = {
        "seed": int(draw.integers(1000)),
        "arm": arm,
        "base": base | ({"motion": motions} if motions else {}),
        "water": {
            "density": density,
            "depth": 20.0,
            "gravity": 9.81 if "waves" in structure["flows"] else float(draw.choice([9.81, 0.0])),
        },
        "flow": [
            draw_flow(draw, kind, speed, structure, step * steps, vector, between)
            for kind in structure["flows"]
        ],
        "load": [draw_load(draw, kind, EI, length, axes, vector) for kind in structure["loads"]],
        "obstacle": [
            draw_obstacle(draw, kind, axes, length, radius, np.deg2rad(tilt))
            for kind in structure["obstacles"]
        ],
        "simulation": {
            "time_step": step,
            "duration": steps * step,
            "integrator": integrator,
            "max_halvings": 8,
            "start": str(draw.choice(["rest", "equilibrium"])),
        },
        "output": {"interval": step * max(1, steps // 50)},
    }
    if integrator == "generalized-alpha":
        document["simulation"]["spectral_radius"] = draw.uniform(0.0, 1.0)
    if structure["control"]:
        gains = {"kp": draw.uniform(0.0, 1.0), "ki": between(0.1, 10.0), "kd": 0.02}
        document["base"]["channels"] = {"slide": {}, "heave": {}}
        document["control"] = {"kind": "pid", "pid": {"slide": gains, "heave": gains}}
        document["control"]["compare"] = False
        document["control"]["mapping"] = "static-jacobian"
    return document


def draw_motion(
    draw: Draw, channel: str, table: bool, length: float, duration: float, between: Any
) -> dict[str, Any]:
    turns = channel == "tilt"
    key, size = ("_deg", 30.0) if turns else ("", 0.2 * length)
    if not table:
        frequency = between(0.2, 3.0)
        return {
            "channel": channel,
            "kind": "sine",
            f"amplitude{key}": size * draw.normal(),
            "frequency_hz": frequency,
        }
    times = np.linspace(0.0, duration * (1 + 1e-9), 5)
    values = size * min(1.0, duration) * np.concatenate([[0.0], draw.normal(size=4)])
    return {
        "channel": channel,
        "kind": "table",
        "time": times.tolist(),
        f"value{key}": values.tolist(),
    }


def draw_flow(
    draw: Draw,
    kind: str,
    speed: float,
    structure: dict[str, Any],
    duration: float,
    vector: Any,
    between: Any,
) -> dict[str, Any]:
    names = ["u", "w"] if structure["axes"] == 2 else ["u", "v", "w"]
    numbers: dict[str, Any] = {
        "uniform": {"velocity": vector(speed), "ramp_time": float(draw.choice([0.0, 0.3]))},
        "shear": {"velocity": vector(speed), "reference_depth": 5.0},
        "gust": {"velocity": vector(speed), "duration": between(0.1, 1.0) * duration},
        "sine": {"amplitude": vector(speed), "frequency_hz": between(0.1, 3.0)},
        "gauss-markov": {
            "mean": vector(speed),
            "standard_deviation": 0.3 * speed,
            "correlation_time": 0.5 * duration,
        },
        "turbulence": {
            "mean": vector(speed),
            "intensity": draw.uniform(0.02, 0.3),
            "length_scale": between(0.1, 2.0),
            "modes": 16,
        },
        "waves": {"significant_height": 1.0, "peak_period": between(3.0, 9.0), "components": 16},
        "measured": {"file": structure["record"], "velocity": names},
    }[kind]
    return {"kind": kind, **numbers}


def draw_load(
    draw: Draw, kind: str, EI: float, length: float, axes: int, vector: Any
) -> dict[str, Any]:
    size = draw.uniform(0.1, 3.0) * EI / length**2
    onset = {"ramp_time": float(draw.choice([0.0, 0.2]))}
    if kind in ("tip", "follower"):
        moment: Any = draw.normal() * EI / length if axes == 2 else vector(EI / length)
        force = {"force": vector(size), "moment": moment, "follower": kind == "follower"}
        return {"kind": "tip", **force, **onset}
    direction = "tangential" if kind == "tangential" else vector(1.0)
    return {"kind": "distributed", "direction": direction, "magnitude": size / length, **onset}


def draw_obstacle(
    draw: Draw, kind: str, axes: int, length: float, radius: float, tilt: float
) -> dict[str, Any]:
    """Put an obstacle below the outer half of the straight arm, and let it come nearer."""
    along = np.array([np.cos(tilt), np.sin(tilt)])
    below = np.array([np.sin(tilt), -np.cos(tilt)])
    size, gap = length * draw.uniform(0.02, 0.1), length * draw.uniform(0.01, 0.2)
    place = np.array([0.0, -10.0]) + draw.uniform(0.5, 1.0) * length * along
    place = place + (radius + gap + (0.0 if kind == "plane" else size)) * below
    velocity = -length * draw.uniform(0.0, 1.0) * below

    def in_space(plane: np.ndarray) -> list[float]:
        return plane.tolist() if axes == 2 else [plane[0], 0.0, plane[1]]

    table: dict[str, Any] = {
        "kind": "sphere" if kind in ("free", "flow") else kind,
        "position": in_space(place),
        "velocity": "flow" if kind == "flow" else in_space(velocity),
        "friction": float(draw.choice([0.0, draw.uniform(0.1, 0.8)])),
    }
    if kind == "plane":
        return table | {"normal": in_space(-below)}
    if kind == "capsule":
        table["length"] = 0.5 * length
    if kind == "free":
        table["mass"] = 1025.0 * 4 / 3 * np.pi * size**3 * draw.uniform(0.5, 2.0)
    return table | {"radius": size}


if __name__ == "__main__":
    main()
