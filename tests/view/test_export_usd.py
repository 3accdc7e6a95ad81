"""Stages of USD, as its own library opens them."""

import sys

import numpy as np
import pytest

from crinoid.results.own_files import is_own
from crinoid.view.export import write_usd
from crinoid.view.scene.bodies import rigid_bodies
from crinoid.view.scene.data import in_space
from crinoid.view.scene.scene import build_scene
from helpers.command import refused
from helpers.planar_result import among_obstacles as planar_obstacles
from helpers.planar_result import swaying_arm
from helpers.spatial_result import among_obstacles, among_solids, curling_arm
from helpers.studies import save

SMALL = {"records": 5, "duration": 2.0, "nodes": 7}
TOOL = "[tool]\nmass = 0.2\nvolume = 5e-5\noffset = 0.03\n"


def with_tool(data):
    data = data.assign(tool_held=("time", 1.0 * (np.arange(data.sizes["time"]) >= 2)))
    return data.assign_attrs(scenario=data.attrs["scenario"] + TOOL)


RUNS = {
    "planar, obstacles": lambda: planar_obstacles(**SMALL),
    "spatial": lambda: curling_arm(**SMALL, moving_target=True),
    "spatial, obstacles, tool": lambda: with_tool(among_obstacles(**SMALL)),
    "solids, a hull": lambda: among_solids(**SMALL),
    "one instant": lambda: curling_arm(records=1, duration=0.0, nodes=4),
}


@pytest.fixture(params=RUNS, ids=str)
def run(request, tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    data = RUNS[request.param]()
    return save(data, tmp_path / "result.nc"), data


def opened(path, tmp_path):
    from pxr import Usd

    (file,) = write_usd(path, tmp_path).files
    assert file.name == "result.usda"
    assert is_own(file)
    return Usd.Stage.Open(str(file))


def test_the_arm_is_a_curve_through_its_nodes(run, tmp_path):
    from pxr import UsdGeom

    path, data = run
    stage = opened(path, tmp_path)
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
    from pxr import UsdGeom

    path, data = run
    stage = opened(path, tmp_path)
    scene = build_scene([("", data)], 99, 99)
    codes = data["time"].values * stage.GetTimeCodesPerSecond()
    kinds = {"ellipsoid": "Sphere", "rod": "Cylinder", "capsule": "Capsule"}
    for body in rigid_bodies(scene, scene.members[0]):
        prim = stage.GetPrimAtPath("/World/" + body.name.replace(" ", "_"))
        assert prim.GetTypeName() == kinds.get(body.shape.kind, "Mesh")
        gprim = UsdGeom.Gprim(prim)
        # the farthest points of the shape in its own axes
        end = body.shape.half + (body.shape.radius if body.shape.kind == "capsule" else 0.0)
        corner = np.array([end, body.shape.radius, body.shape.radius])
        if body.shape.solid is not None:
            corner = body.shape.solid.points.max(axis=0)
        size = np.array(gprim.GetExtentAttr().Get()[1])
        for record, code in enumerate(codes):
            shown = gprim.GetVisibilityAttr().Get(code) != "invisible"
            assert shown == body.scale[record].any()
            if not shown:
                continue
            moved = gprim.ComputeLocalToWorldTransform(code).Transform(tuple(size.tolist()))
            wanted = body.transform(corner, record)
            np.testing.assert_allclose(moved, wanted, atol=1e-5 * scene.length)


def test_without_the_package_there_is_a_hint(tmp_path, monkeypatch):
    path = save(swaying_arm(**SMALL), tmp_path / "result.nc")
    monkeypatch.delitem(sys.modules, "crinoid.view.export.usd", raising=False)
    monkeypatch.setitem(sys.modules, "pxr", None)
    said = refused("export", path, "--to", "usd")
    assert said.endswith('USD is written by usd-core: pip install "crinoid[usd]"')
