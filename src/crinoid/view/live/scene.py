"""Scene of a live session: the arm, rigid bodies, water and target as nodes of viser."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import viser
from scipy.interpolate import CubicSpline

from crinoid.foundation.axes import CHANNELS
from crinoid.recording import SolidSurface
from crinoid.results.scene.bodies import RigidBody, rigid_bodies
from crinoid.results.scene.data import Obstacle, Points, SolidShape, ToolBall
from crinoid.results.scene.mesh import Mesh, look_rotation, tube, unit_vectors
from crinoid.results.scene.mount import ArmMount, mount_of
from crinoid.results.scene.scene import Keyframes, Scene
from crinoid.scenario import Scenario
from crinoid.view.figures.style import BLUE, GREEN, GREY, INK, ORANGE, PALE, SKY, VERMILLION
from crinoid.view.live.interactive import InteractiveBodies
from crinoid.view.live.session_log import Snapshot

_ARROWS = 7
_REACH = 0.22  # length of the arrow of the fastest water so far, over the arm's
_SLOWEST = 0.02  # share of that speed below which arrows are hidden
_GAP = 0.02  # distance of their heads from the arm, over its length
_PULLED = 0.3  # length of the arrow of a pull, over the arm's
_TRAIL = 240  # instants in the path of the tip
_FINER = 4  # rings of the arm for each of its edges
_PLAIN: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}


class LiveScene:
    """The arm, its target and rigid bodies, as nodes of a viser scene."""

    def __init__(
        self,
        server: viser.ViserServer,
        scenario: Scenario,
        bodies: InteractiveBodies,
        frame: Snapshot,
        surfaces: Mapping[str, SolidSurface],
    ) -> None:
        self._server, self._scene, self._length = server, server.scene, scenario.arm.length
        self._planar = scenario.arm.dimension == 2
        self.axes = (0, 2) if self._planar else (0, 1, 2)  # axes of space in which the arm moves
        self._diameter = np.maximum(scenario.arm.diameters, 0.008 * self._length)
        self._held, self._channels = scenario, CHANNELS[scenario.arm.dimension]
        self._obstacles = list(bodies.added_to(scenario).obstacle)
        self._names = [str(index) for index in range(len(scenario.obstacle))]
        self._names += ["debris"] if bodies.debris is not None else []
        self._solids = {
            name.removeprefix("obstacle."): SolidShape(read.points, read.facets)
            for name, read in surfaces.items()
        }
        self._tool = ToolBall.of(scenario.tool) if scenario.tool is not None else None
        self._fastest, self._trail = 0.0, np.repeat(frame.nodes[-1:], _TRAIL, axis=0)
        self._last = -1.0
        self.dragged = False  # whether a user is dragging the target
        self._build(frame)
        self.show(frame)

    def show(self, frame: Snapshot) -> None:
        """Show an instant."""
        if frame.time < self._last:
            self._trail[:] = frame.nodes[-1]
        if frame.time != self._last:
            self._trail = np.concatenate([self._trail[1:], frame.nodes[-1:]])
        self._last = frame.time
        with self._server.atomic():
            self._arm.vertices = arm_mesh(frame.nodes, self._diameter).points.astype(np.float32)
            self._path.points = np.stack([self._trail[:-1], self._trail[1:]], axis=1)
            self._show_bodies(frame)
            self._show_water(frame)
            size = float(np.linalg.norm(frame.pull))
            self._pull.visible = size > 0
            if size > 0:
                head = frame.nodes[-1] + _PULLED * self._length * frame.pull / size
                self._pull.points = np.stack([frame.nodes[-1], head])[None]
            if not self.dragged:
                self.target.position = frame.target
            self._aim.position = frame.target

    def _build(self, frame: Snapshot) -> None:
        scene, length = self._scene, self._length
        middle = frame.nodes.mean(axis=0)
        away = np.array([0.0, -1.0, 0.12]) if self._planar else np.array([0.75, -1.0, 0.55])
        camera = self._server.initial_camera
        camera.position = middle + 1.75 * length * away / np.linalg.norm(away)
        camera.look_at, camera.up, camera.fov = middle, (0.0, 0.0, 1.0), np.deg2rad(45)
        camera.near, camera.far = 0.01 * length, 200 * length
        scene.configure_environment_map(None)
        scene.configure_default_lights(enabled=True, cast_shadow=False)
        scene.add_light_hemisphere("/sky", ground_color=(190, 190, 190), intensity=2.2)
        scene.world_axes.visible = False
        scene.add_grid(
            "/grid",
            plane="xz" if self._planar else "xy",
            infinite_grid=True,
            cell_size=_decade(0.1 * length),
            section_size=_decade(length),
            cell_color=(232, 234, 236),
            section_color=(206, 210, 214),
            fade_distance=5 * length,
            shadow_opacity=0.0,
            position=np.array([0.0, 0.6, 0.0] if self._planar else [0.0, 0.0, -0.9]) * length,
        )
        arm = arm_mesh(frame.nodes, self._diameter)
        self._arm = scene.add_mesh_simple(
            "/arm", arm.points, arm.triangles, color=_rgb(ORANGE), side="double", **_PLAIN
        )
        self._path = scene.add_line_segments(
            "/trail", np.zeros((_TRAIL - 1, 2, 3)), _rgb(GREY), thickness=0.003 * length
        )
        self._handles = {body.name: self._add_body(body) for body in self._rigid_bodies(frame)}
        self._water = self._arrows("/water", SKY, _ARROWS, 0.006)
        self._pull = self._arrows("/pull", VERMILLION, 1, 0.01)
        self._aim = scene.add_icosphere("/aim", 0.016 * length, _rgb(BLUE), opacity=0.7, **_PLAIN)
        look: dict[str, Any] = {"scale": 0.14 * length, "depth_test": False}
        look |= {"active_axes": (True, not self._planar, True), "disable_rotations": True}
        self.target = scene.add_transform_controls("/target", position=frame.target, **look)

    def _arrows(self, name: str, colour: str, count: int, thick: float) -> Any:
        size, points = thick * self._length, np.zeros((count, 2, 3))
        points[:, 1, 0] = self._length
        head: dict[str, Any] = {"head_radius": 2.4 * size, "head_length": 5 * size}
        look = {"shaft_radius": size, "visible": False} | head
        return self._scene.add_arrows(name, points, _rgb(colour), **look)

    def _rigid_bodies(self, frame: Snapshot) -> Sequence[RigidBody]:
        """Return the rigid bodies of an instant."""
        places, axes = frame.obstacles, [None] * len(frame.obstacles)
        if len(frame.axes):
            axes = [axis[None] for axis in frame.axes]
        run = Keyframes(
            label="",
            records=1,
            omitted=0,
            at=np.zeros(1, int),
            time=np.array([frame.time]),
            position=frame.nodes[None],
            diameter=self._diameter,
            target=frame.target[None],
            fields=(),
            mount=self._mount(frame),
            obstacles=tuple(
                Obstacle.of(name, described, place[None], axis, self._solids.get(name))
                for name, described, place, axis in zip(
                    self._names, self._obstacles, places, axes, strict=True
                )
            ),
            water=None,
            tool=self._tool,
            held=np.array([frame.holding]),
        )
        scene = Scene(not self._planar, self._length, len(frame.nodes), (run,))
        return [body for body in rigid_bodies(scene, run) if body.name != "target"]

    def _mount(self, frame: Snapshot) -> ArmMount:
        poses = {"base_servo": frame.servo, "base_pose": frame.pose, "vehicle_pose": frame.vehicle}
        values = {
            (kind, name): np.array([value])
            for kind, pose in poses.items()
            if pose is not None
            for name, value in zip(self._channels, pose, strict=True)
        }
        return mount_of(self._held, frame.nodes[None, :2], values, {})

    def _add_body(self, body: RigidBody) -> tuple[Any, Points]:
        """Add a rigid body; return its handle, and the points of its shape."""
        mesh = body.shape.mesh()
        colour = {"steel": INK, "tool": GREEN}.get(body.material, GREY)
        wall = body.shape.kind == "plate"
        colour = PALE if wall else VERMILLION if "debris" in body.name else colour
        look = _PLAIN | {"color": _rgb(colour), "opacity": 0.8 if wall else None, "side": "double"}
        points = mesh.points @ body.attitude[0].T
        handle = self._scene.add_mesh_simple(f"/{body.name}", points, mesh.triangles, **look)
        return handle, mesh.points

    def _show_bodies(self, frame: Snapshot) -> None:
        bodies = {body.name: body for body in self._rigid_bodies(frame)}
        for name in self._handles.keys() - bodies.keys():  # a boom of no length
            self._handles[name][0].visible = False
        for body in bodies.values():
            if body.name not in self._handles:
                self._handles[body.name] = self._add_body(body)
            handle, points = self._handles[body.name]
            handle.visible = bool(body.scale.any())
            if body.kind == "obstacle":
                handle.position = body.position[0]
                handle.vertices = (points @ body.attitude[0].T).astype(np.float32)
            elif handle.visible:
                # vertices, as the page would show a new position sooner than the arm's vertices
                handle.vertices = body.transform(points, 0).astype(np.float32)

    def _show_water(self, frame: Snapshot) -> None:
        """Show the water as arrows whose heads are close to the arm."""
        chosen = np.linspace(1, len(frame.nodes) - 1, _ARROWS).round().astype(int)
        velocity = frame.flow[chosen]
        speed = np.linalg.norm(velocity, axis=1)
        self._fastest = max(self._fastest, float(speed.max()))
        shown = self._fastest > 0 and speed.max() > _SLOWEST * self._fastest
        self._water.visible = bool(shown)
        if shown:
            # an arrow of length zero has no direction
            velocity = np.where(speed[:, None] > 1e-9, velocity, 1e-9 * np.array([1.0, 0.0, 0.0]))
            unit = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
            apart = self._diameter[chosen, None] / 2 + _GAP * self._length
            head = frame.nodes[chosen] - apart * unit
            tail = head - _REACH * self._length / self._fastest * velocity
            self._water.points = np.stack([tail, head], axis=1)


def arm_mesh(nodes: Points, diameter: Sequence[float] | np.ndarray) -> Mesh:
    """Return the surface of an arm along a smooth line through its nodes (m)."""
    count = np.arange(len(nodes))
    fine = np.linspace(0, len(nodes) - 1, (len(nodes) - 1) * _FINER + 1)
    line = CubicSpline(count, nodes)(fine)
    tangent = unit_vectors(np.gradient(line, axis=0))
    # y is no reference where the arm is parallel to it
    aside = np.eye(3)[1 if abs(tangent[:, 1]).max() <= 0.9 else abs(tangent).max(axis=0).argmin()]
    return tube(line, np.interp(fine, count, diameter) / 2, look_rotation(tangent, aside))


def _decade(length: float) -> float:
    """Return the power of ten closest to a length."""
    return float(10.0 ** np.round(np.log10(length)))


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
