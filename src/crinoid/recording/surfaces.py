"""Solids of files: distances on a grid from a mesh, and heights of a bed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import map_coordinates, spline_filter
from scipy.spatial.transform import Rotation

from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.cache_folder import cache_folder
from crinoid.foundation.version import __version__
from crinoid.recording.axes import counts_down, find
from crinoid.recording.numbers import Column, check_count, finite_numbers, quantity
from crinoid.recording.readers import read_dataset
from crinoid.recording.signed_distance import Triangles
from crinoid.recording.texts import reason_of, short
from crinoid.recording.units import length_factor
from crinoid.scenario import Mesh, Scenario, Seabed, got, refusal
from crinoid.scenario.errors import counted, shown

_USUAL, _MOST = 200_000, 20_000_000
"""Values of a grid by default at most, and at most."""
_ROUNDED = 0.05
"""Error of distances that is said, over the radius of the arm; as thick is the skin."""
_CHECKED = 500
"""Number of places around a mesh where distances on the grid are compared with exact ones."""
_DRAWN = 40
"""Cells along the longest side of a solid as it is drawn."""
_SHEET = 0.08
"""Half of the thickness by which a solid in a plane is drawn, of the arm's length."""
_SHOWN = 1.5
"""Half of the side of a bed as it is drawn, of the arm's length."""
_EVEN = 1e-3
"""Largest deviation of steps of a coordinate from even ones, over a step."""
_DEEPEST = 12e3
"""Largest height or depth (m)."""

Points = Float[np.ndarray, "point axis=3"]
Facets = Int[np.ndarray, "facet corner=3"]


@dataclass(frozen=True)
class SolidSurface:
    """Surface of a solid, relative to its position: for contact a spline, for drawing triangles."""

    coefficients: Float[np.ndarray, ...]
    """Those of a cubic B-spline through distances or heights (m)."""
    origin: Float[np.ndarray, " axes"]
    """Place of the first value (m)."""
    spacing: Float[np.ndarray, " axes"]
    """Distance of the values along each axis (m)."""
    heights: bool
    """Whether values are heights, not signed distances."""
    points: Points
    facets: Facets
    notes: tuple[str, ...]


def surface_readers(scenario: Scenario) -> dict[str, Callable[[], SolidSurface]]:
    """Return the reader of each solid of a scenario, by its key."""
    found: dict[str, Callable[[], SolidSurface]] = {}
    for index, obstacle in enumerate(scenario.obstacle):
        if isinstance(obstacle, Mesh):
            found[f"obstacle.{index}"] = partial(read_mesh, obstacle, scenario)
        elif isinstance(obstacle, Seabed):
            found[f"obstacle.{index}"] = partial(read_seabed, obstacle, scenario)
    return found


