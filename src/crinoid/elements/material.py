"""Material: stress of a strain by a spring, a dashpot and Maxwell branches in parallel.

The relaxation modulus is ``E(t) = E (1 + sum_i ratio_i exp(-t / time_i))``, with the relaxed
modulus ``E``, for stretch, bend and twist alike. Over ``E`` the stress of a strain ``s`` is

``s + damping_time s' + sum_i b_i`` with ``b_i' = ratio_i s' - b_i / time_i``.

A time step integrates a branch exactly for a constant rate of strain (Simo and Hughes 1998,
Computational Inelasticity, section 10.3.1), to second order for others.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.foundation.fixed_numbers import BRANCH_FITS
from crinoid.rod import Rod


class Strained(NamedTuple):
    """Memory of a material: its strain, and the stress of each branch over the stiffness."""

    strain: Float[Array, "..."]
    branches: Float[Array, "... branch"]


class Material(eqx.Module):
    """Kelvin-Voigt material, with Maxwell branches if ``relaxation`` is not None.

    Strains are scalars, or those of a node. ``memory`` is that at the start of a step,
    without which methods give the relaxed material, as in an equilibrium.
    """

    damping_time: Float[Array, "*count"]
    """Viscosity over modulus (s)."""
    relaxation: Float[Array, "*count 2 branch"] | None = None
    """Of each branch the modulus over the relaxed one (1) and the relaxation time (s)."""

    @staticmethod
    def of(rod: Rod, count: int) -> "Material":
        """Return the material of ``count`` windows of a rod."""
        damping_time, relaxation = jnp.broadcast_to(rod.damping_time, (count,)), rod.relaxation
        if relaxation is not None:
            relaxation = jnp.broadcast_to(relaxation, (count, *relaxation.shape))
        return Material(damping_time, relaxation)

    def steady(self, strain: Float[Array, "..."]) -> Strained | None:
        """Return the memory of a strain that has lasted long."""
        if self.relaxation is None:
            return None
        return Strained(strain, jnp.zeros((*strain.shape, self.relaxation.shape[-1])))

    def advance(
        self, strain: Float[Array, "..."], memory: Strained | None, step: Float[Array, ""] | None
    ) -> Strained | None:
        """Return the memory after a step of given length (s) to a ``strain``."""
        if self.relaxation is None or memory is None or step is None:
            return None
        decayed = jnp.exp(-step / self.relaxation[1]) * memory.branches
        return Strained(strain, decayed + self._gain(step) * (strain - memory.strain)[..., None])

    def viscous_stress(
        self,
        strain: Float[Array, "..."],
        rate: Float[Array, "..."],
        memory: Strained | None,
        step: Float[Array, ""] | None,
    ) -> Float[Array, "..."]:
        """Return the stress of dashpot and branches over the stiffness."""
        stress, after = self.damping_time * rate, self.advance(strain, memory, step)
        return stress if after is None else stress + jnp.sum(after.branches, axis=-1)

    def energy(
        self, strain: Float[Array, "..."], memory: Strained | None, step: Float[Array, ""] | None
    ) -> Float[Array, "..."]:
        """Return the stored energy over the stiffness, that of the branches included."""
        energy, after = 0.5 * strain**2, self.advance(strain, memory, step)
        if self.relaxation is None or after is None:
            return energy
        return energy + 0.5 * jnp.sum(after.branches**2 / self.relaxation[0], axis=-1)

    def _gain(self, step: Float[Array, ""]) -> Float[Array, " branch"]:
        """Return the stress of each branch per change of the strain in a step."""
        assert self.relaxation is not None
        ratio, time = self.relaxation
        steps = step / time
        small = steps < 1e-6
        share = -jnp.expm1(-steps) / jnp.where(small, 1.0, steps)
        return ratio * jnp.where(small, 1.0 - 0.5 * steps, share)


def branches_of_loss_factor(
    value: float, band_hz: tuple[float, float]
) -> Float[np.ndarray, "2 branch"]:
    """Return Maxwell branches whose loss factor is nearly constant over a band of frequencies.

    Two a decade and one beyond each end, by least squares: the loss modulus is ``value`` times the
    storage modulus, which is linear in the ratios. Each fit weighs the error by the storage modulus
    of the one before, which rises over the band: so the error of the loss factor is the same at
    all frequencies. It is at most 2 % for values to 1.5, 1 % for values to 1.
    """
    from scipy.optimize import nnls  # slow to load, and few scenarios need it

    decades = float(np.log10(band_hz[1] / band_hz[0]))
    frequency = 2 * np.pi * np.geomspace(*band_hz, max(9, round(20 * decades)))
    places = np.arange(np.ceil(2 * decades) + 3)
    middle = np.sqrt(band_hz[0] * band_hz[1])
    time = 1 / (2 * np.pi * middle * 10 ** (0.5 * (places - places.mean())))
    turned = frequency[:, None] * time
    storage, loss = turned**2 / (1 + turned**2), turned / (1 + turned**2)
    total = np.ones(frequency.size)
    for _ in range(BRANCH_FITS):
        ratio, _ = nnls((loss - value * storage) / total[:, None], value / total)
        total = 1 + storage @ ratio
    return np.stack([ratio, time])[:, ratio > 0]
