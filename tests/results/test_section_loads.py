"""Bending moment and shear force along the arm: they balance all forces beyond a section."""

import numpy as np
import pytest

import crinoid

FORCE = {2: np.array([0.0, 0.3]), 3: np.array([0.0, 0.18, 0.24])}
BOTH = pytest.mark.parametrize("dimension", [2, 3])
NODES, LENGTH, WATER = 9, 0.5, 1025.0


def at_rest(dimension, force, weight):
    """Return an arm of a weight in water (N/m), half of it a load, with a force at its tip."""
    down = [0.0] * (dimension - 1) + [-1.0]
    keys = {
        "arm.dimension": dimension,
        "arm.nodes": NODES,
        "arm.length": LENGTH,
        "arm.density": WATER + weight / 2 / (9.81 * np.pi * 0.02**2),
        "water.density": WATER,
        "water.gravity": 9.81,
        "load": [
            {"kind": "tip", "force": force.tolist()},
            {"kind": "distributed", "direction": down, "magnitude": weight / 2},
        ],
    }
    return crinoid.equilibrium(crinoid.Scenario().with_values(keys)).dataset.isel(time=0)


def in_section(vectors, data):
    """Return vectors on the edges along m_1 and m_2; in the plane across the edge."""
    tangent = data["tangent"].values
    if tangent.shape[1] == 2:
        return vectors[:, 1] * tangent[:, 0] - vectors[:, 0] * tangent[:, 1]
    first = data["director"].values
    sides = first, np.cross(tangent, first)
    return np.stack([np.sum(vectors * side, axis=1) for side in sides], axis=1)


def as_bending(moments, data):
    """Return moments on the edges, right-handed in space, as they bend the arm."""
    if moments.ndim == 1:
        return moments
    about = in_section(moments, data)
    return np.stack([about[:, 1], -about[:, 0]], axis=1)


def turning(arm, force):
    if arm.shape[1] == 2:
        return arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
    return np.cross(arm, force)


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize(("share", "weight"), [(1e-4, 0.0), (1.0, 0.0), (0.3, 1.5)])
def test_sections_carry_all_forces_beyond_them(dimension, share, weight):
    tip = share * FORCE[dimension]
    data = at_rest(dimension, tip, weight)
    place = data["position"].values
    force = np.zeros_like(place)
    force[1:, -1] = -weight * LENGTH / (NODES - 1)
    force[-1] = force[-1] / 2 + tip
    beyond = np.cumsum(force[::-1], axis=0)[::-1]
    about = np.array([turning(place - place[i], force)[i + 1 :].sum(axis=0) for i in range(NODES)])
    found = data["bending_moment"].values
    bending = as_bending(about[:-1], data)
    np.testing.assert_allclose(found[:-1], bending, rtol=0, atol=1e-7 * np.abs(about).max())
    assert not found[-1].any()
    shear, size = in_section(beyond[1:], data), np.abs(beyond).max()
    np.testing.assert_allclose(data["shear_force"], shear, rtol=0, atol=1e-7 * size)
    base = np.broadcast_to(data["base_moment"].values, about[:-1].shape)
    np.testing.assert_allclose(found[0], as_bending(base, data)[0], rtol=0, atol=1e-14)
    if share < 1e-3:  # F (L - s) and F
        exact = 0.3 * share * (LENGTH - data["arc_length"].values)
        sizes = [np.linalg.norm(np.atleast_2d(x.T), axis=0) for x in (found, shear)]
        np.testing.assert_allclose(sizes[0], exact, rtol=1e-4, atol=1e-12)
        np.testing.assert_allclose(sizes[1], 0.3 * share, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["curl", "octopus-3d"])
def test_the_moment_at_the_root_is_that_on_the_base_with_chambers(name):
    data = crinoid.simulate(crinoid.load(name, ["simulation.duration=0.3"])).dataset
    base = data["base_moment"].values
    if base.ndim == 2:
        first = data.isel(edge=slice(0, 1))
        base = np.stack([as_bending(m[None], first.isel(time=i))[0] for i, m in enumerate(base)])
    assert np.abs(base).max() > 1e-4
    np.testing.assert_allclose(data["bending_moment"].values[:, 0], base, rtol=0, atol=1e-14)
