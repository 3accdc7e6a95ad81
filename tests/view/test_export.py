"""Exports as others read them: ParaView's reader, pandas, a reader of glTF, the library of USD."""

import csv
import re
import shutil
import sys
import zipfile
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pygltflib
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOHDF import vtkHDFReader

from crinoid.cli.folder import clear_figures
from crinoid.cli.interruption import Interrupted
from crinoid.results.own_files import is_own
from crinoid.results.result import Result
from crinoid.results.scene.bodies import rigid_bodies
from crinoid.results.scene.data import in_space
from crinoid.results.scene.mesh import BodyShape
from crinoid.results.scene.scene import build_scene
from crinoid.scenario import ScenarioError
from crinoid.view.export import write_export
from crinoid.view.export.vtkhdf import KINDS
from helpers.command import call, refused, succeeded
from helpers.planar_result import among_obstacles as planar_obstacles
from helpers.planar_result import swaying_arm
from helpers.spatial_result import among_obstacles, among_solids, curling_arm
from helpers.studies import save

SMALL = {"records": 5, "duration": 2.0, "nodes": 7}
TOOL = "[tool]\nmass = 0.2\nvolume = 5e-5\noffset = 0.03\n"


def with_tool(data):
    """Let the tip take a tool up halfway."""
    data = data.assign(tool_held=("time", 1.0 * (np.arange(data.sizes["time"]) >= 2)))
    return data.assign_attrs(scenario=data.attrs["scenario"] + TOOL)


RUNS = {
    "planar": lambda: swaying_arm(**SMALL),
    "planar, obstacles": lambda: planar_obstacles(**SMALL),
    "spatial": lambda: curling_arm(**SMALL, moving_target=True),
    "spatial, obstacles, tool": lambda: with_tool(among_obstacles(**SMALL)),
    "solids, a hull": lambda: among_solids(**SMALL),
    "one instant": lambda: curling_arm(records=1, duration=0.0, nodes=4),
}


@pytest.fixture(params=RUNS, ids=str)
def run(request, tmp_path):
    data = RUNS[request.param]()
    return save(data, tmp_path / "result.nc"), data


@pytest.fixture
def planar(tmp_path):
    """Return the file of a small run in the plane, in a folder without anything else."""
    return save(swaying_arm(**SMALL), tmp_path / "result.nc")


def opened(path):
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    key = vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    # of a single instant the reader tells no time
    return reader, reader.GetOutputInformation(0).Get(key) or (0.0,)


def arrays(group):
    """Arrays of points, cells or the whole by name."""
    names = [group.GetArrayName(number) for number in range(group.GetNumberOfArrays())]
    return {name: vtk_to_numpy(group.GetArray(name)).copy() for name in names}


def test_an_unknown_format_and_an_option_without_use_are_refused(planar, tmp_path):
    for options, answer in {
        ("glft",): "did you mean gltf",
        ("gltf", "nodes"): "--nodes: needs --to csv or xlsx. Leave it out with --to gltf",
        ("onnx", "nodes"): "--nodes: needs --to csv or xlsx. Leave it out with --to onnx",
    }.items():
        with pytest.raises(ScenarioError, match=answer):
            write_export(planar, tmp_path, options[0], **{key: [0] for key in options[1:]})
    assert list(tmp_path.iterdir()) == [planar]


# For ParaView.


