"""A run for Blender and others: the arm moving, and what is about it, as binary glTF 2.0."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float
from pygltflib import (
    GLTF2,
    Accessor,
    Animation,
    AnimationChannel,
    AnimationChannelTarget,
    AnimationSampler,
    Asset,
    Attributes,
    Buffer,
    BufferView,
    Material,
    Node,
    PbrMetallicRoughness,
    Primitive,
    Scene,
)
from pygltflib import Mesh as MeshOfFile
from pygltflib import Skin as SkinOfFile
from scipy.spatial.transform import Rotation

from crinoid.export.arm import Skin
from crinoid.export.mesh import Mesh
from crinoid.export.pose import Turns
from crinoid.export.things import Thing
from crinoid.report.charts.space import Path as Places
from crinoid.report.run import ReportError

_COLOURS = {
    "arm": (0.0, 0.17, 0.45),
    "base": (0.42, 0.47, 0.5),
    "target": (0.67, 0.11, 0.0),
    "obstacle": (0.35, 0.31, 0.26),
    "tool": (0.6, 0.19, 0.39),
}
"""Red, green and blue of what each kind is made of, as light and not as a screen has them."""
_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From crinoid's axes, z up, to those of glTF, y up."""
_KINDS = {"f4": 5126, "u1": 5121, "u4": 5125}
"""Numbers of glTF for kinds of numbers."""
_SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
_VERTICES, _INDICES = 34962, 34963
_STILL = 1e-9


