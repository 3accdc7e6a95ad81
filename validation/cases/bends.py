"""A straight cantilever that a load at its tip or along its length bends far."""

from functools import partial

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from crinoid.view.figures.style import BLUE, VERMILLION
from validation.case import Evidence, case
from validation.elastica import PlanarEnd, Vector, elastica
from validation.slender import (
    BY_MESHES,
    EDGE,
    MESHES,
    PLACE,
    KnownBend,
    TipMeasure,
    bent,
    slender_arm,
)


def _modulus(angle: float) -> tuple[float, float]:
    """Return parameter m = k^2 and amplitude at the clamp, for a slope at the tip (rad)."""
    m = (1.0 + np.sin(angle)) / 2.0
    return m, float(np.arcsin(np.sqrt(0.5 / m)))


def exact(load: float) -> Float[np.ndarray, "3"]:
    """Return angle (rad), drop and shortening over L for a load P L^2 / EI."""

    def excess(angle: float) -> float:
        m, start = _modulus(angle)
        return float((ellipk(m) - ellipkinc(start, m)) ** 2 - load)

    angle = brentq(excess, 1e-6, np.pi / 2 - 1e-9, xtol=1e-14)
    m, start = _modulus(angle)
    drop = 1.0 - 2.0 * (ellipe(m) - ellipeinc(start, m)) / np.sqrt(load)
    return np.array([angle, drop, 1.0 - np.sqrt(2.0 * np.sin(angle) / load)])


_FALL = {
    "drop": TipMeasure(lambda tip: -tip.z),
    "shortening": TipMeasure(lambda tip: 1.0 - tip.x),
}


@case(
    kind="exact",
    title="A horizontal cantilever bends far under a dead load P at its tip, P L^2/EI = 1 to 10.",
    source="Elliptic integrals of Mattiasson 1981, Int. J. Numer. Methods Eng. 17, 145-153, by "
    "SciPy.",
    method=BY_MESHES,
    reason="Order 2 in the edge L/40: the tip is within a third of an edge squared, its "
    "extrapolated angle within an edge squared. The ends add a term of order 3: 0.25 on the order.",
)
def tip_load() -> Evidence:
    bends = []
    for load in (1.0, 2.0, 5.0, 10.0):
        angle, drop, shortening = exact(load)
        end = PlanarEnd(1.0 - shortening, -drop, -angle, np.nan)
        arm = partial(slender_arm, values={"load.0.force": [0.0, -load]})
        bends.append(KnownBend(f"{load:g}", f"P = {load:g}", arm, end, EDGE**2 / 3, f"{load:g}"))
    return bent(bends, {"angle": TipMeasure(lambda tip: -tip.angle, "rad", 3.0), **_FALL})


@case(
    kind="exact",
    title="A horizontal cantilever hangs under its own weight w per length, w L^3/EI = 1 to 10.",
    source="Inextensible elastica, EI theta'' = w (L - s) cos theta, by shooting to 1e-12.",
    method=BY_MESHES,
    reason="Order 2 in the edge L/40: the tip is within a third of an edge squared. The ends add "
    "a term of order 3: 0.25 on the order.",
)
def own_weight() -> Evidence:
    bends = []
    for weight in (1.0, 5.0, 10.0):
        load = partial(_along, "dead", -weight)
        end = elastica((-np.pi / 2 + 1e-9, -0.05), distributed=load)
        arm = partial(slender_arm, values={"water.gravity": weight})
        bends.append(
            KnownBend(f"{weight:g}", f"w = {weight:g}", arm, end, EDGE**2 / 3, f"{weight:g}")
        )
    return bent(bends, _FALL)


def _along(kind: str, load: float, angle: float) -> Vector:
    """Return a load per length by the direction of the rod."""
    return (0.0, load) if kind == "dead" else (-load * np.sin(angle), load * np.cos(angle))


@case(
    kind="exact",
    title="A load w per length bends a cantilever, w L^3/EI = 1 to 25.",
    source="Inextensible elastica, EI theta'' = t x n, n' = -w, by shooting to 1e-12; loads of "
    "PyElastica's cantilevers under a distributed load.",
    method=BY_MESHES,
    reason="The load on an edge l changes the moment by w l^2/12, hence the slope by at most w L "
    "l^2/(12 EI). The ends add a term of order 3: 0.25 on the order.",
)
def distributed_load() -> Evidence:
    bends = []
    # a dead load turns the tip by less than a right angle, the follower by up to 3.03 rad
    for kind, way, colour, highest, loads in (
        ("dead", [0.0, 1.0], BLUE, np.pi / 2 - 1e-9, (1.0, 5.0, 9.0, 15.0, 25.0)),
        ("follower", "normal", VERMILLION, 3.5, (1.0, 3.0, 5.0, 9.0, 13.0, 25.0)),
    ):
        for load in loads:
            end = elastica((0.01, highest), distributed=partial(_along, kind, load))
            table = {"kind": "distributed", "direction": way, "magnitude": load}
            bend = KnownBend(
                f"{kind}-{load:g}",
                f"{kind} {load:g}",
                partial(slender_arm, values={"load": [table]}),
                end,
                EDGE**2 / 12 * load,
                colour=colour,
                name=f"crinoid, {kind}",
            )
            bends.append(bend)
    return bent(bends, PLACE)


@case(
    kind="exact",
    title="A moment 2 pi EI/L at the tip closes a straight cantilever to a circle.",
    source="Euler's elastica: M = EI kappa, the same along the arm.",
    method=f"Static equilibrium with {MESHES[-1]} nodes under a moment and half of it; the order "
    f"is from {MESHES[0]} and {MESHES[-1]} nodes.",
    reason="Corners lie on a wider circle and the clamp ends half an edge early: with N = 40 "
    "edges the tip is off by pi/(6 N^2) L = 3.3e-4 L, of order 2.",
)
def end_moment() -> Evidence:
    bends = []
    for turns in (0.5, 1.0):
        angle = 2.0 * np.pi * turns
        # after whole or half turns the sine of the angle is 0
        end = PlanarEnd(0.0, (1.0 - np.cos(angle)) / angle, angle, np.nan)
        arm = partial(slender_arm, values={"load.0.moment": angle})
        along = angle * np.linspace(0.0, 1.0, 13)
        circle = np.array([np.sin(along), 1.0 - np.cos(along)]) / angle
        bends.append(KnownBend(f"{turns:g}", f"{turns:g} turn", arm, end, 1e-3, points=circle))
    return bent(bends, PLACE | {"angle": TipMeasure(lambda tip: tip.angle, "rad")}, 0.1)