def test_paraviews_reader_finds_the_arm_as_the_result_has_it(run, tmp_path):
    path, data = run
    written = write_export(path, tmp_path, "vtkhdf")
    names = ["result.vtkhdf", "result-surroundings.vtkhdf"]
    assert ([file.name for file in written.files], written.notes) == (names, [])
    reader, times = opened(written.files[0])
    assert times == pytest.approx(data["time"].values, abs=0.0)
    bent, edges = data["curvature"].values, data["tension"].values
    vectors = ("position", "velocity", "acceleration", "flow_velocity", "tip_target")
    position, *moving, target = (in_space(data, name) for name in vectors)
    for record, time in enumerate(times):
        reader.UpdateTimeStep(time)
        arm = reader.GetOutputDataObject(0)
        assert (arm.GetNumberOfLines(), arm.GetNumberOfCells()) == (1, 1)
        line = [arm.GetCell(0).GetPointId(place) for place in range(arm.GetNumberOfPoints())]
        assert line == list(range(data.sizes["node"]))
        points = vtk_to_numpy(arm.GetPoints().GetData())
        np.testing.assert_array_equal(points, position[record])
        found = arrays(arm.GetPointData())
        for name, values in zip(vectors[1:], moving, strict=False):
            np.testing.assert_array_equal(found[name], values[record])
        np.testing.assert_array_equal(found["radius"], data["diameter"].values / 2)
        whole = np.linalg.norm(bent[record], axis=-1) if bent.ndim == 3 else bent[record]
        np.testing.assert_allclose(found["curvature"], whole, rtol=1e-15)
        between = (edges[record, 1:] + edges[record, :-1]) / 2
        np.testing.assert_allclose(found["tension"][1:-1], between)
        np.testing.assert_allclose(found["tension"][[0, -1]], edges[record, [0, -1]])
        np.testing.assert_allclose(np.linalg.norm(found["tangent"], axis=1), 1.0, rtol=1e-12)
        if bent.ndim == 3:
            np.testing.assert_array_equal(found["curvature_kappa_2"], bent[record, :, 1])
            assert found["twist"].shape == (data.sizes["node"],)
        whole = arrays(arm.GetFieldData())
        assert whole["tip_error"] == data["tip_error"].values[record]
        np.testing.assert_array_equal(whole["tip_target"][0], target[record])
        assert whole["energy_elastic"] == data["energy"].sel(kind="elastic").values[record]


def test_things_about_the_arm_move_as_surfaces(run, tmp_path):
    path, data = run
    files = write_export(path, tmp_path, "vtkhdf").files
    reader, times = opened(files[1])
    scene = build_scene(Result(data), 99, 99)
    things = rigid_bodies(scene, scene.members[0])
    for record, time in enumerate(times):
        reader.UpdateTimeStep(time)
        around = reader.GetOutputDataObject(0)
        points = vtk_to_numpy(around.GetPoints().GetData())
        cells = vtk_to_numpy(around.GetPolys().GetConnectivityArray()).reshape(-1, 3)
        found = arrays(around.GetCellData())
        assert {KINDS[kind] for kind in found["kind"]} == {each.kind for each in things}
        if "obstacle_position" in data:
            number = [each.name for each in things].index("obstacle 0")
            first = points[np.unique(cells[found["thing"] == number])]
            place = in_space(data, "obstacle_position")[record, 0]
            apart = np.linalg.norm(first - place, axis=1)
            np.testing.assert_allclose(apart, apart[0], rtol=1e-4)


def test_notes_name_numbers_that_are_not_finite(tmp_path):
    data = swaying_arm(**SMALL)
    data["position"][3] = 1e200
    data["acceleration"][1, 2] = np.inf
    path = save(data.assign_attrs(status="failed at t = 2 s; try less"), tmp_path / "result.nc")
    files, notes = (written := write_export(path, tmp_path, "vtkhdf")).files, written.notes
    assert notes == [
        "the run was not completed (failed at t = 2 s; try less)",
        "1 instant is left out: at it a number is not finite, or too large",
        "numbers that are not finite stay so in acceleration",
    ]
    assert opened(files[0])[1] == pytest.approx(data["time"].values[[0, 1, 2, 4]], abs=0.0)
    assert write_export(path, tmp_path, "gltf").notes == notes[:2]


# Tables.