class Document:
    """A file in the making.

    Parameters
    ----------
    time
        Instants (s).
    extras
        What the file says about itself.
    """

    def __init__(self, time: Float[np.ndarray, " time"], extras: Mapping[str, str]) -> None:
        self._gltf, self._bytes = GLTF2(), bytearray()
        version = extras["crinoid_version"]
        self._gltf.asset = Asset(generator=f"crinoid {version}".strip(), extras=dict(extras))
        self._gltf.scenes, self._gltf.scene = [Scene(nodes=[], name="run")], 0
        self._animation = Animation(name="run", channels=[], samplers=[])
        self._time: int | None = None
        if time.size > 1:
            brief = time.astype("f4")
            if not (np.diff(brief) > 0).all():
                text = "instants are too near to each other for glTF, which has times of 32 bits"
                raise ReportError(f"{text}; --instants takes fewer")
            self._time = self._accessor(brief, bounds=True)

    def add_arm(
        self, skin: Skin, position: Float[np.ndarray, "time node axis=3"], turn: Turns
    ) -> None:
        """Add the arm: a surface, and for each of its nodes a joint that moves."""
        holder = self._node(Node(name="nodes of the arm", children=[]), at_root=True)
        joints = []
        for node in range(skin.rest.size):
            joints.append(self._node(Node(name=f"node {node}"), at_root=False))
            self._move(joints[-1], position[:, node], turn[:, node])
        self._gltf.nodes[holder].children = joints
        # from the straight arm to where a joint is: columns of matrices follow one another
        back = np.tile(np.eye(4), (skin.rest.size, 1, 1))
        back[:, 3, 0] = -skin.rest
        self._gltf.skins.append(
            SkinOfFile(
                name="arm",
                joints=joints,
                skeleton=holder,
                inverseBindMatrices=self._accessor(back.astype("f4")),
            )
        )
        none = np.zeros_like(skin.nodes)
        weights = np.concatenate([skin.weights, none], axis=1).astype("f4")
        # a joint of no weight is to be the first
        hung = np.where(skin.weights > 0.0, skin.nodes, 0)
        more = {
            "JOINTS_0": self._accessor(
                np.concatenate([hung, none], axis=1).astype("u1"), _VERTICES
            ),
            "WEIGHTS_0": self._accessor(weights, _VERTICES),
        }
        mesh = self._mesh("arm", "arm", skin.mesh, more)
        self._node(Node(name="arm", mesh=mesh, skin=0), at_root=True)

    def add_thing(self, thing: Thing) -> None:
        """Add a rigid surface, which moves if it does."""
        mesh = self._mesh(thing.name, thing.kind, thing.mesh, {})
        node = self._node(Node(name=thing.name, mesh=mesh), at_root=True)
        self._move(node, thing.place, thing.turn)
        # y and z change places, and a size has no sign to turn
        size = thing.size[:, [0, 2, 1]]
        self._channel(
            node, "scale", size, interpolation="STEP" if thing.kind == "tool" else "LINEAR"
        )

    def write(self, path: Path) -> None:
        """Write the file."""
        if self._animation.channels:
            self._gltf.animations.append(self._animation)
        self._gltf.buffers.append(Buffer(byteLength=len(self._bytes)))
        self._gltf.set_binary_blob(bytes(self._bytes))
        with path.open("wb") as file:
            for part in self._gltf.save_to_bytes():
                file.write(part)

    def _node(self, node: Node, *, at_root: bool) -> int:
        self._gltf.nodes.append(node)
        number = len(self._gltf.nodes) - 1
        if at_root:
            self._gltf.scenes[0].nodes.append(number)
        return number

    def _move(self, node: int, place: Places, turn: Turns) -> None:
        self._channel(node, "translation", place @ _UP.T)
        self._channel(node, "rotation", _quaternions(_UP @ turn @ _UP.T))

    def _channel(
        self,
        node: int,
        path: str,
        values: Float[np.ndarray, "time part"],
        interpolation: str = "LINEAR",
    ) -> None:
        """Let a node follow values, or stay where they are if they do."""
        brief = values.astype("f4")
        setattr(self._gltf.nodes[node], path, brief[0].tolist())
        if self._time is None or np.ptp(values, axis=0).max() <= _STILL:
            return
        target = AnimationChannelTarget(node=node, path=path)
        number = len(self._animation.samplers)
        self._animation.channels.append(AnimationChannel(sampler=number, target=target))
        self._animation.samplers.append(
            AnimationSampler(
                input=self._time,
                output=self._accessor(brief),
                interpolation=interpolation,
            )
        )

    def _mesh(self, name: str, kind: str, mesh: Mesh, more: Mapping[str, int]) -> int:
        attributes = Attributes(
            POSITION=self._accessor((mesh.points @ _UP.T).astype("f4"), _VERTICES, bounds=True),
            NORMAL=self._accessor((mesh.normals @ _UP.T).astype("f4"), _VERTICES),
            **more,
        )
        primitive = Primitive(
            attributes=attributes,
            indices=self._accessor(mesh.triangles.reshape(-1).astype("u4"), _INDICES),
            material=self._material(kind),
        )
        self._gltf.meshes.append(MeshOfFile(name=name, primitives=[primitive]))
        return len(self._gltf.meshes) - 1

    def _material(self, kind: str) -> int:
        names = [each.name for each in self._gltf.materials]
        if kind not in names:
            finish = PbrMetallicRoughness(
                baseColorFactor=[*_COLOURS[kind], 1.0], metallicFactor=0.0, roughnessFactor=0.6
            )
            made = Material(name=kind, pbrMetallicRoughness=finish, doubleSided=True)
            self._gltf.materials.append(made)
        return [*names, kind].index(kind)

    def _accessor(
        self, values: np.ndarray, target: int | None = None, *, bounds: bool = False
    ) -> int:
        """Put an array into the file and return its number."""
        self._bytes += bytes(-len(self._bytes) % 4)
        content = np.ascontiguousarray(values).tobytes()
        view = BufferView(
            buffer=0, byteOffset=len(self._bytes), byteLength=len(content), target=target
        )
        self._gltf.bufferViews.append(view)
        self._bytes += content
        ends = [np.atleast_1d(end).tolist() for end in (values.min(0), values.max(0))]
        self._gltf.accessors.append(
            Accessor(
                bufferView=len(self._gltf.bufferViews) - 1,
                byteOffset=0,
                componentType=_KINDS[values.dtype.str[1:]],
                count=len(values),
                type=_SHAPES[values.shape[1:]],
                min=ends[0] if bounds else None,
                max=ends[1] if bounds else None,
            )
        )
        return len(self._gltf.accessors) - 1


def _quaternions(turn: Float[np.ndarray, "time axis=3 axis=3"]) -> Float[np.ndarray, "time 4"]:
    """Return turns as quaternions, each of the two that is nearer to the one before."""
    found = Rotation.from_matrix(turn).as_quat()
    same = np.where(np.sum(found[1:] * found[:-1], axis=1) < 0.0, -1.0, 1.0)
    found[1:] *= np.cumprod(same)[:, None]
    return found
