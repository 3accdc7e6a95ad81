"""An arm that hangs in a steady current: a boundary-value problem, and lines of other programs."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.integrate import solve_bvp

from crinoid.scenario import Scenario
from crinoid.simulation import equilibrium
from crinoid.view.figures.style import BLUE, VERMILLION
from validation.case import Check, Evidence, case
from validation.elastica import PlanarEnd
from validation.peers.swing import Swing
from validation.slender import BY_MESHES, MESHES, PLACE, KnownBend, bent, tip_of

_LENGTH, _RADIUS, _MODULUS = 0.5, 0.02, 5e5
_SOLID, _WATER, _DRAG, _GRAVITY = 1080.0, 1025.0, 1.1, 9.81
_AREA = np.pi * _RADIUS**2
_EA, _EI = _MODULUS * _AREA, _MODULUS * _AREA * _RADIUS**2 / 4
_SPEEDS = (0.1, 0.25, 0.4)
_EDGE = _LENGTH / (MESHES[-1] - 1)
_SEGMENTS, _TIME_STEP = 20, 1e-3
"""Of the other programs."""


def _exact(speed: float) -> Float[np.ndarray, "3 place"]:
    """Return directions (rad) and places (m) of a rod that bends and stretches.

    Weight and drag across it act. EI theta' = M, M' = -r' x n, n' = -load, r' = (1 + n . t / EA) t,
    from the clamp to the tip.
    """
    weight = (_SOLID - _WATER) * _AREA * _GRAVITY
    pressure = _WATER * _DRAG * _RADIUS

    def rates(_: Float[np.ndarray, " p"], y: Float[np.ndarray, "6 p"]) -> Float[np.ndarray, "6 p"]:
        angle, moment, force_x, force_z = y[:4]
        c, s = np.cos(angle), np.sin(angle)
        across = -speed * s  # along the normal (-s, c)
        drag = pressure * across * np.abs(across)
        stretched = 1.0 + (c * force_x + s * force_z) / _EA
        turned = stretched * (s * force_x - c * force_z)
        load_z = c * drag - weight
        return np.stack([moment / _EI, turned, s * drag, -load_z, stretched * c, stretched * s])

    def ends(root: Float[np.ndarray, "6"], tip: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
        return np.array([root[0] + np.pi / 2, root[4], root[5], *tip[1:4]])

    along = np.linspace(0.0, _LENGTH, 41)
    guess = np.zeros((6, along.size))
    guess[0], guess[5] = -np.pi / 2, -along
    found = solve_bvp(rates, ends, along, guess, tol=1e-9, max_nodes=20_000)
    if not found.success:
        raise RuntimeError(f"no reference found: {found.message}")
    return np.asarray(found.y[[0, 4, 5]])


def _scenario(nodes: int, speed: float) -> Scenario:
    """Return the arm in a current along x."""
    return Scenario(
        arm={"length": _LENGTH, "nodes": nodes, "radius": _RADIUS, "density": _SOLID}
        | {"youngs_modulus": _MODULUS},
        base={"tilt_deg": -90.0, "position": [0.0, -10.0]},
        water={"density": _WATER, "drag_normal": _DRAG, "drag_tangential": 0.0}
        | {"gravity": _GRAVITY},
        flow=[{"kind": "uniform", "velocity": [speed, 0.0]}],
    )


@case(
    kind="exact",
    title="An arm hangs in a steady current that pushes its tip to the side.",
    source="Boundary-value problem of a rod with weight, buoyancy and the drag across it, by "
    "collocation to 1e-9.",
    method=BY_MESHES.replace(";", f" at {', '.join(map(str, _SPEEDS))} m/s;"),
    reason="Order 2 in the edge L/40: the tip is within a third of an edge squared, over L. The "
    "ends add a term of order 3: 0.25 on the order.",
)
def hanging_in_current() -> Evidence:
    bends = []
    for speed in _SPEEDS:
        angle, *places = _exact(speed)
        bend = KnownBend(
            f"{speed:g}",
            text := f"{speed:g} m/s",
            partial(_scenario, speed=speed),
            PlanarEnd(places[0][-1], places[1][-1], angle[-1], np.nan),
            _EDGE**2 / _LENGTH / 3,
            text,
            points=np.array(places)[:, :: angle.size // 8],
        )
        bends.append(bend)
    measures = {f"{name} of the tip": measure for name, measure in PLACE.items()}
    remarks = (
        "CableDyn 0.3.0 gives x of the tip as 0.0238306, 0.1310578 and 0.2362216 m, 0.1 % more.",
    )
    found = bent(bends, measures, xlabel="x (m)", ylabel="z (m)", xlim=(None, 0.35))
    return replace(found, remarks=remarks)


def _at_rest(
    peer: str,
    prepare: Callable[..., Swing],
    speeds: Sequence[float],
    *,
    duration: float,
    interval: float,
    until: float,
    within: float,
    last: int,
    still: float,
) -> Evidence:
    """Compare equilibria with where a line comes to rest at each speed.

    Its tip moves by at most ``still`` (m) in the ``last`` samples.
    """
    checks, scenarios, paths = [], {}, []
    for speed in speeds:
        line = _scenario(_SEGMENTS + 1, speed)
        tips, _ = prepare(line, _TIME_STEP, interval, round(duration / interval))()
        scenarios[f"{speed:g}"] = arm = _scenario(MESHES[-1], speed)
        ours, text = tip_of(equilibrium(arm)) - [0.0, -10.0], f"{speed:g} m/s"
        moved = np.ptp(tips[-last:, 0])
        checks += [
            Check(f"x of the tip, {text}", tips[-1, 0], ours[0], within, "m", True),
            Check(f"z of the tip, {text}", tips[-1, 1], ours[1], within, "m", True),
            Check(f"{peer} still moves, {text}", 0.0, moved, still, "m"),
        ]
        paths.append((tips[:, 0], ours[0]))

    def draw(axes: Axes) -> None:
        for theirs, end in paths:
            time = interval * np.arange(1, theirs.size + 1)
            axes.plot(time, theirs, color=VERMILLION, label=f"{peer}, from rest")
            axes.axhline(end, color=BLUE, linestyle="--", label="crinoid, equilibrium")
        axes.set(xlabel="time (s)", ylabel="x of the tip (m)", xlim=(0.0, until))

    return Evidence(checks, None, scenarios, draw)


@case(
    kind="peer",
    title="An arm that hangs in a steady current comes to rest where MoorDyn's line does.",
    source="MoorDyn 2.7.2, run in the case from the straight line until it is at rest.",
    method=f"Static equilibrium with {MESHES[-1]} nodes; MoorDyn with {_SEGMENTS} segments, steps "
    f"of {_TIME_STEP:g} s by RK4 and 30 s.",
    reason="Lumped masses err by order 2 in the segment, L/20: 1/400, and twice that with the "
    "clamp.",
    needs=("moordyn",),
)
def moordyn_line() -> Evidence:
    from validation.peers.moordyn import prepare

    found = _at_rest(
        "MoorDyn",
        partial(prepare, damping=-0.5),
        _SPEEDS[:2],
        duration=30.0,
        interval=0.1,
        until=10.0,
        within=0.005,
        last=20,
        still=1e-5,
    )
    remark = (
        f"At {_SPEEDS[-1]:g} m/s the drag presses a part of the arm together, by up to 0.26 N. "
        "MoorDyn's lines do not resist compression, and its line does not come to rest."
    )
    return replace(found, remarks=[remark])


@case(
    kind="peer",
    title="An arm that hangs in a steady current comes to rest where CableDyn's cable does.",
    source="CableDyn 0.3.0, run in the case from a straight cable until it is at rest.",
    method=f"Static equilibrium with {MESHES[-1]} nodes; CableDyn with {_SEGMENTS} elements, steps "
    f"of {_TIME_STEP:g} s and 16 s.",
    reason="CableDyn's tips are 0.1 % from the boundary-value problem of hanging-in-current; "
    "crinoid's mesh adds up to a third of an edge squared, 0.02 % of the length.",
    needs=("cabledyn",),
)
def cabledyn_line() -> Evidence:
    from validation.peers.cabledyn import prepare

    found = _at_rest(
        "CableDyn",
        prepare,
        _SPEEDS,
        duration=16.0,
        interval=_TIME_STEP,
        until=16.0,
        within=0.002,
        last=1000,
        still=2e-5,
    )
    remark = "CableDyn has no free end: the tip carries a body of 0.2 kg, as heavy as water."
    return replace(found, remarks=[remark])
