"""Solids of files: distances from meshes, heights of beds, and what is refused."""

import re

import numpy as np
import pytest
import trimesh
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.recording.mesh import read_mesh
from crinoid.recording.seabed import read_seabed
from crinoid.recording.signed_distance import Triangles
from crinoid.scenario import Mesh, Scenario, Seabed
from crinoid.view.live.interactive import InteractiveBodies
from helpers.refusals import mistake, refusal

ARM = {"length": 0.5, "nodes": 5, "radius": 0.015}
GRID = {"x": np.linspace(-2.0, 2.0, 21), "y": np.linspace(-1.0, 1.0, 11)}


def scenario(obstacle, dimension=3, **tables) -> Scenario:
    place = {"base": [0.0, 0.0, -10.0], "obstacle": obstacle.get("position", [0.0, 0.0, 0.0])}
    if dimension == 2:
        place = {key: value[::2] for key, value in place.items()}
    base, obstacle = {"position": place["base"]}, obstacle | {"position": place["obstacle"]}
    return Scenario(arm=ARM | {"dimension": dimension}, base=base, obstacle=[obstacle], **tables)


def read(path, dimension=3, **keys):
    table = {"kind": "mesh", "file": str(path), "position": [0.3, 0.0, -10.3]} | keys
    case = scenario(table, dimension)
    (obstacle,) = case.obstacle
    assert isinstance(obstacle, Mesh)
    return read_mesh(obstacle, case)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "cache"))


@pytest.fixture
def rock(tmp_path):
    path = tmp_path / "rock.stl"
    trimesh.creation.icosphere(subdivisions=3, radius=0.1).export(path)
    return path


def test_a_scenario_with_the_same_solids_needs_no_file_again(rock):
    table = {"kind": "mesh", "file": str(rock), "position": [0.3, 0.0, -10.3]}
    prepared = Prepared(scenario(table))
    read = prepared.surfaces
    rock.unlink()
    shorter = prepared.with_scenario(scenario(table, simulation={"duration": 1.0}))
    assert shorter.surfaces is read
    assert shorter.digests[str(rock)]
    coarser = prepared.with_scenario(scenario(table | {"spacing": 0.02}))
    assert mistake(lambda: coarser.surfaces).endswith(": no such file")


# --- meshes ------------------------------------------------------------------------------------


def test_signed_distances_of_a_box_are_exact():
    sides = np.array([0.2, 0.1, 0.15])
    box = trimesh.creation.box(sides)
    triangles = Triangles(np.asarray(box.triangles), np.asarray(box.face_normals))
    axes = [np.linspace(-0.1 - s / 2, 0.1 + s / 2, 12) for s in sides]
    found = triangles.on_grid(axes, within=0.06)
    apart = np.abs(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)) - sides / 2
    outside = np.linalg.norm(np.maximum(apart, 0), axis=-1)
    wanted = outside + np.minimum(apart.max(axis=-1), 0)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_the_side_is_right_in_a_ring_with_a_hole():
    ring = trimesh.creation.torus(0.1, 0.03, major_sections=48, minor_sections=24)
    triangles = Triangles(np.asarray(ring.triangles), np.asarray(ring.face_normals))
    axes = [np.linspace(-0.16, 0.16, 17) for _ in range(3)]
    found = triangles.on_grid(axes, within=0.05)
    x, y, z = np.meshgrid(*axes, indexing="ij")
    wanted = np.hypot(np.hypot(x, y) - 0.1, z) - 0.03
    clear = np.abs(wanted) > 1e-3  # the sides of the polygons
    np.testing.assert_array_equal(np.sign(found)[clear], np.sign(wanted)[clear])
    np.testing.assert_allclose(found, wanted, atol=1e-3)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_ball_as_a_mesh_has_the_distances_of_a_ball(rock, dimension):
    found = read(rock, dimension)
    assert not found.notes
    places = np.random.default_rng(1).normal(size=(200, dimension))
    places *= np.linspace(0.09, 0.12, 200)[:, None] / np.linalg.norm(places, axis=1, keepdims=True)
    wanted = np.linalg.norm(places, axis=1) - 0.1
    # sides of the polyhedron lie up to 0.5 mm inside
    np.testing.assert_allclose(found.spline.at(places), wanted, atol=6e-4)
    again = read(rock, dimension)
    np.testing.assert_array_equal(again.spline.coefficients, found.spline.coefficients)


