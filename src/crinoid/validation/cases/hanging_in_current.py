"""An arm that hangs in a steady current."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.integrate import solve_bvp

from crinoid.scenario import Scenario
from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.slender import MESHES, order_of, tip_of
from crinoid.view.figures.style import BLUE, INK, key

_LENGTH, _RADIUS, _MODULUS = 0.5, 0.02, 5e5
_SOLID, _WATER, _DRAG, _GRAVITY = 1080.0, 1025.0, 1.1, 9.81
_AREA = np.pi * _RADIUS**2
_EA, _EI = _MODULUS * _AREA, _MODULUS * _AREA * _RADIUS**2 / 4
SPEEDS = (0.1, 0.25, 0.4)
_EDGE = _LENGTH / (MESHES[-1] - 1)


def exact(speed: float) -> Float[np.ndarray, "2 place"]:
    """Return places (m) of a rod that bends and stretches, with weight and drag across it.

    EI theta' = M, M' = -r' x n, n' = -load, r' = (1 + n . t / EA) t, from the clamp to the tip.
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
    return np.asarray(found.y[4:])


def scenario(nodes: int, speed: float) -> Scenario:
    """Return the arm in a current along x."""
    return Scenario().with_values(
        {
            "arm.length": _LENGTH,
            "arm.nodes": nodes,
            "arm.radius": _RADIUS,
            "arm.density": _SOLID,
            "arm.youngs_modulus": _MODULUS,
            "base.tilt_deg": -90.0,
            "base.position": [0.0, -10.0],
            "water.density": _WATER,
            "water.drag_normal": _DRAG,
            "water.drag_tangential": 0.0,
            "water.gravity": _GRAVITY,
            "flow": [{"kind": "uniform", "velocity": [speed, 0.0]}],
        }
    )


def _run() -> Evidence:
    checks, scenarios, shapes = [], {}, []
    errors = np.zeros(len(MESHES))
    for speed in SPEEDS:
        rod = exact(speed)
        end = rod[:, -1]
        for mesh, nodes in enumerate(MESHES):
            result = equilibrium(scenario(nodes, speed))
            tip = tip_of(result) - [0.0, -10.0]
            errors[mesh] += np.hypot(*(tip - end))
        text = f"{speed:g} m/s"
        checks += [
            Check(f"x of the tip, {text}", end[0], tip[0], _EDGE**2 / _LENGTH / 3, "m"),
            Check(f"z of the tip, {text}", end[1], tip[1], _EDGE**2 / _LENGTH / 3, "m"),
        ]
        scenarios[f"{speed:g}"] = scenario(MESHES[-1], speed)
        shapes.append((speed, result.dataset["position"].values[-1] - [0.0, -10.0], rod))
    order = order_of(errors.tolist())
    checks.append(Check("order of convergence", 2.0, order, 0.25))

    def draw(axes: Axes) -> None:
        for speed, shape, rod in shapes:
            axes.plot(*shape.T, color=BLUE, label="crinoid")
            axes.plot(*rod[:, :: rod.shape[1] // 8], "o", mfc="none", color=INK, label="exact")
            axes.text(shape[-1, 0] + 0.01, shape[-1, 1] - 0.01, f"{speed:g} m/s")
        axes.set(xlabel="x (m)", ylabel="z (m)", aspect="equal")
        axes.set_xlim(right=0.35)
        key(axes)

    remarks = (
        "CableDyn 0.3.0 gives x of the tip as 0.0238306, 0.1310578 and 0.2362216 m, 0.1 % more.",
    )
    return Evidence(checks, order, scenarios, draw, remarks)


CASE = Case(
    name="hanging-in-current",
    title="An arm hangs in a steady current that pushes its tip to the side.",
    source="Two-point boundary-value problem of a rod with drag across it, weight and buoyancy, "
    "which the case solves by collocation to 1e-9.",
    method=f"Static equilibrium with {MESHES[-1]} nodes at {', '.join(map(str, SPEEDS))} m/s; the "
    f"order is from {MESHES[0]} and {MESHES[-1]} nodes.",
    reason="The error of the mesh has order 2 in the length of an edge, L/40; the tip is within a "
    "third of an edge squared, over L. The ends add a term of order 3, hence 0.25 on the order.",
    kind="exact",
    run=_run,
)
