"""MCAP with a layout of Foxglove for the log: the arm in space, and plots of its topics."""

import json
from typing import Any

from crinoid.view.export.ros import joints_of, topics_of, write_log
from crinoid.view.export.source import Files, Report, Shapes

_DISTANCE = 2.5  # distance of the camera, of the length of the arm


def write_mcap(source: Shapes, files: Files, report: Report) -> list[str]:
    """Write a log of ROS 2 in the format MCAP, and a layout of Foxglove for it."""
    log, layout = files
    write_log(source, log, report)
    layout.write_text(json.dumps(layout_of(source), indent=1), "utf-8")
    return []


def layout_of(source: Shapes) -> dict[str, Any]:
    """Return a layout; x points to the right and z up, as in the figures."""
    scene = source.scene
    axes, there = "xyz" if scene.spatial else "xz", topics_of(source.data)
    tip = [topic for topic in ("/tip/pose", "/tip/target") if topic in there]
    plots = {
        "tip": [f"{topic}.pose.position.{axis}" for axis in axes for topic in tip],
        "commands": [
            f"/commands.position[{k}]" for k in range(len(joints_of(source.data, "/commands")))
        ],
        "force on the base": [
            f"/base/wrench.wrench.force.{axis}" for axis in axes if "/base/wrench" in there
        ],
        "current at the tip": [
            f"/tip/current.vector.{axis}" for axis in axes if "/tip/current" in there
        ],
    }
    panels: dict[str, dict[str, Any]] = {
        f"Plot!{title}": {
            "title": title,
            "paths": [
                {"value": path, "enabled": True, "timestampMethod": "headerStamp"} for path in paths
            ],
            "xAxisVal": "timestamp",
            "showLegend": True,
        }
        for title, paths in plots.items()
        if paths
    }
    layout: Any = None
    for name in reversed(panels):
        layout = {"first": name, "second": layout, "direction": "column"} if layout else name
    panels["3D!arm"] = {
        "followTf": "world",
        "followMode": "follow-none",
        "topics": {
            name: {"visible": True} for name in ("/arm/markers", *({"/tip/target"} & there))
        },
        "cameraState": {
            "perspective": True,
            "targetOffset": source.run.position[0].mean(axis=0).tolist(),
            "distance": _DISTANCE * scene.length,
            "phi": 80.0,
            "thetaOffset": 0.0,
            "fovy": 45.0,
            "near": 1e-2 * scene.length,
            "far": 1e3 * scene.length,
        },
    }
    return {
        "globalVariables": {"crinoid_version": source.attributes["crinoid_version"]},
        "configById": panels,
        "layout": {"first": "3D!arm", "second": layout, "direction": "row"},
    }
