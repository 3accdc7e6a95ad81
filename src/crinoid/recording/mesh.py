"""Meshes of files: signed distances from them on a grid."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.ndimage import spline_filter
from scipy.spatial.transform import Rotation

from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.cache_folder import cache_folder
from crinoid.foundation.version import __version__
from crinoid.recording.signed_distance import Triangles
from crinoid.recording.solid_shapes import clustered, section
from crinoid.recording.solid_surface import SolidSurface, SplineOnGrid
from crinoid.recording.texts import reason_of, short
from crinoid.scenario import Mesh, Scenario, got, refusal, shown

_USUAL, _MOST = 200_000, 20_000_000  # values of a grid by default at most, and at most
_ROUNDED = 0.05  # error of distances that is said, over the radius of the arm; as thick is the skin
_CHECKED = 500  # places around a mesh where distances on the grid are compared with exact ones
_FEW = 8  # number of vertices of a body that are tested for being inside another body
_SHEET = 0.08  # half of the thickness by which a solid in a plane is drawn, of the arm's length

Vector = Float[np.ndarray, " axis"]


def read_mesh(table: Mesh, scenario: Scenario) -> SolidSurface:
    """Read a mesh, and sample distances from it on a grid, or from its cut by the plane y = 0."""
    notes: list[str] = []
    mesh, planar = _closed_mesh(table, notes), scenario.arm.dimension == 2
    radii, axes = np.asarray(scenario.arm.diameters) / 2, [0, 2] if planar else [0, 1, 2]
    cut, (low, high) = _cut(mesh, table) if planar else (None, mesh.bounds)
    size, reach = (high - low)[axes], _largest_radius(scenario)
    spacing = table.spacing
    if spacing is None:
        fair = np.prod(size + 2 * reach) / _USUAL
        spacing = max(float(radii.min()) / 2, float(fair) ** (1 / size.size))
    room = 1.5 * reach + 3 * spacing
    counts = np.ceil((size + 2 * room) / spacing) + 1
    if (many := float(np.prod(counts))) > _MOST:
        least = spacing * (many / _MOST) ** (1 / size.size)
        must = f"be at least {least:.2g} (m) for a solid of {_sides(size)}"
        raise refusal("spacing", got(spacing, must, _in_mm(size, scenario)))
    triangles = _of_size(mesh, 4 * spacing) if cut is None else cut
    origin, within = low - room, 1.2 * reach + 2 * spacing
    places = [origin[x] + spacing * np.arange(n) for x, n in zip(axes, counts, strict=True)]
    if planar:
        places.insert(1, np.zeros(1))
    key = repr((__version__, table, spacing, within, planar))
    values = _kept(mesh, key, lambda: triangles.on_grid(places, within)).squeeze()
    spline = SplineOnGrid(spline_filter(values, order=3), origin[axes], np.full(size.size, spacing))
    error = _rounding(mesh, triangles, spline, axes, float(radii.min()))
    if error > _ROUNDED * radii.min():
        text = f"its surface is rounded by up to {1e3 * error:.2g} mm on a grid of "
        notes.append(f"{text}{1e3 * spacing:.3g} mm. Set a smaller spacing for finer features")
    if hint := _in_mm(size, scenario):
        notes.append(f"{short(table.file)} is a solid of {_sides(size)}. {hint}")
    if planar:
        shape = section(values, places[0], places[2], _SHEET * scenario.arm.length)
    else:
        shape = clustered(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    return SolidSurface(spline, False, *shape, tuple(notes))


def _largest_radius(scenario: Scenario) -> float:
    """Return the largest radius of the arm, its tool and the free bodies, which a solid touches."""
    free = [getattr(each, "radius", 0.0) for each in scenario.obstacle if each.free]
    tool = 0.0 if scenario.tool is None else scenario.tool.radius or 0.0
    return max(float(np.max(scenario.arm.diameters)) / 2, tool, *free)


def _closed_mesh(table: Mesh, notes: list[str]) -> Any:
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
        if not mesh.is_watertight:  # a corner may be there once for each texture or normal
            mesh = trimesh.Trimesh(mesh.vertices, mesh.faces)
        faces, finite = len(mesh.faces), bool(np.isfinite(mesh.vertices).all())
    except Exception as error:  # libraries raise anything on a damaged file
        text = f"{name} is broken or no known mesh ({reason_of(error)})"
        raise refusal("file", text, "be an STL, OBJ, PLY or GLB file") from error
    if not faces or not finite:
        text = "has no triangle" if not faces else "has a corner that is not finite"
        raise refusal("file", f"{name} {text}", "be a mesh of triangles")
    mesh = _turned_outward(mesh, name, notes)
    angles = table.pan_deg, -table.tilt_deg, table.roll_deg
    turn = Rotation.from_euler("ZYX", angles, degrees=True)
    if Path(table.file).suffix.lower() in (".glb", ".gltf"):  # y is up
        turn = turn * Rotation.from_euler("x", 90, degrees=True)
    frame = np.eye(4)
    frame[:3, :3] = table.scale * turn.as_matrix()
    mesh.apply_transform(frame)
    return mesh


def _turned_outward(mesh: Any, name: str, notes: list[str]) -> Any:
    """Return a mesh whose closed bodies point outward, or inward as a hollow of another one."""
    from trimesh.util import concatenate

    bodies = mesh.split(only_watertight=False, repair=False)
    if not all(e.is_watertight and e.is_winding_consistent and abs(e.volume) > 0 for e in bodies):
        text = f"{name} has holes, or faces that point in and out"
        hint = "Repair it: in MeshLab close its holes, or trimesh.repair.fill_holes(mesh)."
        raise refusal("file", text, "be a closed surface", hint)
    low, high = np.array([each.bounds for each in bodies]).swapaxes(0, 1)
    wrong = []
    for index, body in enumerate(bodies):
        around = ((low < low[index]) & (high > high[index])).all(axis=1)
        places, hollow = body.vertices[:: 1 + len(body.vertices) // _FEW], False
        for other in (bodies[at] for at in np.flatnonzero(around)):
            apart = Triangles(other.triangles, other.face_normals).distance(places)
            hollow ^= bool((np.sign(other.volume) * apart < 0).all())
        wrong += [body] if (body.volume < 0) != hollow else []
    for body in wrong:
        body.faces = body.faces[:, ::-1]  # invert() leaves normals of a part as they are
    if 0 < len(wrong) < len(bodies):
        text = f"{len(wrong)} of {len(bodies)} bodies of {name} were inside out and are turned"
        notes.append(f"{text}: a body inside of another one is a hollow")
    return concatenate(bodies)


def _of_size(mesh: Any, longest: float) -> Triangles:
    """Return the triangles of a mesh, parted where they are too long to be found fast."""
    from trimesh.remesh import subdivide_to_size

    corners, faces, whole = subdivide_to_size(
        mesh.vertices, mesh.faces, longest, max_iter=30, return_index=True
    )
    return Triangles(np.asarray(corners[faces]), np.asarray(mesh.face_normals[whole]))


def _cut(mesh: Any, table: Mesh) -> tuple[Triangles, tuple[Vector, Vector]]:
    """Return the outline of a mesh in the plane y = 0, and the corners of its extent (m)."""
    from trimesh.intersections import mesh_plane

    # not through corners, as of a mesh that is symmetric
    across = np.array([0.0, 1.4e-9 * mesh.scale, 0.0])
    lines, faces = mesh_plane(mesh, [0.0, 1.0, 0.0], across, return_faces=True)
    if not len(lines):
        low, high = mesh.bounds[:, 1]
        text = f"{short(table.file)} is at y = {low:.4g} to {high:.4g} m"
        raise refusal("file", text, "meet the plane of the arm, y = 0")
    long = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) > 1e-12 * mesh.scale
    lines, normals = lines[long], np.array(mesh.face_normals[faces[long]])
    lines[:, :, 1] = normals[:, 1] = 0.0
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ends = lines.reshape(-1, 3)
    return Triangles(lines[:, [0, 1, 1]], normals), (ends.min(axis=0), ends.max(axis=0))


def _kept(mesh: Any, key: str, sample: Callable[[], np.ndarray]) -> np.ndarray:
    """Return values that are sampled once for a mesh and a key, and kept in the cache folder."""
    digest = hashlib.sha256(mesh.triangles.tobytes() + key.encode()).hexdigest()[:32]
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
    mesh: Any, triangles: Triangles, spline: SplineOnGrid, axes: list[int], radius: float
) -> float:
    """Return the error of the grid (m) at places one radius of the arm away from the corners."""
    away = np.asarray(mesh.vertices + radius * mesh.vertex_normals)
    away = away[:: 1 + len(away) // _CHECKED]
    if len(axes) == 2:
        away[:, 1] = 0.0
    exact = triangles.distance(away)
    touched = (exact > 0) & (exact < 1.2 * radius)
    return float(np.abs(spline.at(away[:, axes]) - exact)[touched].max(initial=0.0))


def _sides(size: np.ndarray) -> str:
    return " x ".join(f"{side:.3g}" for side in size) + " m"


def _in_mm(size: np.ndarray, scenario: Scenario) -> str:
    """Return a question where a solid is far larger or smaller than the arm."""
    large = float(size.max()) / scenario.arm.length
    if large > 100:
        return "Is the file in mm? Set scale = 0.001."
    return "Is its unit larger than m? Set scale." if large < 1e-2 else ""
