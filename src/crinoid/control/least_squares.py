"""The inverse of a Jacobian that may have lost a direction."""

import numpy as np
from jaxtyping import Float

_NEAR_SINGULAR = 0.05
"""Singular value, over the largest one, below which the inverse is damped."""


def damped_inverse(jacobian: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "n m"]:
    """Return the least-squares inverse, damped where the Jacobian is nearly rank deficient.

    A singular value ``s`` is inverted as ``1 / s`` down to ``e``, a twentieth of the largest, and
    as ``s / e^2`` below: damped least squares, ``s / (s^2 + d^2)``, with ``d^2 = e^2 - s^2`` for
    each singular value by itself (Nakamura and Hanafusa 1986; Maciejewski and Klein 1988). An
    error that hardly any command undoes asks for little, one that none undoes for nothing.
    """
    u, values, vt = np.linalg.svd(jacobian, full_matrices=False)
    largest = values.max(initial=0.0)
    if not largest:
        return np.zeros(jacobian.T.shape)
    return (vt.T * (values / np.maximum(values, _NEAR_SINGULAR * largest) ** 2)) @ u.T
