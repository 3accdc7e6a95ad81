"""The shape of an arm at rest, for engines whose rods begin with an edge that is held."""

import numpy as np
from scipy.spatial.transform import Rotation

from crinoid.scenario.arm import Arm


def rest_shape(arm: Arm, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """Return places and frames of as many vertices as the arm has nodes, the first at the origin.

    The arm points along x where it is held, which is in the middle of the first edge, and has the
    same curvature everywhere.

    Parameters
    ----------
    arm
        Its number of nodes and its rest curvature: kappa_2 alone or kappa_1, kappa_2 and twist.
    edge
        Length of an edge (m).

    Returns
    -------
    places
        Of the vertices, ``(nodes, 3)`` in m.
    frames
        Tangent, m_1 and m_2 of each edge as rows, ``(nodes - 1, 3, 3)``.
    """
    strains = arm.rest_curvature
    one, two, twist = strains if isinstance(strains, tuple) else (0.0, strains, 0.0)
    # bending toward m_1 turns about m_2, bending toward m_2 about -m_1
    turns = np.outer(edge * np.arange(arm.nodes - 1), [twist, -two, one])
    frames = Rotation.from_rotvec(turns).as_matrix().transpose(0, 2, 1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(edge * frames[:, 0], axis=0)]), frames