def test_a_table_holds_the_numbers_of_the_result(tmp_path):
    data = curling_arm(**SMALL)
    path = save(data, tmp_path / "result.nc")
    table = pd.read_csv(write_export(path, tmp_path, "csv").files[0])
    np.testing.assert_array_equal(table["time (s)"], data["time"])
    np.testing.assert_array_equal(table["tip_position.z (m)"], data["tip_position"][:, 2])
    for name, unit in {"pan": "rad", "heave": "m"}.items():
        pose = data["base_pose"].sel(channel=name)
        np.testing.assert_array_equal(table[f"base_pose.{name} ({unit})"], pose)
    np.testing.assert_array_equal(table["energy.drag (J)"], data["energy"].sel(kind="drag"))
    assert {name.partition(".")[0].partition(" ")[0] for name in table} == {"time"} | {
        str(name)
        for name, each in data.items()
        if "time" in each.dims and not {"node", "edge"} & set(each.dims)
    }

    wanted = ["tip_error", "curvature", "tension"]
    file = write_export(path, tmp_path, "csv", variables=wanted, nodes=[0, -1], instants=3).files[0]
    table = pd.read_csv(file)
    bent = [f"curvature.node{n}.kappa_{k} (m-1)" for n in (0, 6) for k in (1, 2)]
    pulled = ["tension.edge0 (N)", "tension.edge5 (N)"]
    assert list(table) == ["time (s)", "tip_error (m)", *bent, *pulled]
    np.testing.assert_array_equal(table["time (s)"], data["time"][::2])
    np.testing.assert_array_equal(table[bent[-1]], data["curvature"][::2, 6, 1])
    every = pd.read_csv(write_export(path, tmp_path, "csv", variables=["position"]).files[0])
    assert every.shape == (5, 1 + 7 * 3)


MAIN = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"


def sheets(path):
    """Return the rows of each sheet of a workbook: numbers as numbers, texts as texts."""
    with zipfile.ZipFile(path) as book:
        named = ElementTree.fromstring(book.read("xl/workbook.xml")).iter(f"{MAIN}sheet")
        found = {}
        for number, sheet in enumerate(named, start=1):
            tree = ElementTree.fromstring(book.read(f"xl/worksheets/sheet{number}.xml"))
            found[sheet.get("name")] = [
                {cell.get("r").rstrip("0123456789"): _content(cell) for cell in row}
                for row in tree.iter(f"{MAIN}row")
            ]
        return found


def _content(cell):
    text = "".join(cell.itertext())
    return text if cell.get("t") == "inlineStr" else float(text)


def test_a_workbook_holds_the_measures_and_the_numbers_of_the_result(tmp_path):
    data = swaying_arm(**SMALL).assign_attrs(title="=1+1")
    data["base_force"][2, 0] = np.nan
    written = write_export(save(data, tmp_path / "result.nc"), tmp_path, "xlsx")
    assert written.notes == ["1 cell is empty: without a finite number"]
    found = sheets(written.files[0])
    assert list(found) == ["summary", "time series", "variables"]
    head, *rows = found["time series"]
    column = {name: place for place, name in head.items()}
    np.testing.assert_array_equal([row[column["time (s)"]] for row in rows], data["time"])
    tip = [row[column["tip_position.z (m)"]] for row in rows]
    np.testing.assert_allclose(tip, data["tip_position"][:, 1], rtol=1e-15)
    assert column["base_force.x (N)"] not in rows[2]
    worst = [row for row in found["summary"] if row.get("A") == "max_error"]
    largest = float(data["tip_error"].max())
    assert [(row["B"], row["C"]) for row in worst] == [(pytest.approx(largest), "m")]
    assert {"A": "title", "B": "=1+1"} in found["summary"]
    units = {row["A"]: row["B"] for row in found["variables"]}
    assert (units["tip_position"], units["tip_angle"]) == ("m", "degree")
    angle = [row[column["tip_angle (degree)"]] for row in rows]
    np.testing.assert_allclose(angle, np.rad2deg(data["tip_angle"]), rtol=1e-15)
    with zipfile.ZipFile(written.files[0]) as book:
        chart, sheet = (
            book.read(f"xl/{name}.xml") for name in ("charts/chart1", "worksheets/sheet2")
        )
    assert column["tip_error (m)"].encode() in chart
    wide = [int(each) for each in re.findall(rb'<col min="(\d+)"', sheet)]
    assert max(wide) == len(head)


