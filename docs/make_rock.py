"""Write the rock that the built-in scenario `reef` leans on.

    python docs/make_rock.py

It is synthetic: a sphere whose points move along their normals by a sum of plane waves of random
direction and phase, flattened below. Its size is about 0.36 m by 0.3 m by 0.2 m.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

import crinoid.scenario

ROCK = Path(crinoid.scenario.__file__).parent / "library" / "reef.ply"
SIZE, SEED, WAVES = np.array([0.18, 0.15, 0.12]), 5, 12


def rock() -> trimesh.Trimesh:
    """Return the mesh, the middle of its foot at the origin."""
    mesh = trimesh.creation.icosphere(subdivisions=3)
    random = np.random.default_rng(SEED)
    ways = random.normal(size=(WAVES, 3))
    ways *= (random.uniform(2.0, 6.0, WAVES) / np.linalg.norm(ways, axis=1))[:, None]
    waves = np.sin(mesh.vertices @ ways.T + random.uniform(0, 2 * np.pi, WAVES))
    rough = 1 + 0.3 * waves.mean(axis=1) / np.sqrt(0.5 / WAVES) * 0.5
    points = rough[:, None] * mesh.vertices * SIZE
    points[:, 2] = np.maximum(points[:, 2], -0.05) + 0.05
    mesh.vertices = points
    return mesh


if __name__ == "__main__":
    ROCK.write_bytes(rock().export(file_type="ply"))
