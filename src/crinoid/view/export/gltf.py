"""glTF 2.0 of a run: the arm as a skin on its nodes, and rigid bodies, both animated."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pygltflib
import xarray as xr
from jaxtyping import Float, Int

from crinoid.results.report_error import ReportError
from crinoid.results.scene.bodies import COLOURS, RigidBody, rigid_bodies
from crinoid.results.scene.data import Points, arc_length, even_indices
from crinoid.results.scene.mesh import AROUND, Mesh, Rotations, quaternions, revolve
from crinoid.results.scene.mount import Path as Places
from crinoid.results.scene.scene import Keyframes
from crinoid.view.export.source import Files, Report, Shapes

_RINGS = 80  # about how many rings the surface has


class Skin(NamedTuple):
    """Surface of the straight arm along +x, whose points follow two nodes each.

    The weight of a node falls with its distance, for a smooth surface with a ring at each node.
    """

    mesh: Mesh
    rest: Float[np.ndarray, " node"]  # arc length of the nodes along the straight arm (m)
    nodes: Int[np.ndarray, "point 2"]
    weights: Float[np.ndarray, "point 2"]


def skin_of(data: xr.Dataset, run: Keyframes) -> Skin:
    """Return the skin of an arm at its chosen nodes."""
    chosen = even_indices(data.sizes["node"], run.diameter.size)
    rest = arc_length(data.isel(time=run.at[:1]))[chosen]
    edges = rest.size - 1
    each = max(1, math.ceil(_RINGS / edges))
    share = np.append(np.tile(np.arange(each) / each, edges), 1.0)
    first = np.append(np.repeat(np.arange(edges), each), edges - 1)
    # weights of zero slope at the nodes avoid a kink there
    second = share**2 * (3.0 - 2.0 * share)
    along = rest[first] + share * np.diff(rest)[first]
    radius = np.interp(along, rest, run.diameter / 2)
    sides = np.stack([along, radius, np.zeros_like(along), np.ones_like(along)], axis=1)
    ends = [(along[0], 0.0, -1.0, 0.0), (along[0], radius[0], -1.0, 0.0)]
    begins = [(along[-1], radius[-1], 1.0, 0.0), (along[-1], 0.0, 1.0, 0.0)]
    mesh = revolve(np.concatenate([ends, sides, begins]))
    rings = np.concatenate([[0, 0], np.arange(along.size), [along.size - 1] * 2])
    point = np.repeat(rings, AROUND)
    nodes = np.stack([first, first + 1], axis=1)[point]
    return Skin(mesh, rest, nodes, np.stack([1.0 - second, second], axis=1)[point])


_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Rotation from crinoid's axes, z up, to those of glTF, y up."""
_KINDS = {"f4": 5126, "u1": 5121, "u4": 5125}  # codes of glTF for kinds of numbers
_SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
_VERTICES, _INDICES = 34962, 34963
_STILL = 1e-9


def write_gltf(source: Shapes, files: Files, report: Report) -> list[str]:
    """Write an animation: the arm as a skin on its nodes, and rigid bodies around it."""
    run = source.run
    document = GltfDocument(run.time, source.attributes)
    document.add_arm(skin_of(source.data, run), run.position, source.attitudes)
    for body in rigid_bodies(source.scene, run):
        document.add_body(body)
    report(run.at.size, run.at.size)
    document.write(files[0])
    return []


