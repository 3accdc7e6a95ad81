"""A damped heavy arm that falls from level, and SoRoMoX's segments of constant curvature."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.cases.falling_arm import (
    DENSITY,
    LENGTH,
    MODULUS,
    RADIUS,
    STIFFER,
    hardly_stretching,
    simulated_tips,
)
from crinoid.view.figures.style import BLUE, INK, VERMILLION, key

_TIMES = (0.5, 1.0, 2.0)
_DAMPING = 0.03
"""Viscosity in bending over Young's modulus (s)."""
_SEGMENTS = {2: 5e-4, 4: 2.5e-4, 8: 1e-4}
"""Numbers of segments, and time steps of an explicit method of order 5 (s)."""


def _fallen(segments: int, time_step: float) -> Float[np.ndarray, "time axis"]:
    """Return the tip (m) of SoRoMoX's rod at the times; its segments bend only."""
    from soromox.systems.components.links import LinkSpec
    from soromox.systems.pcs.planar_pcs import PlanarPCS
    from soromox.systems.pcs.structures import PlanarPCSStructure
    from soromox.systems.system_state import SystemState

    link = LinkSpec.circular(
        length=LENGTH / segments,
        density=DENSITY,
        radius=RADIUS,
        reference_strain=[0.0, 1.0, 0.0],
        young_modulus=MODULUS,
        poisson_ratio=0.49,  # of no effect without shear; one half is refused
        material_damping_coefficient=_DAMPING * MODULUS / 3,  # its law of bending has 3 times it
    )
    rod = PlanarPCS.from_links(
        [link] * segments,
        gravity=jnp.array([0.0, -9.81]),
        structure=PlanarPCSStructure(strain_selector=jnp.array([True, False, False] * segments)),
        base_pose=jnp.zeros(3),
        backend="jax",
    )
    rest = SystemState(t=jnp.zeros(()), y=jnp.zeros(rod.state_size), u=jnp.zeros(rod.num_actuators))

    @jax.jit
    def tips() -> jax.Array:
        times = jnp.array(_TIMES)
        states = rod.rollout_to(rest, t1=times[-1], solver_dt=time_step, save_ts=times)
        shapes = states.y[:, : rod.num_coordinates]
        return jax.vmap(lambda shape: rod.forward_kinematics(shape, LENGTH)[1:])(shapes)

    return np.asarray(tips())


def _run() -> Evidence:
    scenario = hardly_stretching().with_values(
        {"arm.damping_time": _DAMPING, "simulation.duration": _TIMES[-1]}
    )
    path = simulated_tips(scenario)
    fallen = {count: _fallen(count, step) for count, step in _SEGMENTS.items()}
    theirs = fallen[8] + (fallen[8] - fallen[4]) / 3
    checks = []
    for when, expected, found in zip(_TIMES, theirs, map(path.at, _TIMES), strict=True):
        text = f"{when:g} s"
        checks += [
            Check(f"x of the tip, {text}", expected[0], found[0], 3e-3, "m"),
            Check(f"z of the tip, {text}", expected[1], found[1], 3e-3, "m"),
        ]

    def draw(axes: Axes) -> None:
        axes.plot(path.time, path.tips[:, 1], color=BLUE, label="crinoid")
        axes.plot(_TIMES, fallen[2][:, 1], "x", color=VERMILLION, label="SoRoMoX, 2 segments")
        axes.plot(_TIMES, theirs[:, 1], "o", mfc="none", color=INK, label="refined")
        axes.set(xlabel="time (s)", ylabel="z of the tip (m)")
        key(axes)

    apart = 1e3 * np.hypot(*(fallen[2] - theirs).T)
    remarks = (
        "Two segments, as in print, are off the refined ones by "
        f"{', '.join(f'{x:.0f}' for x in apart)} mm at {', '.join(map(str, _TIMES))} s. The tip of "
        "falling-arm is as far from theirs.",
    )
    return Evidence(checks, None, {"": scenario}, draw, remarks)


CASE = Case(
    name="soromox-fall",
    title="A damped heavy arm falls from level, as in SoRoMoX when its segments are refined.",
    source="SoRoMoX 0.5.0, run in the case with 2, 4 and 8 segments of constant curvature, which "
    "neither stretch nor shear.",
    method=f"41 nodes, time step 1 ms, damping time {_DAMPING:g} s, EA {STIFFER:g} times that of "
    "the material. SoRoMoX is extrapolated from 4 and 8 segments with order 2.",
    reason="The step of the extrapolation: a third of SoRoMoX's change from 4 to 8 segments, 3 mm "
    "at 0.5 s.",
    kind="peer",
    run=_run,
    needs=("soromox",),
)