def read_mesh(table: Mesh, scenario: Scenario) -> SolidSurface:
    """Read a mesh, and sample distances from it on a grid."""
    mesh, radii = _closed_mesh(table, scenario), np.asarray(scenario.arm.diameters) / 2
    planar = scenario.arm.dimension == 2
    axes = [0, 2] if planar else [0, 1, 2]
    if planar:
        triangles, low, high = _cut(mesh, table)
    else:
        low, high = mesh.bounds
    size = (high - low)[axes]
    spacing = table.spacing
    if spacing is None:
        # the grid has three more cells and the radius of the arm on each side
        least = float(radii.min()) / 2
        spacing = max(
            least,
            float(np.prod(size + 2 * radii.max())) ** (1 / len(axes))
            * (_USUAL ** (-1 / len(axes))),
        )
    room = 1.5 * radii.max() + 3 * spacing
    counts = np.ceil((size + 2 * room) / spacing).astype(int) + 1
    if (count := int(np.prod(counts.astype(float)))) > _MOST:
        least = spacing * (count / _MOST) ** (1 / len(axes))
        must = f"be at least {least:.2g} (m) for a solid of {_sides(size)}"
        raise refusal("spacing", got(spacing, must, _in_mm(size, scenario)))
    if not planar:
        triangles = _of_size(mesh, 4 * spacing)
    origin, within = low - room, 1.2 * radii.max() + 2 * spacing
    places = [origin[axis] + spacing * np.arange(n) for axis, n in zip(axes, counts, strict=True)]
    grid = [*places] if not planar else [places[0], np.zeros(1), places[1]]
    key = repr((__version__, table, spacing, within, planar, str(origin)))
    values = _kept(table.file, key, lambda: triangles.on_grid(grid, within).reshape(counts))
    coefficients = spline_filter(values, order=3)
    notes = _rounding(mesh, triangles, coefficients, origin[axes], spacing, axes, radii.min())
    if planar:
        drawn = _sheet(values, places, scenario.arm.length)
    else:
        drawn = _clustered(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    if hint := _in_mm(size, scenario):
        notes.append(f"{short(table.file)} is a solid of {_sides(size)}. {hint}")
    steps = np.full(len(axes), spacing)
    return SolidSurface(coefficients, origin[axes], steps, False, *drawn, tuple(notes))


def _closed_mesh(table: Mesh, scenario: Scenario) -> Any:
    """Return the mesh of a file, scaled and turned, which must enclose a volume."""
    try:
        import trimesh
    except ImportError as error:
        text = f"{short(table.file)} needs the library trimesh"
        raise refusal("file", f'{text}: pip install "crinoid[mesh]"') from error
    name = short(table.file)
    if not Path(table.file).is_file():
        raise refusal("file", f"{shown(table.file)}: no such file")
    try:
        mesh: Any = trimesh.load_mesh(table.file)
        faces, finite = len(mesh.faces), bool(np.isfinite(mesh.vertices).all())
    except Exception as error:  # libraries raise anything on a damaged file
        text = f"{name} is broken or no known mesh ({reason_of(error)})"
        raise refusal("file", text, "be an STL, OBJ, PLY or GLB file") from error
    if not faces or not finite:
        text = "has no triangle" if not faces else "has a corner that is not finite"
        raise refusal("file", f"{name} {text}", "be a mesh of triangles")
    if not (mesh.is_watertight and mesh.is_winding_consistent and abs(mesh.volume) > 0):
        text = f"{name} has holes, or faces that point in and out"
        hint = "Repair it: in MeshLab close its holes, or trimesh.repair.fill_holes(mesh)."
        raise refusal("file", text, "be a closed surface", hint)
    if mesh.volume < 0:
        mesh.invert()
    turn = Rotation.from_euler(
        "ZYX", (table.pan_deg, -table.tilt_deg, table.roll_deg), degrees=True
    )
    if Path(table.file).suffix.lower() in (".glb", ".gltf"):  # y is up
        turn = turn * Rotation.from_euler("x", 90, degrees=True)
    frame = np.eye(4)
    frame[:3, :3] = table.scale * turn.as_matrix()
    mesh.apply_transform(frame)
    return mesh


def _of_size(mesh: Any, longest: float) -> Triangles:
    """Return the triangles of a mesh, parted where they are too long to be found fast."""
    from trimesh.remesh import subdivide_to_size

    corners, faces, whole = subdivide_to_size(
        mesh.vertices, mesh.faces, longest, max_iter=30, return_index=True
    )
    return Triangles(np.asarray(corners[faces]), np.asarray(mesh.face_normals[whole]))


def _cut(mesh: Any, table: Mesh) -> tuple[Triangles, Any, Any]:
    """Return the outline of a mesh in the plane y = 0, and the ends of its extent (m)."""
    from trimesh.intersections import mesh_plane

    # no corner may lie in the plane: its triangles would have no cut
    across = np.array([0.0, 1e-9 * mesh.scale * np.sqrt(2), 0.0])
    lines, faces = mesh_plane(mesh, [0.0, 1.0, 0.0], across, return_faces=True)
    long = (
        np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) > 1e-12 * mesh.scale if len(lines) else []
    )
    if not np.any(long):
        low, high = mesh.bounds[:, 1]
        text = f"{short(table.file)} is at y = {low:.4g} to {high:.4g} m"
        raise refusal("file", text, "meet the plane of the arm, y = 0")
    lines, normals = lines[long], np.array(mesh.face_normals[faces[long]])
    lines[:, :, 1] = normals[:, 1] = 0.0
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ends = lines.reshape(-1, 3)
    return Triangles(lines[:, [0, 1, 1]], normals), ends.min(axis=0), ends.max(axis=0)


