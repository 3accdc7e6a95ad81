"""Scene of a live session for its page: a table, and the numbers of each frame."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from crinoid.foundation.axes import CHANNELS
from crinoid.results.scene.data import Obstacle, SolidShape, ToolBall
from crinoid.results.scene.mount import mount_of
from crinoid.results.scene.scene import (
    CALM,
    REACH,
    Keyframes,
    NodeField,
    Scene,
    WaterArrows,
    arrow_nodes,
    arrow_starts,
)
from crinoid.view.live.session import LiveSession
from crinoid.view.live.session_log import Snapshot

NAMES = ("arm", "shape at the start")  # of the arm, and of its ghost


class LiveScene:
    """The arm, its target, rigid bodies and water of a session, made of its first instant."""

    def __init__(self, session: LiveSession, first: Snapshot) -> None:
        scenario, bodies = session.scenario, session.bodies
        self._scenario, self._spatial = scenario, scenario.arm.dimension == 3
        self._channels = CHANNELS[scenario.arm.dimension]
        self._obstacles = list(bodies.added_to(scenario).obstacle)
        self._parked = len(scenario.obstacle) if bodies.debris is not None else None
        self._solids = {
            name.removeprefix("obstacle."): SolidShape(read.points, read.facets)
            for name, read in session.prepared.surfaces.items()
        }
        self._tool = ToolBall.of(scenario.tool) if scenario.tool is not None else None
        self._arrows = arrow_nodes(first.nodes, scenario.arm.length)
        swept = np.concatenate([first.nodes, first.target[None]]) - first.nodes[0]
        mean = first.flow[self._arrows].mean(axis=0)
        self._starts = arrow_starts(first.nodes, self._arrows, swept, mean, scenario.arm.length)

    def scene(self, now: Snapshot, start: Snapshot) -> Scene:
        """Return an instant and the start as a scene, with all that stays fixed on the page."""
        arm, ghost = (self._keyframes(*each) for each in zip(NAMES, (now, start), strict=True))
        # any boom has a length, so that the page knows its radius
        mount = replace(arm.mount, anchor=arm.mount.anchor + arm.diameter[0])
        obstacles = list(arm.obstacles)
        if self._parked is not None:  # the view has the debris at the arm, and not far away
            obstacles[self._parked] = replace(obstacles[self._parked], path=now.nodes[-1:])
        arm = replace(arm, mount=mount, obstacles=tuple(obstacles))
        members = arm, replace(ghost, obstacles=())
        return Scene(self._spatial, self._scenario.arm.length, len(now.nodes), members)

    def numbers(self, frame: Snapshot) -> Float[np.ndarray, " number"]:
        """Return the numbers of an instant in the order of `bend` in `live.js`."""
        arm = self._keyframes("", frame)
        flat = slice(None) if self._spatial else slice(None, None, 2)
        mount, root = arm.mount, arm.position[0, 0]
        found: list[Any] = [root, (arm.position[0] - root)[:, flat], arm.target[0]]
        found += [mount.anchor[0], mount.direction[0], mount.attitude[0], arm.held]
        found += [field.values[0] for field in arm.fields]
        for body in arm.obstacles:
            found += [body.path[0], body.half_axis[0]]
        found += [] if arm.water is None else [arm.water.velocity[0]]
        return np.concatenate([np.ravel(each) for each in found])

    def _keyframes(self, label: str, frame: Snapshot) -> Keyframes:
        poses = {"base_servo": frame.servo, "base_pose": frame.pose, "vehicle_pose": frame.vehicle}
        values = {
            (kind, name): np.array([value])
            for kind, pose in poses.items()
            if pose is not None
            for name, value in zip(self._channels, pose, strict=True)
        }
        fields = (
            NodeField("curvature", "curvature", "1/m", not self._spatial, frame.curvature[None]),
            NodeField("speed", "speed", "m/s", False, frame.speed[None]),
        )
        return Keyframes(
            label=label,
            records=1,
            omitted=0,
            at=np.zeros(1, int),
            time=np.array([frame.time]),
            position=frame.nodes[None],
            diameter=np.array(self._scenario.arm.diameters),
            target=frame.target[None],
            fields=fields,
            mount=mount_of(self._scenario, frame.nodes[None, :2], values, {}),
            obstacles=tuple(self._bodies(frame)),
            water=self._water(frame),
            tool=self._tool,
            held=np.array([frame.holding]),
        )

    def _bodies(self, frame: Snapshot) -> Sequence[Obstacle]:
        axes = [axis[None] for axis in frame.axes] or [None] * len(frame.obstacles)
        rows = enumerate(zip(self._obstacles, frame.obstacles, axes, strict=True))
        return [
            Obstacle.of(str(index), described, place[None], axis, self._solids.get(str(index)))
            for index, (described, place, axis) in rows
        ]

    def _water(self, frame: Snapshot) -> WaterArrows | None:
        if not self._scenario.flow:
            return None
        velocity = frame.flow[self._arrows][None]
        fastest = max(CALM, float(np.linalg.norm(velocity, axis=-1).max()))
        return WaterArrows(self._starts, velocity, fastest / (REACH * self._scenario.arm.length))
