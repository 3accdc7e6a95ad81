"""The planar arm of a scenario as a rod of SoRoMoX, to be timed beside crinoid.

SoRoMoX's piecewise constant strain in the plane: segments of one curvature and one extension each,
integrated by an explicit method of fifth order. Water is left out but for its buoyancy, which
reduces gravity; so is damping.
"""

import jax
import jax.numpy as jnp
import numpy as np
from soromox.systems.components.links import LinkSpec
from soromox.systems.components.materials import IsotropicMaterialParams
from soromox.systems.pcs.planar_pcs import PlanarPCS
from soromox.systems.pcs.structures import PlanarPCSStructure
from soromox.systems.system_state import SystemState

from crinoid import Scenario

POISSON = 0.45
"""Poisson's ratio of sections that do not shear: it changes nothing, and one half is refused."""


class SoromoxRod:
    """A rod that leaves the clamp along x and swings from rest."""

    def __init__(self, scenario: Scenario, segments: int) -> None:
        arm, water = scenario.arm, scenario.water
        link = LinkSpec.circular(
            length=arm.length / segments,
            density=arm.density,
            radius=arm.radius,
            reference_strain=[0.0, 1.0, 0.0],
            young_modulus=arm.youngs_modulus,
            poisson_ratio=POISSON,
        )
        gravity = water.gravity * (1 - water.density / arm.density)
        bend_and_stretch = jnp.array([True, True, False] * segments)
        self._rod = PlanarPCS.from_links(
            [link] * segments,
            gravity=jnp.array([0.0, -gravity]),
            structure=PlanarPCSStructure(strain_selector=bend_and_stretch),
            base_pose=jnp.zeros(3),
            backend="jax",
        )
        self._length = arm.length
        self._swing = jax.jit(jax.vmap(self._tip, in_axes=(0, None, None)))

    def tips(self, youngs_moduli: np.ndarray, time_step: float, steps: int) -> np.ndarray:
        """Let rods of several Young's moduli (Pa) swing together; return their tips.

        Those are ``(rods, 2)`` in m after ``steps``. Where one diverges, its tip is not a number.
        """
        return np.asarray(self._swing(youngs_moduli, time_step, steps * time_step))

    def _tip(self, youngs_modulus: jax.Array, time_step: jax.Array, end: jax.Array) -> jax.Array:
        rod = self._rod.with_isotropic_material(
            IsotropicMaterialParams(young_modulus=youngs_modulus, poisson_ratio=jnp.array(POISSON))
        )
        rest = SystemState(
            t=jnp.zeros(()), y=jnp.zeros(rod.state_size), u=jnp.zeros(rod.num_actuators)
        )
        states = rod.rollout_to(rest, t1=end, solver_dt=time_step, save_ts=end[None])
        # of the rod itself, as positions know no modulus and take no batch of them
        pose = self._rod.forward_kinematics(states.y[-1, : rod.num_coordinates], self._length)
        return pose[1:]
