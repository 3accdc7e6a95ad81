"""Runs onto solids from files end as those onto the round obstacles and planes that they are."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
import xarray as xr

import crinoid
from crinoid.scenario import Scenario
from helpers.arms import QUICKLY

ARM = {"length": 0.5, "nodes": 6, "radius": 0.015, "density": 1300.0, "youngs_modulus": 5e5}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("solids")
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    ball.apply_translation([0.0, 0.0, 0.25])
    ball.export(path / "ball.ply")
    x, y = np.linspace(-1, 1, 21), np.linspace(-1, 1, 11)
    heights = -10.08 + 0.1 * x[:, None] + 0.0 * y
    xr.Dataset({"z": (("x", "y"), heights, {"units": "m"})}, {"x": x, "y": y}).to_netcdf(
        path / "bed.nc"
    )
    return path


SMALL = {"mass": 1e-3, "volume": 1e-6, "offset": 0.03, "radius": 0.005}
"""A tool that touches nothing before the arm does: with any tool a run is the same program."""


def landed(dimension, obstacle, **tool):
    """Return the end of a run in which a body rises below a level arm with a tool."""
    obstacle = dict(obstacle)
    place = {"base": [0.0, 0.0, -10.0]}
    place |= {key: obstacle[key] for key in ("position", "normal", "velocity") if key in obstacle}
    if dimension == 2:
        place = {key: value[::2] for key, value in place.items()}
    base = {"position": place.pop("base")}
    case = Scenario(
        arm=ARM | {"dimension": dimension, "damping_time": 0.05},
        base=base,
        obstacle=[obstacle | place],
        simulation={"duration": 0.3, "start": "rest"},
        tool=SMALL | tool,
    )
    result = crinoid.simulate(case)
    assert result.status == "ok"
    return result.dataset


BALL = {"position": [0.38, 0.0, -10.13], "velocity": [0.0, 0.0, 0.1], "friction": 0.3}
MESH = BALL | {"kind": "mesh", "file": "ball.ply", "position": [0.38, 0.0, -10.38]}
BED = {"position": [0.0, 0.0, 0.0], "velocity": [0.0, 0.0, 0.1], "friction": 0.3}
PLANE = BED | {"kind": "plane", "position": [0.0, 0.0, -10.08], "normal": [-0.1, 0.0, 1.0]}
BED |= {"kind": "seabed", "file": "bed.nc", "height": "z"}


SPHERE = BALL | {"kind": "sphere", "radius": 0.1}


@pytest.mark.release
@pytest.mark.parametrize(("solid", "known", "dimension"), [(MESH, SPHERE, 2), (BED, PLANE, 3)])
def test_a_solid_from_a_file_lifts_the_arm_as_what_it_is(folder, solid, known, dimension):
    exact = landed(2, known)
    assert float(exact["contact_impulse"][-1, 0, -1]) > 0.1
    found = landed(dimension, solid | {"file": str(folder / solid["file"])})
    tip, force = (found[name].values[-1] for name in ("tip_position", "contact_impulse"))
    tip, force = tip[[0, -1]], force[0, [0, -1]]
    # the sides of the polyhedron are up to 0.2 mm inside of the ball
    np.testing.assert_allclose(tip, exact["tip_position"].values[-1], atol=4e-4)
    scale = float(exact["contact_impulse"][-1, 0, -1])
    np.testing.assert_allclose(force, exact["contact_impulse"].values[-1, 0], atol=0.02 * scale)
    assert set(found["facet_obstacle"].values) == {0}
    assert found["surface_facet"].values.max() == found.sizes["surface_vertex"] - 1


def moved(solid, x, z):
    """Return an obstacle at another place."""
    return solid | {"position": [solid["position"][0] + x, 0.0, solid["position"][2] + z]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("solid", "known", "by", "dimension"),
    [(MESH, SPHERE, (0.14, -0.005), 2), (BED, PLANE, (0.0, -0.03), 3)],
)
def test_a_solid_from_a_file_lifts_the_tool_as_what_it_is(folder, solid, known, by, dimension):
    solid = moved(solid, *by) | {"file": str(folder / solid["file"])}
    tool = {"mass": 0.2, "volume": 1e-4, "offset": 0.03, "radius": 0.03}
    exact = landed(2, moved(known, *by), **tool)
    found = landed(dimension, solid, **tool)
    # with a small tool the arm alone meets it, later
    bare = landed(2, moved(known, *by))
    wanted = exact["contact_impulse"].values[-1, 0]
    assert wanted[1] > 2 * float(bare["contact_impulse"][-1, 0, 1])
    np.testing.assert_allclose(
        found["contact_impulse"].values[-1, 0, [0, -1]], wanted, atol=0.02 * wanted[1]
    )
    np.testing.assert_allclose(
        found["tip_position"].values[-1, [0, -1]], exact["tip_position"].values[-1], atol=4e-4
    )


@eqx.filter_jit(compiler_options=QUICKLY)
def rolled(system):
    """Return places and spins of bodies after 60 steps, and whether all of these converged.

    A whole run compiles far more.
    """

    def one(state, _):
        state, progress = system.advance(state, jnp.zeros(len(system.inputs)))
        return state, progress.outcome.converged

    end, good = jax.lax.scan(one, system.rest(), length=60)
    return end.obstacle_position, end.motion.velocity[system.forces.rows.rotations], good.all()


@pytest.mark.release
def test_free_bodies_roll_down_a_bed_from_a_file_as_down_a_plane(folder):
    rolling = {"kind": "sphere", "radius": 0.05, "mass": 2.0, "friction": 0.5}
    rolling["position"] = [0.0, -10.08 + 0.05 * np.hypot(1.0, 0.1) - 1e-4]
    lying = {"kind": "capsule", "radius": 0.03, "mass": 2.0, "length": 0.1, "axis": [1.0, 0.0, 0.1]}
    lying["position"] = [-0.5, -10.13 + 0.03 * np.hypot(1.0, 0.1) - 1e-4]
    ends = []
    for under in (
        {"kind": "plane", "position": [0.0, -10.08], "normal": [-0.1, 1.0]},
        BED | {"file": str(folder / "bed.nc"), "position": [0.0, 0.0], "velocity": [0.0, 0.0]},
    ):
        case = Scenario(
            arm={"nodes": 4, "length": 0.1},
            base={"position": [0.0, -9.0]},
            obstacle=[rolling, lying, under | {"friction": 0.2}],
            simulation={"time_step": 0.01},
        )
        *end, good = rolled(crinoid.system(case))
        assert good
        ends.append(end)
    (place, spin), _ = ends
    assert float(place[0, 0]) < -0.02
    assert float(spin[0, 0]) > 0.4
    for found, exact in zip(*ends, strict=True):
        np.testing.assert_allclose(found[:2], exact[:2], atol=1e-5)