class GltfDocument:
    """A glTF document of instants (s), with its source as ``extras``."""

    def __init__(self, time: Float[np.ndarray, " time"], extras: Mapping[str, str]) -> None:
        self._gltf, self._bytes = pygltflib.GLTF2(), bytearray()
        program = f"crinoid {extras['crinoid_version']}".strip()
        self._gltf.asset = pygltflib.Asset(generator=program, extras=dict(extras))
        self._gltf.scenes, self._gltf.scene = [pygltflib.Scene(nodes=[], name="run")], 0
        self._animation = pygltflib.Animation(name="run", channels=[], samplers=[])
        self._time: int | None = None
        if time.size > 1:
            brief = time.astype("f4")
            if not (np.diff(brief) > 0).all():
                text = "instants are too close to each other for glTF, which has times of 32 bits"
                raise ReportError(f"{text}. Choose fewer with --instants.")
            self._time = self._accessor(brief, bounds=True)

    def add_arm(self, skin: Skin, position: Points, turn: Rotations) -> None:
        """Add the arm: a surface, and for each of its nodes a joint that moves."""
        holder = self._node(pygltflib.Node(name="nodes of the arm", children=[]), at_root=True)
        joints = []
        for node in range(skin.rest.size):
            joints.append(self._node(pygltflib.Node(name=f"node {node}"), at_root=False))
            self._move(joints[-1], position[:, node], turn[:, node])
        self._gltf.nodes[holder].children = joints
        # from the straight arm to where a joint is: columns of matrices follow one another
        back = np.tile(np.eye(4), (skin.rest.size, 1, 1))
        back[:, 3, 0] = -skin.rest
        inverse = self._accessor(back.astype("f4"))
        arm = pygltflib.Skin(
            name="arm", joints=joints, skeleton=holder, inverseBindMatrices=inverse
        )
        self._gltf.skins.append(arm)
        none = np.zeros_like(skin.nodes)
        weights = np.concatenate([skin.weights, none], axis=1).astype("f4")
        # a joint without weight must be the first
        hung = np.where(skin.weights > 0.0, skin.nodes, 0)
        joined = self._accessor(np.concatenate([hung, none], axis=1).astype("u1"), _VERTICES)
        more = {"JOINTS_0": joined, "WEIGHTS_0": self._accessor(weights, _VERTICES)}
        mesh = self._mesh("arm", "arm", skin.mesh, more)
        self._node(pygltflib.Node(name="arm", mesh=mesh, skin=0), at_root=True)

    def add_body(self, body: RigidBody) -> None:
        """Add a rigid surface, which moves if it does."""
        mesh = self._mesh(body.name, body.kind, body.shape.mesh(), {})
        node = self._node(pygltflib.Node(name=body.name, mesh=mesh), at_root=True)
        self._move(node, body.position, body.attitude)
        # y and z change places, and a size has no sign to turn
        size, steps = body.scale[:, [0, 2, 1]], "STEP" if body.kind == "tool" else "LINEAR"
        self._channel(node, "scale", size, interpolation=steps)

    def write(self, path: Path) -> None:
        """Write the file."""
        if self._animation.channels:
            self._gltf.animations.append(self._animation)
        self._gltf.buffers.append(pygltflib.Buffer(byteLength=len(self._bytes)))
        self._gltf.set_binary_blob(bytes(self._bytes))
        with path.open("wb") as file:
            for part in self._gltf.save_to_bytes():
                file.write(part)

    def _node(self, node: pygltflib.Node, *, at_root: bool) -> int:
        number = _append(self._gltf.nodes, node)
        if at_root:
            self._gltf.scenes[0].nodes.append(number)
        return number

    def _move(self, node: int, place: Places, turn: Rotations) -> None:
        self._channel(node, "translation", place @ _UP.T)
        self._channel(node, "rotation", quaternions(_UP @ turn @ _UP.T))

    def _channel(
        self, node: int, path: str, values: np.ndarray, interpolation: str = "LINEAR"
    ) -> None:
        """Animate a node by values, unless they are constant."""
        brief = values.astype("f4")
        setattr(self._gltf.nodes[node], path, brief[0].tolist())
        if self._time is None or np.ptp(values, axis=0).max() <= _STILL:
            return
        target = pygltflib.AnimationChannelTarget(node=node, path=path)
        sampler = pygltflib.AnimationSampler(input=self._time, interpolation=interpolation)
        sampler.output = self._accessor(brief)
        number = _append(self._animation.samplers, sampler)
        self._animation.channels.append(pygltflib.AnimationChannel(sampler=number, target=target))

    def _mesh(self, name: str, kind: str, mesh: Mesh, more: Mapping[str, int]) -> int:
        attributes = pygltflib.Attributes(
            POSITION=self._accessor((mesh.points @ _UP.T).astype("f4"), _VERTICES, bounds=True),
            NORMAL=self._accessor((mesh.normals @ _UP.T).astype("f4"), _VERTICES),
            **more,
        )
        primitive = pygltflib.Primitive(attributes=attributes, material=self._material(kind))
        primitive.indices = self._accessor(mesh.triangles.reshape(-1).astype("u4"), _INDICES)
        return _append(self._gltf.meshes, pygltflib.Mesh(name=name, primitives=[primitive]))

    def _material(self, kind: str) -> int:
        names = [each.name for each in self._gltf.materials]
        if kind not in names:
            finish = pygltflib.PbrMetallicRoughness(
                baseColorFactor=[*COLOURS[kind], 1.0], metallicFactor=0.0, roughnessFactor=0.6
            )
            made = pygltflib.Material(name=kind, pbrMetallicRoughness=finish, doubleSided=True)
            return _append(self._gltf.materials, made)
        return names.index(kind)

    def _accessor(
        self, values: np.ndarray, target: int | None = None, *, bounds: bool = False
    ) -> int:
        """Put an array into the file and return its number."""
        self._bytes += bytes(-len(self._bytes) % 4)
        content = np.ascontiguousarray(values).tobytes()
        view = pygltflib.BufferView(buffer=0, byteOffset=len(self._bytes), target=target)
        view.byteLength = len(content)
        self._bytes += content
        accessor = pygltflib.Accessor(byteOffset=0, count=len(values))
        accessor.bufferView = _append(self._gltf.bufferViews, view)
        accessor.componentType = _KINDS[values.dtype.str[1:]]
        accessor.type = _SHAPES[values.shape[1:]]
        if bounds:
            ends = values.min(axis=0), values.max(axis=0)
            accessor.min, accessor.max = (np.atleast_1d(end).tolist() for end in ends)
        return _append(self._gltf.accessors, accessor)


def _append(items: list[Any], item: Any) -> int:
    """Append an item, and return its index."""
    items.append(item)
    return len(items) - 1
