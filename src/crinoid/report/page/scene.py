"""The scene of the page as data: a table of all there is, and the numbers packed."""

from typing import Any

import numpy as np
import xarray as xr

from crinoid.report.charts.space import Field, Moving, Space, lacking, ranges_of, space_of
from crinoid.report.page.pack import Pack
from crinoid.report.solids import Body

FRAMES = 1501
"""Most instants of a run: 30 s at 50 a second."""
NODES = 201
NUMBERS = 600_000
"""Most coordinates of all arms together, over which instants are left out."""
_FINE = 1 / 16384
"""Step to which positions are rounded, of the arm's length."""
_LEVELS = 250
"""Levels of a colour."""


def shown(members: list[tuple[str, xr.Dataset]]) -> Space:
    """Return what the page shows of some runs: no more instants and nodes than it may hold."""
    first = members[0][1]
    coordinates = min(first.sizes["node"], NODES) * first.sizes["axis"] * len(members)
    return space_of(members, max(2, min(FRAMES, NUMBERS // coordinates)), NODES)


def scene_of(space: Space) -> tuple[dict[str, Any], str, list[str]]:
    """Return the table of a scene, its numbers in letters, and what was left out, in words."""
    pack, ranges = Pack(), ranges_of(space)
    table = {
        "spatial": space.spatial,
        "length": space.length,
        "set": space.ahead.tolist(),
        "fields": [
            {"name": f.name, "label": f.label, "unit": f.unit, "signed": f.signed}
            | dict(zip(("low", "high"), ranges[f.name], strict=True))
            for f in space.members[0].fields
        ],
        "members": [_member(each, space, ranges, pack) for each in space.members],
        "water": _water(space, pack),
    }
    return table, pack.text(), _left_out(space)


def _member(
    each: Moving, space: Space, ranges: dict[str, tuple[float, float]], pack: Pack
) -> dict[str, Any]:
    fine = _FINE * space.length
    root = each.position[:, 0]
    flat = slice(None) if space.spatial else slice(None, None, 2)  # a planar arm has no y
    offset = (each.position - root[:, None])[..., flat]

    def colours(field: Field) -> dict[str, Any]:
        low, high = ranges[field.name]
        return pack.add(np.clip(field.values, low, high), (high - low) / _LEVELS, low)

    def body(one: Body) -> dict[str, Any]:
        path = one.path if one.moves else one.path[:1]
        solid = one.solid
        shape = {"kind": solid.kind, "radius": solid.radius, "path": pack.add(path, fine)}
        return shape | {"half": solid.half_axis.tolist(), "out": solid.out.tolist()}

    mount, target = each.mount, each.target
    still = bool(np.ptp(target, axis=0).max() < 1e-6)
    return {
        "label": each.label,
        "time": [round(float(t), 6) for t in each.time],
        "nodes": each.position.shape[1],
        "diameter": [round(float(d), 6) for d in each.diameter],
        "root": pack.add(root, fine),
        "offset": pack.add(offset, fine),
        "fields": {field.name: colours(field) for field in each.fields},
        "target": pack.add(target[:1] if still else target, fine),
        "anchor": pack.add(mount.anchor, fine),
        "ahead": pack.add(mount.ahead, 1e-4, -1.0),
        "frame": pack.add(mount.frame, 1e-4, -1.0),
        "rails": mount.rails,
        "bodies": [body(one) for one in each.bodies],
        "tool": None if each.tool is None else {"radius": each.tool[0], "offset": each.tool[1]},
        "held": pack.add(each.held.astype(float), 1.0, 0.0),
    }


def _water(space: Space, pack: Pack) -> dict[str, Any] | None:
    water = space.members[0].water
    if water is None:
        return None
    fast = water.scale * space.length
    return {
        "start": water.start.tolist(),
        "scale": water.scale,
        "velocity": pack.add(water.velocity, fast / 4096),
    }


def _left_out(space: Space) -> list[str]:
    said = lacking(space)
    for each in space.members:
        if each.records > each.time.size + each.lacking:
            whose = f" {each.label}" if each.label else ""
            said.append(
                f"The animation{whose} shows {each.time.size} of {each.records} saved instants, "
                "and glides between them."
            )
    shown = space.members[0].position.shape[1]
    if space.nodes > shown:
        said.append(f"The arm is drawn by {shown} of its {space.nodes} nodes.")
    return said