def apart(visual):
    """Return a box whose faces share no corner, as files with a texture or normals have them."""
    box = trimesh.creation.box([0.2, 0.2, 0.2])
    corners = np.asarray(box.triangles).reshape(-1, 3)
    about = {"vertex_normals": np.repeat(box.face_normals, 3, axis=0)}
    if visual == "texture":
        uv = np.random.default_rng(0).random((len(corners), 2))
        about = {"visual": trimesh.visual.TextureVisuals(uv=uv)}
    faces = np.arange(len(corners)).reshape(-1, 3)
    return trimesh.Trimesh(corners, faces, process=False, **about)


@pytest.mark.parametrize("ending", ["obj", "glb", "ply", "stl"])
@pytest.mark.parametrize("visual", ["texture", "normals"])
def test_corners_of_each_face_belong_to_one_closed_surface(tmp_path, ending, visual):
    path = tmp_path / f"box.{ending}"
    apart(visual).export(path)
    found = read(path, spacing=0.02).spline.at(np.array([[0.0, 0.0, 0.0], [0.12, 0.0, 0.0]]))
    assert found[0] < -0.05
    assert found[1] == pytest.approx(0.02, abs=1e-4)


BOX, NEAR = trimesh.creation.box([0.2, 0.2, 0.2]), np.array([0.5, 0.0, 0.0])
BODIES = {
    "two": (BOX, BOX.copy().apply_translation(NEAR), [-1, 1, -1]),
    "touching": (BOX, BOX.copy().apply_translation([0.2, 0.2, 0.0]), [-1, 1, 1]),
    "a hollow": (BOX, trimesh.creation.icosphere(2, 0.06), [1, 1, 1]),
}


@pytest.mark.parametrize("turned", [(), (0,), (1,), (0, 1)])
@pytest.mark.parametrize(("first", "second", "signs"), BODIES.values(), ids=BODIES)
def test_each_body_of_a_mesh_has_its_inside(tmp_path, first, second, signs, turned):
    bodies = [first.copy(), second.copy()]
    for index in turned:
        bodies[index].invert()
    trimesh.util.concatenate(bodies).export(tmp_path / "two.stl")
    found = read(tmp_path / "two.stl", spacing=0.02)
    places = np.array([[0.0, 0.0, 0.0], 0.5 * NEAR, NEAR])
    np.testing.assert_array_equal(np.sign(found.spline.at(places)), signs)
    # a hollow points inward, and a file that is inside out as a whole needs no note
    odd = len(turned) == 1 if signs[0] < 0 else turned in ((), (0, 1))
    assert any("inside out and are turned" in note for note in found.notes) == odd


@pytest.mark.parametrize(
    ("tables", "clear"), [({}, 0.03), ({"tool": {"mass": 0.1, "radius": 0.06}}, 0.08)]
)
def test_distances_are_exact_as_far_as_the_largest_body_reaches(rock, tables, clear):
    table = {"kind": "mesh", "file": str(rock), "position": [0.3, 0.0, -10.3]}
    case = scenario(table, 2, **tables)
    found = read_mesh(case.obstacle[0], case).spline.at(np.array([[0.1 + clear, 0.0]]))
    reach = case.tool.radius if tables else 0.015
    assert found[0] > min(clear, 1.1 * reach) - 6e-4


