"""USD of a run: the arm as a curve with widths, and rigid bodies, both animated."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from pxr import Gf, Tf, Usd, UsdGeom, Vt

from crinoid.results.scene.bodies import COLOURS, RigidBody, rigid_bodies
from crinoid.results.scene.mesh import BodyShape, Rotations, quaternions
from crinoid.results.scene.mount import Path as Places
from crinoid.view.export.source import Files, Report, Shapes

_RATE = 50.0  # time codes per second
_STILL = 1e-9

Values = Float[np.ndarray, "time ..."]


def write_usd(source: Shapes, files: Files, report: Report) -> list[str]:
    """Write a stage (z up, metres): the arm as a curve with widths, and rigid bodies around it."""
    run, turn = source.run, source.attitudes
    stage = Usd.Stage.CreateInMemory(".usda")
    stage.GetRootLayer().customLayerData = source.attributes
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    codes = np.round(_RATE * run.time, 9)
    stage.SetTimeCodesPerSecond(_RATE)
    stage.SetFramesPerSecond(_RATE)
    stage.SetStartTimeCode(float(codes[0]))
    stage.SetEndTimeCode(float(codes[-1]))
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    arm = UsdGeom.BasisCurves.Define(stage, "/World/arm")
    arm.CreateTypeAttr(UsdGeom.Tokens.linear)  # edges are straight
    arm.CreateCurveVertexCountsAttr([run.diameter.size])
    arm.CreateWidthsAttr(Vt.FloatArray.FromNumpy(run.diameter.astype("f4")))
    arm.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
    _animate(arm.CreatePointsAttr(), codes, run.position, _points)
    reach = run.diameter[:, None] / 2
    ends = [(run.position - reach).min(axis=(0, 1)), (run.position + reach).max(axis=(0, 1))]
    arm.CreateExtentAttr(_points(np.stack(ends)))
    _paint(arm, "arm")
    tip = UsdGeom.Xform.Define(stage, "/World/tip")
    _move(tip, codes, run.position[:, -1], turn[:, -1])
    for body in rigid_bodies(source.scene, run):
        _add_body(stage, codes, body)
    report(run.at.size, run.at.size)
    files[0].write_text(str(stage.GetRootLayer().ExportToString()), "utf-8")
    return []


def _add_body(stage: Usd.Stage, codes: Float[np.ndarray, " time"], body: RigidBody) -> None:
    path = f"/World/{Tf.MakeValidIdentifier(body.name)}"
    shape, scale = _shape(stage, path, body.shape), body.scale
    shown = np.asarray(scale.any(axis=1))
    if not shown.all():
        tokens = (UsdGeom.Tokens.invisible, UsdGeom.Tokens.inherited)
        _animate(shape.CreateVisibilityAttr(), codes, shown, lambda here: tokens[int(here)])
        scale = np.where(shown[:, None], scale, 1.0)
    if body.shape.kind == "ellipsoid":
        scale = scale * [body.shape.half, body.shape.radius, body.shape.radius]
    _move(shape, codes, body.position, body.attitude)
    if (scale != 1.0).any():
        _animate(shape.AddScaleOp().GetAttr(), codes, scale, lambda size: Gf.Vec3f(*size.tolist()))
    _paint(shape, body.kind)


def _shape(stage: Usd.Stage, path: str, shape: BodyShape) -> Any:
    """Define the shape of a body about its x axis; an ellipsoid is a scaled ball of 1 m."""
    if shape.kind in ("plate", "solid"):
        mesh, faces = UsdGeom.Mesh.Define(stage, path), shape.mesh()
        corners = faces.faces if shape.solid is None else shape.solid.facets
        mesh.CreatePointsAttr(_points(faces.points))
        mesh.CreateFaceVertexCountsAttr([corners.shape[1]] * len(corners))
        mesh.CreateFaceVertexIndicesAttr(corners.ravel().tolist())
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateDoubleSidedAttr(True)
        mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
        return mesh
    kinds = {"ellipsoid": UsdGeom.Sphere, "rod": UsdGeom.Cylinder, "capsule": UsdGeom.Capsule}
    round_one = kinds[shape.kind].Define(stage, path)
    if shape.kind == "ellipsoid":
        round_one.CreateRadiusAttr(1.0)
        half = across = 1.0
    else:
        across = shape.radius
        half = shape.half + (across if shape.kind == "capsule" else 0.0)
        round_one.CreateAxisAttr(UsdGeom.Tokens.x)
        round_one.CreateRadiusAttr(across)
        round_one.CreateHeightAttr(2 * shape.half)
    corner = np.array([half, across, across])
    round_one.CreateExtentAttr(_points(np.stack([-corner, corner])))
    return round_one


def _move(prim: Any, codes: Float[np.ndarray, " time"], place: Places, turn: Rotations) -> None:
    translate = prim.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble)
    _animate(translate.GetAttr(), codes, place, lambda at: Gf.Vec3d(*at.tolist()))
    orient = prim.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
    _animate(orient.GetAttr(), codes, quaternions(turn), _quaternion)


def _quaternion(numbers: Float[np.ndarray, "4"]) -> Gf.Quatd:
    x, y, z, w = numbers.tolist()
    return Gf.Quatd(w, x, y, z)


def _animate(
    attribute: Usd.Attribute,
    codes: Float[np.ndarray, " time"],
    values: np.ndarray,
    made: Callable[[Any], Any],
) -> None:
    """Set the values of an attribute at time codes, one value if they are constant."""
    if (np.ptp(1.0 * values, axis=0) <= _STILL).all():
        attribute.Set(made(values[0]))
        return
    for code, value in zip(codes.tolist(), values, strict=True):
        attribute.Set(made(value), code)


def _points(places: Float[np.ndarray, "point axis=3"]) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(places, "f4"))


def _paint(prim: Any, kind: str) -> None:
    prim.CreateDisplayColorAttr([Gf.Vec3f(*COLOURS[kind])])