def test_a_workbook_that_others_saved_again_is_kept(planar, tmp_path):
    (book,) = write_export(planar, tmp_path, "xlsx").files
    assert is_own(book)
    other = tmp_path / "other.xlsx"
    with zipfile.ZipFile(book) as mine, zipfile.ZipFile(other, "w") as saved:
        for name in mine.namelist():
            text = mine.read(name)
            saved.writestr(name, text.replace(b"Z</dcterms:modified>", b"1Z</dcterms:modified>"))
    assert not is_own(other)
    shutil.copy(other, book)
    assert "--force" in refused("export", tmp_path, "--to", "xlsx")
    book.write_bytes(b"PK")
    assert not is_own(book)


def test_no_text_of_a_table_is_a_formula_and_a_note_counts_empty_cells(tmp_path):
    data = swaying_arm(**SMALL).assign_attrs(title='=HYPERLINK("http://x")\n@a')
    data = data.assign_coords(
        input=["=1+1", "-x", "@y"], input_unit=("input", ["+N", "=m", ""])
    ).assign(actuator_state=(("time", "input"), np.ones((5, 3))))
    data["tip_error"][2] = np.nan
    data["base_force"][4] = -np.inf
    written = write_export(save(data, tmp_path / "result.nc"), tmp_path, "csv")
    assert written.notes == ["3 cells are empty: without a finite number"]
    with written.files[0].open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert not [name for name in head if name.startswith(("=", "+", "-", "@", "\t", "\r"))]
    assert "actuator_state.=1+1 (+N)" in head
    column = [row[head.index("tip_error (m)")] for row in rows]
    assert column[2] == ""
    assert all(np.isfinite(float(cell)) for row in rows for cell in row if cell)
    assert np.isnan(pd.read_csv(written.files[0])["tip_error (m)"][2])


# Animations.


class Animated:
    """A file of glTF taken apart."""

    def __init__(self, path):
        self.gltf = pygltflib.GLTF2().load(str(path))
        self.blob = self.gltf.binary_blob()

    def read(self, number):
        accessor = self.gltf.accessors[number]
        view = self.gltf.bufferViews[accessor.bufferView]
        kind = {5126: "<f4", 5121: "u1", 5125: "<u4"}[accessor.componentType]
        parts = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor.type]
        count = accessor.count * parts
        assert count * np.dtype(kind).itemsize == view.byteLength
        assert view.byteOffset % 4 == 0
        assert view.byteOffset + view.byteLength <= len(self.blob)
        values = np.frombuffer(self.blob, kind, count, view.byteOffset)
        if accessor.min:
            rows = values.reshape(-1, parts)
            assert accessor.min == rows.min(axis=0).tolist()
            assert accessor.max == rows.max(axis=0).tolist()
        return values.reshape(accessor.count, parts).astype(float)

    def named(self, name):
        return next(n for n, each in enumerate(self.gltf.nodes) if each.name == name)

    def follow(self, node, path, count):
        """Values of a node at all instants, whether it moves or not."""
        for animation in self.gltf.animations:
            for channel in animation.channels:
                if (channel.target.node, channel.target.path) == (node, path):
                    return self.read(animation.samplers[channel.sampler].output)
        return np.tile(getattr(self.gltf.nodes[node], path), (count, 1))


def turned(quaternions, vectors):
    """Turn vectors by quaternions x, y, z, w."""
    axis, real = quaternions[:, :3], quaternions[:, 3:]
    swung = 2 * np.cross(axis, vectors)
    return vectors + real * swung + np.cross(axis, swung)


