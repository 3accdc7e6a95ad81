"""The arm and what is about it, in three dimensions on the page."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser
from jaxtyping import Float

from crinoid.live.frame import Frame
from crinoid.live.meshes import capsule, quaternion, tube, tube_triangles, turned
from crinoid.live.props import Props
from crinoid.report.solids import Solid
from crinoid.report.style import BLUE, GREEN, GREY, INK, ORANGE, PALE, SKY, VERMILLION
from crinoid.scenario import Scenario

__all__ = ["Scene"]

Point = Float[np.ndarray, "axis=3"]

_ARROWS = 7
_REACH = 0.22
"""Length of the arrow of the scenario's fastest water, over the arm's."""
_SLOWEST = 0.02
"""Share of that speed below which no arrow is shown."""
_GAP = 0.02
"""Distance of their heads from the arm, over its length."""
_PULLED = 0.3
"""Length of the arrow of a pull, over the arm's."""
_TRAIL = 240
"""Instants that the tip's trail goes back."""
_ENDLESS = 4.0
"""Length of what has no end, over the arm's."""
_PLAIN: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}


class Scene:
    """The arm, its target and all that moves about it, as nodes of a viser scene.

    Parameters
    ----------
    server
        The page.
    scenario
        What is simulated.
    props
        What is thrown.
    frame
        The first instant.
    """

    def __init__(
        self, server: viser.ViserServer, scenario: Scenario, props: Props, frame: Frame
    ) -> None:
        self._server, self._scene, self._length = server, server.scene, scenario.arm.length
        self._planar = scenario.arm.dimension == 2
        self.axes = (0, 2) if self._planar else (0, 1, 2)
        """Axes of space in which the arm moves."""
        self._radius = np.asarray(scenario.arm.diameters) / 2
        self._radius = np.maximum(self._radius, 0.004 * self._length)
        self._fastest, self._trail = 0.0, np.repeat(frame.nodes[-1:], _TRAIL, axis=0)
        self._last = -1.0
        self.dragged = False
        """Whether somebody holds the target."""
        self._place_camera(frame)
        self._build(scenario, props, frame)
        self.show(frame)

    def show(self, frame: Frame) -> None:
        """Show an instant."""
        if frame.time < self._last:
            self._trail[:] = frame.nodes[-1]
        if frame.time != self._last:
            self._trail = np.concatenate([self._trail[1:], frame.nodes[-1:]])
        self._last = frame.time
        with self._server.atomic():
            self._arm.vertices = tube(frame.nodes, self._radius).astype(np.float32)
            self._path.points = np.stack([self._trail[:-1], self._trail[1:]], axis=1)
            self._hold(frame)
            self._flow(frame)
            for put, place in zip(self._solids, frame.obstacles, strict=True):
                put(place)
            self._tip(frame)
            if not self.dragged:
                self.target.position = frame.target
            self._aim.position = frame.target

    def _place_camera(self, frame: Frame) -> None:
        middle = frame.nodes.mean(axis=0)
        away = np.array([0.0, -1.0, 0.12]) if self._planar else np.array([0.75, -1.0, 0.55])
        camera = self._server.initial_camera
        camera.position = middle + 1.75 * self._length * away / np.linalg.norm(away)
        camera.look_at, camera.up, camera.fov = middle, (0.0, 0.0, 1.0), np.deg2rad(45)
        camera.near, camera.far = 0.01 * self._length, 200 * self._length

    def _build(self, scenario: Scenario, props: Props, frame: Frame) -> None:
        scene, length = self._scene, self._length
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
        self._arm = scene.add_mesh_simple(
            "/arm",
            tube(frame.nodes, self._radius),
            tube_triangles(len(frame.nodes)),
            color=_rgb(ORANGE),
            side="double",
            **_PLAIN,
        )
        self._path = scene.add_line_segments(
            "/trail", np.zeros((_TRAIL - 1, 2, 3)), _rgb(GREY), thickness=0.003 * length
        )
        self._socket, triangles = capsule(
            np.array([0.0, 0.0, 0.03 * length]), 1.4 * float(self._radius[0])
        )
        self._mount = scene.add_mesh_simple(
            "/mount", self._socket, triangles, color=_rgb(INK), side="double", **_PLAIN
        )
        self._ball = scene.add_icosphere(
            "/tool", _ball(scenario), _rgb(GREEN), visible=False, **_PLAIN
        )
        self._water = self._arrows("/water", SKY, _ARROWS, 0.006)
        self._pull = self._arrows("/pull", VERMILLION, 1, 0.01)
        tables = scenario.to_dict().get("obstacle", [])
        self._solids = [
            self._solid(f"/obstacle/{index}", Solid.of(table)) for index, table in enumerate(tables)
        ]
        if props.debris is not None:
            ball = Solid("sphere", props.debris.radius, np.zeros(3), np.zeros(3))
            self._solids.append(self._solid("/debris", ball, VERMILLION))
        self._aim = scene.add_icosphere("/aim", 0.016 * length, _rgb(BLUE), opacity=0.7, **_PLAIN)
        self.target = scene.add_transform_controls(
            "/target",
            scale=0.14 * length,
            active_axes=(True, not self._planar, True),
            disable_rotations=True,
            depth_test=False,
            position=frame.target,
        )

    def _arrows(self, name: str, colour: str, count: int, thick: float) -> Any:
        size = thick * self._length
        return self._scene.add_arrows(
            name,
            np.tile(np.array([[0.0, 0.0, 0.0], [self._length, 0.0, 0.0]]), (count, 1, 1)),
            _rgb(colour),
            shaft_radius=size,
            head_radius=2.4 * size,
            head_length=5 * size,
            visible=False,
        )

    def _solid(self, name: str, solid: Solid, colour: str = GREY) -> Callable[[Point], None]:
        """Add an obstacle; return what puts it at a place."""
        scene, shift = self._scene, np.zeros(3)
        handle: Any
        if solid.kind == "plane":
            wide, thick = _ENDLESS * self._length, 0.004 * self._length
            shift = -thick / 2 * solid.out
            handle = scene.add_box(
                name,
                _rgb(PALE),
                (wide, wide, thick),
                wxyz=quaternion(solid.out),
                opacity=0.8,
                **_PLAIN,
            )
        elif solid.half_axis.any():
            half, most = solid.half_axis, _ENDLESS / 2 * self._length
            half = half * min(1.0, most / float(np.linalg.norm(half)))
            points, triangles = capsule(half, solid.radius)
            handle = scene.add_mesh_simple(
                name, points, triangles, color=_rgb(colour), side="double", **_PLAIN
            )
        else:
            handle = scene.add_icosphere(name, solid.radius, _rgb(colour), subdivisions=4, **_PLAIN)

        def put(place: Point) -> None:
            if solid.kind == "plane":  # it has no end: shown where the arm is
                place = (place @ solid.out) * solid.out
            handle.position = place + shift

        return put

    def _hold(self, frame: Frame) -> None:
        """Show the mount behind the root, in line with the first edge."""
        ahead = frame.nodes[1] - frame.nodes[0]
        ahead /= np.linalg.norm(ahead)
        # as a mesh, like the arm: the page would bring a mere shift sooner than that
        middle = frame.nodes[0] - 0.03 * self._length * ahead
        self._mount.vertices = (middle + turned(self._socket, ahead)).astype(np.float32)

    def _flow(self, frame: Frame) -> None:
        """Show the water as arrows that end just before the arm."""
        chosen = np.linspace(1, len(frame.nodes) - 1, _ARROWS).round().astype(int)
        velocity = frame.flow[chosen]
        speed = np.linalg.norm(velocity, axis=1)
        self._fastest = max(self._fastest, float(speed.max()))
        shown = self._fastest > 0 and speed.max() > _SLOWEST * self._fastest
        self._water.visible = bool(shown)
        if shown:
            # an arrow of no length has no direction
            velocity = np.where(speed[:, None] > 1e-9, velocity, 1e-9 * np.array([1.0, 0.0, 0.0]))
            unit = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
            head = frame.nodes[chosen] - (self._radius[chosen, None] + _GAP * self._length) * unit
            tail = head - _REACH * self._length / self._fastest * velocity
            self._water.points = np.stack([tail, head], axis=1)

    def _tip(self, frame: Frame) -> None:
        """Show what the tip carries, and what pulls at it."""
        ahead = frame.nodes[-1] - frame.nodes[-2]
        ahead /= np.linalg.norm(ahead)
        self._ball.visible = frame.holding
        self._ball.position = frame.nodes[-1] + self._ball.radius * ahead
        size = float(np.linalg.norm(frame.pull))
        self._pull.visible = size > 0
        if size > 0:
            head = frame.nodes[-1] + _PULLED * self._length * frame.pull / size
            self._pull.points = np.stack([frame.nodes[-1], head])[None]


def _ball(scenario: Scenario) -> float:
    """Return the radius of the ball that stands for a tool (m)."""
    tool, least = scenario.tool, 0.5 * max(scenario.arm.diameters)
    return least if tool is None else max(least, (0.75 / np.pi * tool.volume) ** (1 / 3))


def _decade(length: float) -> float:
    """Return the power of ten that is nearest to a length."""
    return float(10.0 ** np.round(np.log10(length)))


def _rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of ``#rrggbb``."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
