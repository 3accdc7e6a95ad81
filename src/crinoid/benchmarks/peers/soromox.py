"""The planar arm of a release by the piecewise constant strain of SoRoMoX."""

from importlib.metadata import version

import jax
import jax.numpy as jnp
import numpy as np
from soromox.systems.components.links import LinkSpec
from soromox.systems.pcs.planar_pcs import PlanarPCS
from soromox.systems.pcs.structures import PlanarPCSStructure
from soromox.systems.system_state import SystemState

from crinoid.benchmarks.peers import Engine, Swing, clocked
from crinoid.benchmarks.releases import IN_THE_PLANE, Release

_POISSON = 0.45
"""Poisson's ratio of sections that do not shear: it changes nothing, and one half is refused."""


def _prepare(release: Release, segments: int, time_step: float) -> Swing:
    scenario = release.scenario(segments + 1, time_step)
    arm = scenario.arm
    link = LinkSpec.circular(
        length=arm.length / segments,
        density=arm.density,
        radius=arm.radius,
        reference_strain=[0.0, 1.0, 0.0],
        young_modulus=arm.youngs_modulus,
        poisson_ratio=_POISSON,
    )
    rod = PlanarPCS.from_links(
        [link] * segments,
        gravity=jnp.array([0.0, -scenario.water.gravity]),
        structure=PlanarPCSStructure(strain_selector=jnp.array([True, True, False] * segments)),
        base_pose=jnp.zeros(3),
        backend="jax",
    )
    rest = SystemState(t=jnp.zeros(()), y=jnp.zeros(rod.state_size), u=jnp.zeros(rod.num_actuators))
    times = release.interval * jnp.arange(1, release.samples + 1)

    @jax.jit
    def tips() -> jax.Array:
        states = rod.rollout_to(rest, t1=times[-1], solver_dt=time_step, save_ts=times)
        shapes = states.y[:, : rod.num_coordinates]
        return jax.vmap(lambda shape: rod.forward_kinematics(shape, arm.length)[1:])(shapes)

    tips()  # compiles
    return clocked(lambda: np.asarray(tips()))


ENGINE = Engine(
    f"SoRoMoX {version('soromox')}",
    (IN_THE_PLANE.name,),
    "water; its segments have one curvature and one extension each",
    order=5,
    meshes=(2, 4, 6, 12),
    steps=(0.01, 0.00025),
    prepare=_prepare,
)