def upright(vectors):
    """From z up to y up."""
    return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)


def test_joints_are_where_the_nodes_are_and_carry_the_surface(run, tmp_path):
    path, data = run
    written = write_export(path, tmp_path, "gltf")
    assert written.notes == []
    found = Animated(*written.files)
    gltf, count, nodes = found.gltf, data.sizes["time"], data.sizes["node"]
    position = upright(in_space(data, "position"))
    for sampler in (each for animation in gltf.animations for each in animation.samplers):
        np.testing.assert_allclose(found.read(sampler.input)[:, 0], data["time"], rtol=1e-7)
    (skin,) = gltf.skins
    assert [gltf.nodes[joint].name for joint in skin.joints] == [f"node {n}" for n in range(nodes)]
    surface = gltf.nodes[found.named("arm")]
    attributes = gltf.meshes[surface.mesh].primitives[0].attributes
    points, hung = found.read(attributes.POSITION), found.read(attributes.JOINTS_0).astype(int)
    weights = found.read(attributes.WEIGHTS_0)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-6)
    back = found.read(skin.inverseBindMatrices).reshape(-1, 4, 4)[:, 3, :3]
    skinned = np.zeros((count, *points.shape))
    for node, joint in enumerate(skin.joints):
        place = found.follow(joint, "translation", count)
        np.testing.assert_allclose(place, position[:, node], atol=2e-6)
        turn = found.follow(joint, "rotation", count)
        np.testing.assert_allclose(np.linalg.norm(turn, axis=1), 1.0, atol=1e-6)
        for slot in range(4):
            share = np.where(hung[:, slot] == node, weights[:, slot], 0.0)
            for record in range(count):
                here = turned(np.tile(turn[record], (len(points), 1)), points + back[node])
                skinned[record] += share[:, None] * (place[record] + here)
    radius = data["diameter"].values / 2
    for node in range(1, nodes - 1):
        ring = (weights.max(axis=1) == 1.0) & (hung[range(len(hung)), weights.argmax(1)] == node)
        assert ring.sum() == 24
        apart = np.linalg.norm(skinned[:, ring] - position[:, None, node], axis=-1)
        np.testing.assert_allclose(apart, radius[node], atol=5e-6)
        ahead = position[:, node + 1] - position[:, node - 1]
        across = np.einsum("tpi,ti->tp", skinned[:, ring] - position[:, None, node], ahead)
        np.testing.assert_allclose(across, 0.0, atol=1e-4 * radius[node])
        if "director" in data and count > 1:  # the arm turns about itself with it
            turn = found.follow(skin.joints[node], "rotation", count)
            first = turned(turn, np.tile(upright(np.array([0.0, 1.0, 0.0])), (count, 1)))
            mean = upright(data["director"].values[:, node - 1 : node + 1].sum(axis=1))
            mean /= np.linalg.norm(mean, axis=1, keepdims=True)
            np.testing.assert_allclose(np.sum(first * mean, axis=1), 1.0, atol=2e-3)