def _kept(file: str, key: str, sample: Callable[[], np.ndarray]) -> np.ndarray:
    """Return values that are sampled once for a file and a key, and kept in the cache folder."""
    digest = hashlib.sha256(Path(file).read_bytes() + key.encode()).hexdigest()[:32]
    folder = cache_folder(os.environ.get("JAX_COMPILATION_CACHE_DIR")) / "distances"
    path = folder / f"{digest}.npy"
    try:
        return np.asarray(np.load(path))
    except (OSError, ValueError):  # none yet, or a broken one
        values = sample()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with atomic_write(path) as temporary, temporary.open("wb") as stream:
            np.save(stream, values)
    except OSError:  # a folder that may not be written: sampled again the next time
        pass
    return values


def _rounding(
    mesh: Any,
    triangles: Triangles,
    coefficients: np.ndarray,
    origin: np.ndarray,
    spacing: float,
    axes: list[int],
    radius: float,
) -> list[str]:
    """Return a note where the grid rounds features, by distances one radius of the arm away."""
    away = np.asarray(mesh.vertices + radius * mesh.vertex_normals)
    away = away[:: 1 + len(away) // _CHECKED]
    if len(axes) == 2:
        away[:, 1] = 0.0
    exact = triangles.distance(away)
    places = (away[:, axes] - origin) / spacing
    found = map_coordinates(coefficients, places.T, order=3, prefilter=False, mode="nearest")
    touched = (np.abs(exact) < 1.2 * radius) & (exact > 0)
    error = float(np.abs(found - exact)[touched].max(initial=0.0))
    if error <= _ROUNDED * radius:
        return []
    text = (
        f"its surface is rounded by up to {1e3 * error:.2g} mm on a grid of {1e3 * spacing:.3g} mm"
    )
    return [f"{text}. Set a smaller spacing for finer features."]


def _sides(size: np.ndarray) -> str:
    return " x ".join(f"{side:.3g}" for side in size) + " m"


def _in_mm(size: np.ndarray, scenario: Scenario) -> str:
    """Return a question where a solid is far larger or smaller than the arm."""
    large = float(size.max()) / scenario.arm.length
    if large > 100:
        return "Is the file in mm? Set scale = 0.001."
    return "Is its unit larger than m? Set scale." if large < 1e-2 else ""


def _clustered(points: Points, facets: Facets) -> tuple[Points, Facets]:
    """Return a mesh whose points in one cell are one (Rossignac and Borrel 1993)."""
    cell = float(np.ptp(points, axis=0).max()) / _DRAWN
    if len(points) <= 2 * _DRAWN**2:
        return points, facets
    _, first, at = np.unique(
        np.floor(points / cell).astype(int), axis=0, return_index=True, return_inverse=True
    )
    merged = np.zeros((len(first), 3))
    np.add.at(merged, at.ravel(), points)
    merged /= np.bincount(at.ravel())[:, None]
    kept = at.ravel()[facets]
    whole = (kept != np.roll(kept, 1, axis=1)).all(axis=1)
    return merged, kept[whole]


def _sheet(values: np.ndarray, places: list[np.ndarray], length: float) -> tuple[Points, Facets]:
    """Return a slab of the section of a solid in the plane, where distances are negative."""
    from contourpy import contour_generator

    every = 1 + max(values.shape) // (2 * _DRAWN)
    x, z = (place[::every] for place in places)
    cells = contour_generator(x, z, values[::every, ::every].T, chunk_size=1)
    outlines = [
        line[:-1] for part in cells.filled(-np.inf, 0.0)[0] if part is not None for line in [part]
    ]
    return _extruded(outlines, _SHEET * length)


def _extruded(outlines: list[np.ndarray], half: float) -> tuple[Points, Facets]:
    """Return a slab over convex polygons in x and z that share corners, with its sides."""
    sizes = [len(each) for each in outlines]
    corners, at = np.unique(np.round(np.concatenate(outlines), 9), axis=0, return_inverse=True)
    number, fans = 0, []
    for size in sizes:
        ring = at.ravel()[number : number + size]
        number += size
        fans += [(ring[0], ring[i], ring[i + 1]) for i in range(1, size - 1)]
    caps = np.array(fans)
    edges = np.concatenate([caps[:, [0, 1]], caps[:, [1, 2]], caps[:, [2, 0]]])
    _, first, times = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    rim, count = edges[first[times == 1]], len(corners)
    wall = np.concatenate(
        [
            np.stack([rim[:, 0], rim[:, 0] + count, rim[:, 1]], axis=1),
            np.stack([rim[:, 1], rim[:, 0] + count, rim[:, 1] + count], axis=1),
        ]
    )
    # seen from -y, x to the right and z up: counter-clockwise there
    facets = np.concatenate([caps, caps[:, ::-1] + count, wall])
    points = np.zeros((2 * count, 3))
    points[:, [0, 2]] = np.tile(corners, (2, 1))
    points[:count, 1], points[count:, 1] = -half, half
    return points, facets


def read_seabed(table: Seabed, scenario: Scenario) -> SolidSurface:
    """Read the heights of a bed."""
    remarks: list[str] = []
    with read_dataset(table.file) as dataset:
        name = find(dataset, table.height, "height", table.file)
        names = [
            find(dataset, getattr(table, key), key, table.file)
            for key in ("x", "y")
            if key == "x" or dataset[name].ndim > 1
        ]
        check_count(dataset[name].size, table.file, name)
        variable = dataset[name]
        for dimension in [d for d, n in variable.sizes.items() if n == 1]:
            variable = variable.isel({dimension: 0})
        dims = [str(dataset[each].dims[0]) if dataset[each].ndim == 1 else "" for each in names]
        if sorted(dims) != sorted(map(str, variable.dims)):
            has = ", ".join(map(str, variable.dims)) or "none"
            text = f"{name} has dimensions {has}"
            raise refusal("height", text, f"have those of {' and '.join(names)}, one each")
        variable = variable.transpose(*dims)
        places = [_even(dataset, each, key) for key, each in zip("xy", names, strict=False)]
        values = quantity(
            dataset, variable, Column("height", name, length_factor, "m", _DEEPEST), remarks
        )
        down = counts_down(variable)
    if missing := int(np.sum(~np.isfinite(values))):
        text = f"{name} has {counted(missing, 'missing value')}"
        hint = "Fill them: dataset.interpolate_na(...), or cut out a part without."
        raise refusal("height", text, "be a number at each place", hint)
    values = -values if down else values
    orders = [np.argsort(place) for place in places]
    values = values[np.ix_(*orders)]
    low = np.array([place.min() for place in places])
    steps = np.array([np.ptp(place) / (place.size - 1) for place in places])
    _check_reach(table, scenario, low, low + steps * (np.array(values.shape) - 1), remarks)
    # constant beyond its ends
    coefficients, origin = spline_filter(np.pad(values, 4, mode="edge"), order=3), low - 4 * steps
    if scenario.arm.dimension == 2 and len(places) == 2:
        at = np.stack(
            [
                np.arange(coefficients.shape[0]),
                np.full(coefficients.shape[0], -origin[1] / steps[1]),
            ]
        )
        profile = map_coordinates(coefficients, at, order=3, prefilter=False)
        coefficients, origin, steps = spline_filter(profile, order=3), origin[:1], steps[:1]
    elif scenario.arm.dimension == 3 and len(places) == 1:
        raise refusal(
            "height", f"{name} has the dimension {dims[0]} alone", "have x and y in space"
        )
    drawn = _bed(coefficients, origin, steps, table, scenario)
    return SolidSurface(coefficients, origin, steps, True, *drawn, tuple(remarks))


def _even(dataset: Any, name: str, key: str) -> Float[np.ndarray, " place"]:
    """Return a coordinate in m, whose steps must be even."""
    variable = dataset[name]
    places = finite_numbers(variable, key, "places (m)").astype(float)
    units = str(variable.attrs.get("units", "")).strip()
    factor = length_factor(units or "m")
    if factor is None:
        hint = "Project longitudes and latitudes to m first, with pyproj say."
        raise refusal(key, f"{name} is in {shown(units)}", "be in a unit such as m", hint)
    if places.size < 4:
        raise refusal(key, f"{name} has {counted(places.size, 'place')}", "have at least 4")
    steps = np.diff(places)
    if np.ptp(steps) > _EVEN * abs(steps.mean()):
        text = f"{name} has steps of {steps.min():.4g} to {steps.max():.4g} {units}".strip()
        hint = f"Interpolate it: dataset.interp({name}=...)."
        raise refusal(key, text, "have even steps", hint)
    return factor * places


def _check_reach(
    table: Seabed, scenario: Scenario, low: np.ndarray, high: np.ndarray, remarks: list[str]
) -> None:
    """Refuse heights that are nowhere near the base; say where they end within the arm's reach."""
    base, place = (
        np.asarray(each, float)[:-1] for each in (scenario.base.position, table.position)
    )
    at = base - place
    if at.size < low.size:  # the plane of the arm
        at = np.append(at, 0.0)
    at, low, high = at[: low.size], low[: at.size], high[: at.size]
    if np.any((at < low) | (at > high)):
        sides = " and ".join(
            f"{axis} = {a:.6g} to {b:.6g} m" for axis, a, b in zip("xy", low, high, strict=False)
        )
        where = ", ".join(f"{each:.6g}" for each in at)
        hint = "Set position: where the origin of the file's axes is."
        raise refusal(
            "file",
            f"{short(table.file)} has {sides}; the base is at {where}",
            "contain the base",
            hint,
        )
    level = slice(0, base.size)
    room = np.minimum(at - low, high - at)[level].min()
    if room < scenario.arm.length:
        remarks.append(
            f"heights end {room:.3g} m from the base: outside, that of the nearest edge is taken"
        )


def _bed(
    coefficients: np.ndarray,
    origin: np.ndarray,
    steps: np.ndarray,
    table: Seabed,
    scenario: Scenario,
) -> tuple[Points, Facets]:
    """Return the surface of a bed around the base, in the plane with a part below."""
    half = _SHOWN * scenario.arm.length
    level = (np.asarray(scenario.base.position) - np.asarray(table.position))[:-1]
    axes = [middle + np.linspace(-half, half, 2 * _DRAWN + 1) for middle in level]
    places = np.stack(np.meshgrid(*axes, indexing="ij"))
    last = np.array(coefficients.shape).reshape(-1, *[1] * len(axes)) - 2
    at = (places - origin.reshape(last.shape)) / steps.reshape(last.shape)
    height = map_coordinates(coefficients, np.clip(at, 1, last), order=3, prefilter=False)
    if len(axes) == 1:
        foot = height.min() - 0.1 * scenario.arm.length
        x, rows = axes[0], range(height.size - 1)
        return _extruded(
            [
                np.array(
                    [[x[i], foot], [x[i + 1], foot], [x[i + 1], height[i + 1]], [x[i], height[i]]]
                )
                for i in rows
            ],
            _SHEET * scenario.arm.length,
        )
    points = np.concatenate([places, height[None]]).reshape(3, -1).T
    corner = np.arange(height.size).reshape(height.shape)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    facets = np.concatenate(
        [np.stack(each, axis=-1).reshape(-1, 3) for each in ((a, b, c), (a, c, d))]
    )
    return points, facets