@pytest.mark.slow
def test_scale_turns_and_the_upward_axis_of_a_format(tmp_path):
    box = trimesh.creation.box([400.0, 100.0, 200.0])
    for name in ("box.ply", "box.obj", "box.glb"):
        box.export(tmp_path / name)
    for name in ("box.ply", "box.obj"):
        sides = np.ptp(read(tmp_path / name, scale=1e-3).points, axis=0)
        np.testing.assert_allclose(sides, [0.4, 0.1, 0.2], rtol=1e-6)
    up = np.ptp(read(tmp_path / "box.glb", scale=1e-3).points, axis=0)
    np.testing.assert_allclose(up, [0.4, 0.2, 0.1], rtol=1e-6)  # y of the file is z of the world
    turned = np.ptp(read(tmp_path / "box.ply", scale=1e-3, tilt_deg=90.0).points, axis=0)
    np.testing.assert_allclose(turned, [0.2, 0.1, 0.4], rtol=1e-6)


def test_a_note_says_how_much_a_coarse_grid_rounds(tmp_path):
    path = tmp_path / "comb.stl"
    teeth = [trimesh.creation.box([0.01, 0.1, 0.1]) for _ in range(4)]
    for index, tooth in enumerate(teeth):
        tooth.apply_translation([0.05 * index, 0, 0])
    trimesh.util.concatenate(teeth).export(path)
    (note,) = read(path, spacing=0.02).notes
    assert "rounded by up to" in note
    assert "on a grid of 20 mm" in note


@pytest.mark.parametrize(
    ("name", "dimension", "keys", "line"),
    [
        ("none", 3, {}, "no such file"),
        ("hollow", 3, {}, "hollow.stl has holes.* a closed surface. Repair it"),
        ("text", 3, {}, "text.stl"),
        ("rock", 3, {"scale": 1000.0, "spacing": 0.01}, "must be at least 0.7.* Set scale = 0.001"),
        ("aside", 2, {}, "is at y = 0.4 to 0.6 m; must meet the plane of the arm, y = 0"),
    ],
)
def test_a_mesh_that_does_not_fit_is_refused_in_one_line(rock, name, dimension, keys, line):
    hollow, aside = trimesh.load_mesh(rock), trimesh.load_mesh(rock)
    hollow.update_faces(np.arange(len(hollow.faces)) > 20)
    hollow.export(rock.with_name("hollow.stl"))
    aside.apply_translation([0.0, 0.5, 0.0])
    aside.export(rock.with_name("aside.stl"))
    rock.with_name("text.stl").write_text("nothing")
    file = str(rock.with_name(f"{name}.stl"))
    table = {"kind": "mesh", "file": file, "position": [0.3, 0.0, -10.3]} | keys
    said = refusal(scenario(table, dimension))
    assert re.search(line, said), said


# --- beds --------------------------------------------------------------------------------------


def bathymetry(tmp_path, values, name="z", coordinates=None, **attributes):
    path = tmp_path / "bed.nc"
    coordinates = GRID if coordinates is None else coordinates
    variable = tuple(coordinates), values, {"units": "m"} | attributes
    xr.Dataset({name: variable}, coordinates).to_netcdf(path)
    return {"kind": "seabed", "file": str(path), "height": name}


def heights(case):
    (obstacle,) = case.obstacle
    assert isinstance(obstacle, Seabed)
    return read_seabed(obstacle, case)


def test_heights_and_depths_are_the_same_bed(tmp_path):
    slope = -11.0 + 0.1 * GRID["x"][:, None] - 0.2 * GRID["y"]
    up = heights(scenario(bathymetry(tmp_path, slope)))
    places = np.array([[0.33, -0.41], [-1.9, 0.9], [0.0, 0.0], [5.0, 0.0]])
    wanted = [-10.885, -11.37, -11.0, -10.8]  # the last at the edge
    # the bend at the ends of the heights is rounded within a step of them
    np.testing.assert_allclose(up.spline.at(places), wanted, atol=0.006)
    np.testing.assert_allclose(up.spline.at(places[[0, 2]]), [-10.885, -11.0], atol=3e-5)
    down = heights(scenario(bathymetry(tmp_path, -100 * slope, "depth", units="cm")))
    np.testing.assert_allclose(down.spline.at(places), up.spline.at(places), atol=1e-9)
    profile = heights(scenario(bathymetry(tmp_path, slope), 2))
    np.testing.assert_allclose(profile.spline.at(places[::2, :1]), [-10.967, -11.0], atol=3e-5)