def test_things_about_the_arm_are_nodes_that_move_and_turn(tmp_path):
    data = with_tool(among_solids(**SMALL))
    found = Animated(*write_export(save(data, tmp_path / "result.nc"), tmp_path, "gltf").files)
    places = {"target": data["tip_target"].values, "joint": data["position"].values[:, 0]}
    places["obstacle 2"] = data["obstacle_position"].values[:, 2]
    for name, expected in places.items():
        place = found.follow(found.named(name), "translation", 5)
        np.testing.assert_allclose(place, upright(expected), atol=2e-6)
    size = found.follow(found.named("tool"), "scale", 5)
    np.testing.assert_array_equal(size[:, 0], [0, 0, 1, 1, 1])
    turn = found.follow(found.named("obstacle 2"), "rotation", 5)
    along = turned(turn, np.tile(upright(np.array([1.0, 0.0, 0.0])), (5, 1)))
    np.testing.assert_allclose(along, upright(data["obstacle_axis"].values[:, 2]), atol=1e-6)
    surface = found.gltf.meshes[found.gltf.nodes[found.named("obstacle 0")].mesh].primitives[0]
    points = found.read(surface.attributes.POSITION)
    rock = upright(data["surface_point"].values[:6])
    np.testing.assert_allclose(np.unique(points, axis=0), np.unique(rock, axis=0), atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "half", "radius"),
    [("ellipsoid", 0.7, 0.2), ("capsule", 0.5, 0.1), ("rod", 0.7, 0.1), ("plate", 0.0, 0.4)],
)
@pytest.mark.parametrize("longest", [np.inf, 0.2])
def test_triangles_and_normals_look_outward(kind, half, radius, longest):
    mesh = BodyShape(kind, half, radius).mesh(longest)
    corners = mesh.points[mesh.triangles]
    out = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(out, axis=1).min() > 0.0
    assert (np.einsum("ti,tci->tc", out, mesh.normals[mesh.triangles]) > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, rtol=1e-12)
    if np.ptp(mesh.points[:, 0]):
        middle = corners.mean(axis=1) - mesh.points.mean(axis=0)
        assert (np.sum(out * middle, axis=1) > 0.0).all()


# Stages of USD.


def stage_of(path, tmp_path):
    usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")

    (file,) = write_export(path, tmp_path, "usd").files
    assert file.name == "result.usda"
    assert is_own(file)
    return usd.Stage.Open(str(file))


def test_the_arm_is_a_curve_through_its_nodes(run, tmp_path):
    path, data = run
    stage = stage_of(path, tmp_path)
    from pxr import UsdGeom

    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    arm = UsdGeom.BasisCurves(stage.GetDefaultPrim().GetChild("arm"))
    assert arm.GetTypeAttr().Get() == "linear"
    assert list(arm.GetCurveVertexCountsAttr().Get()) == [data.sizes["node"]]
    np.testing.assert_allclose(arm.GetWidthsAttr().Get(), data["diameter"].values, rtol=1e-6)
    assert arm.GetWidthsInterpolation() == "vertex"
    codes = data["time"].values * stage.GetTimeCodesPerSecond()
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (codes[0], codes[-1])
    if codes.size > 1:
        np.testing.assert_allclose(arm.GetPointsAttr().GetTimeSamples(), codes, rtol=1e-12)
    tip = UsdGeom.Xformable(stage.GetPrimAtPath("/World/tip"))
    low, high = np.array(arm.GetExtentAttr().Get())
    for code, position in zip(codes, in_space(data, "position"), strict=True):
        points = np.array(arm.GetPointsAttr().Get(code))
        np.testing.assert_allclose(points, position, atol=1e-6)
        assert (low <= points).all()
        assert (points <= high).all()
        placed = tip.ComputeLocalToWorldTransform(code)
        np.testing.assert_allclose(placed.ExtractTranslation(), position[-1], atol=1e-12)
        ahead = position[-1] - position[-2]
        found = placed.TransformDir((1.0, 0.0, 0.0))
        np.testing.assert_allclose(found, ahead / np.linalg.norm(ahead), atol=1e-9)


def test_bodies_have_their_size_and_move(run, tmp_path):
    path, data = run
    stage = stage_of(path, tmp_path)
    from pxr import UsdGeom

    scene = build_scene(Result(data), 99, 99)
    codes = data["time"].values * stage.GetTimeCodesPerSecond()
    for body in rigid_bodies(scene, scene.members[0]):
        gprim = UsdGeom.Gprim(stage.GetPrimAtPath("/World/" + body.name.replace(" ", "_")))
        # the farthest points of the shape in its own axes
        end = body.shape.half + (body.shape.radius if body.shape.kind == "capsule" else 0.0)
        corner = np.array([end, body.shape.radius, body.shape.radius])
        if body.shape.solid is not None:
            corner = body.shape.solid.points.max(axis=0)
        size = tuple(map(float, gprim.GetExtentAttr().Get()[1]))
        for record, code in enumerate(codes):
            shown = gprim.GetVisibilityAttr().Get(code) != "invisible"
            assert shown == body.scale[record].any()
            if shown:
                moved = gprim.ComputeLocalToWorldTransform(code).Transform(size)
                wanted = body.transform(corner, record)
                np.testing.assert_allclose(moved, wanted, atol=1e-5 * scene.length)


