"""A planar arm without water by the piecewise constant strain of SoRoMoX."""

import jax
import jax.numpy as jnp
import numpy as np
from soromox.systems.components.links import LinkSpec
from soromox.systems.pcs.planar_pcs import PlanarPCS
from soromox.systems.pcs.structures import PlanarPCSStructure
from soromox.systems.system_state import SystemState

from crinoid.scenario import Scenario
from validation.peers.swing import Swing, clocked, radius_of

_POISSON = 0.45
"""Poisson's ratio of sections that do not shear: it changes nothing, and one half is refused."""


def prepare(
    scenario: Scenario, time_step: float, interval: float, samples: int, stretches: bool = True
) -> Swing:
    """Return a run; each edge of the arm is a segment of constant curvature and extension."""
    arm, segments = scenario.arm, scenario.arm.nodes - 1
    link = LinkSpec.circular(
        length=arm.length / segments,
        density=arm.density,
        radius=radius_of(scenario),
        reference_strain=[0.0, 1.0, 0.0],
        young_modulus=arm.youngs_modulus,
        poisson_ratio=_POISSON,
        # its law of bending has 3 times the coefficient
        material_damping_coefficient=arm.damping_time * arm.youngs_modulus / 3,
    )
    selected = jnp.array([True, stretches, False] * segments)
    rod = PlanarPCS.from_links(
        [link] * segments,
        gravity=jnp.array([0.0, -scenario.water.gravity]),
        structure=PlanarPCSStructure(strain_selector=selected),
        base_pose=jnp.zeros(3),
        backend="jax",
    )
    rest = SystemState(t=jnp.zeros(()), y=jnp.zeros(rod.state_size), u=jnp.zeros(rod.num_actuators))
    times = interval * jnp.arange(1, samples + 1)

    @jax.jit
    def tips() -> jax.Array:
        states = rod.rollout_to(rest, t1=times[-1], solver_dt=time_step, save_ts=times)
        shapes = states.y[:, : rod.num_coordinates]
        return jax.vmap(lambda shape: rod.forward_kinematics(shape, arm.length)[1:])(shapes)

    tips()  # compiles
    return clocked(lambda: np.asarray(tips()))