SURE, TAKEN, NEGATIVE = None, "is taken as a", "is negative and is taken as a height"
NAMES = {
    ("depth", 1): SURE, ("deptho", 1): SURE, ("elevation", -1): SURE, ("altitude", -1): SURE,
    ("z", -1): SURE, ("z", 1): TAKEN, ("h", 1): TAKEN, ("h", -1): SURE, ("Bathymetry", 1): TAKEN,
    ("bathymetry", -1): SURE, ("Band1", 1): TAKEN, ("depth", -1): NEGATIVE,
}  # fmt: skip


@pytest.mark.parametrize(("name", "sign"), NAMES)
def test_a_bed_is_below_the_arm_by_any_name(tmp_path, name, sign):
    found = heights(scenario(bathymetry(tmp_path, np.full((21, 11), sign * 11.0), name)))
    assert found.spline.at(np.zeros((1, 2))) == pytest.approx(-11.0)
    note = NAMES[name, sign]
    assert len(found.notes) == (note is not None)
    assert all(note in each for each in found.notes)


@pytest.mark.parametrize(
    ("about", "sign"),
    [
        ({"standard_name": "sea_floor_depth_below_geoid"}, 1),
        ({"standard_name": "sea_floor_depth_below_mean_sea_level"}, 1),
        ({"standard_name": "height_above_geoid"}, -1),
        ({"positive": "down"}, 1),
        ({"positive": "up"}, -1),
    ],
)
def test_attributes_of_a_bed_say_where_it_is(tmp_path, about, sign):
    found = heights(scenario(bathymetry(tmp_path, np.full((21, 11), sign * 11.0), "a", **about)))
    assert found.spline.at(np.zeros((1, 2))) == pytest.approx(-11.0)
    assert found.notes == ()


@pytest.mark.parametrize("dimension", [2, 3])
def test_debris_is_parked_above_a_bed(tmp_path, dimension):
    case = scenario(bathymetry(tmp_path, np.full((21, 11), -11.0)), dimension)
    debris = InteractiveBodies.suited_to(case, Prepared(case).surfaces).debris
    assert debris.parked[-1] > -11.0 + debris.radius


FLAT = np.full((21, 11), -11.0)
GAP = np.where(np.arange(11) == 3, np.nan, FLAT)
ROUND = GRID | {"x": ("x", GRID["x"], {"units": "degrees_east"})}


@pytest.mark.parametrize(
    ("values", "coordinates", "keys", "line"),
    [
        (GAP, GRID, {}, "z has 21 missing values"),
        (FLAT, GRID, {"height": "h"}, 'got "h", no such variable in bed.nc'),
        (FLAT, GRID, {"position": [9.0, 0.0, 0.0]}, "x = -2 to 2 m; must contain the base"),
        (FLAT, GRID | {"x": GRID["x"] ** 3}, {}, "have even steps"),
        (FLAT, ROUND, {}, "Project longitudes and latitudes to m first"),
        (FLAT[:, 0], {"x": GRID["x"]}, {}, "have those of x and y"),
    ],
)
def test_a_bed_that_does_not_fit_is_refused_in_one_line(tmp_path, values, coordinates, keys, line):
    table = bathymetry(tmp_path, values, coordinates=coordinates) | keys
    assert line in refusal(scenario(table))


def test_a_bed_above_the_arm_overlaps_it(tmp_path):
    case = scenario(bathymetry(tmp_path, np.full((21, 11), -9.9)))
    with pytest.raises(ValueError, match="overlaps the arm without load by 115 mm"):
        Prepared(case).check()