# At the command line.


def test_a_note_says_that_a_long_run_is_thinned(tmp_path):
    save(swaying_arm(records=31, nodes=5), tmp_path / "result.nc")
    line = "note: 4 of 31 saved instants are written, evenly chosen; --instants 31 writes all"
    for kind in ("csv", "vtkhdf", "gltf"):
        assert line in succeeded("export", tmp_path, "--to", kind, "--instants", 4)
    assert len(pd.read_csv(tmp_path / "result.csv")) == 4
    assert opened(tmp_path / "result.vtkhdf")[1] == pytest.approx([0.0, 20 / 3, 40 / 3, 20.0])
    long = save(swaying_arm(records=3, nodes=241), tmp_path / "long" / "result.nc")
    said = succeeded("export", long, "--to", "gltf", "--out", tmp_path / "out")
    assert "note: the arm is shown by 201 of its 241 nodes" in said


@pytest.mark.usefixtures("planar")
def test_only_crinoid_s_files_are_replaced_and_cleared(tmp_path):
    for kind, name in {"csv": "csv", "xlsx": "xlsx", "vtkhdf": "vtkhdf", "gltf": "glb"}.items():
        file = tmp_path / f"result.{name}"
        file.write_text("time (s),mine\n1,2\n")
        assert "was not written by crinoid" in refused("export", tmp_path, "--to", kind)
        assert file.read_text() == "time (s),mine\n1,2\n"
        succeeded("export", tmp_path, "--to", kind, "--force")
        succeeded("export", tmp_path, "--to", kind)
    assert len(list(tmp_path.iterdir())) == 6
    (tmp_path / "mine.csv").write_text("time (s),tip_error (m)\n")
    table = pd.read_csv(tmp_path / "result.csv")
    clear_figures(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.csv", "result.nc"]
    table.to_csv(tmp_path / "result.csv", index=False)  # as a user saves it, with changes
    saved = (tmp_path / "result.csv").read_text()
    assert "--force" in refused("export", tmp_path, "--to", "csv")
    clear_figures(tmp_path)
    assert (tmp_path / "result.csv").read_text() == saved


@pytest.mark.parametrize("kind", ["csv", "vtkhdf", "gltf"])
def test_an_export_that_is_interrupted_leaves_nothing(kind, planar, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise Interrupted

    monkeypatch.setattr("crinoid.view.export.table.csv.writer", interrupted)
    monkeypatch.setattr("crinoid.view.export.vtkhdf.in_space", interrupted)
    monkeypatch.setattr("crinoid.view.export.gltf.rigid_bodies", interrupted)
    assert call("export", tmp_path, "--to", kind).exit_code == 130
    assert list(tmp_path.iterdir()) == [planar]


@pytest.mark.usefixtures("planar")
def test_only_gltf_needs_its_library(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pygltflib", None)
    for kind in ("csv", "vtkhdf"):
        succeeded("export", tmp_path, "--to", kind)


def test_a_writer_that_leaves_its_file_empty_is_an_error(tmp_path, monkeypatch):
    path = save(swaying_arm(records=2, nodes=3), tmp_path / "result.nc")

    def write(source, files, report):
        files[0].touch()
        return []

    monkeypatch.setattr("crinoid.view.export.table.write_csv", write)
    with pytest.raises(OSError, match="left a file empty"):
        write_export(path, tmp_path / "out", "csv")
    assert not list(tmp_path.glob("out/*"))
