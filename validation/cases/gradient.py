"""Gradient of a closed-loop run."""

from collections.abc import Callable
from typing import cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes

from crinoid.assembly.parameters import Parameters
from crinoid.assembly.prepared import parameters
from crinoid.compilation import ONCE
from crinoid.flow import Sine
from crinoid.scenario import Scenario
from crinoid.simulation import closed_loop, rollout, with_parameters
from crinoid.view.figures.style import BLUE
from validation.case import Check, Evidence, case

_STEPS = 60
_H = 1e-5
"""Relative step of the central differences."""
# far from the limits of the servos, where a run has kinks
_CHANNELS = {
    "slide": {"range": [-1.0, 1.0], "max_speed": 10.0, "max_acceleration": 1e3},
    "tilt": {"max_speed_deg": 1e3, "max_acceleration_deg": 1e5},
}
_PID = {"slide": {"kp": 1.0, "ki": 0.5}, "tilt": {"kp": 0.5, "ki": 0.5}}
_SCENARIO = Scenario(
    arm={"nodes": 5, "radius": [0.02, 0.015]},
    base={"tilt_deg": 60.0, "channels": _CHANNELS},
    flow=[{"kind": "sine", "amplitude": [0.2, 0.05], "frequency_hz": 0.5}],
    control={"kind": "pid", "controlled": ["x", "angle"], "pid": _PID},
    simulation={"duration": 0.6, "time_step": 0.01, "tolerance": 1e-13},
)
_KEYS: dict[str, Callable[[Parameters], Array]] = {
    "arm.youngs_modulus": lambda p: p.arm.youngs_modulus,
    "arm.density": lambda p: p.arm.density,
    "arm.radius": lambda p: p.arm.radius,
    "arm.length": lambda p: p.arm.length,
    "arm.damping_time": lambda p: p.arm.damping_time,
    "water.drag_normal": lambda p: p.water.drag_normal,
    "flow.0.amplitude": lambda p: cast(Sine, p.flow[0]).amplitude,
    "base.tilt_deg": lambda p: p.base.angles,
    "control.pid kp": lambda p: p.pid.kp,
    "control.pid ki": lambda p: p.pid.ki,
}


@case(
    kind="exact",
    title="The gradient of a closed-loop run by material, shape, current, mount and gains.",
    source="Central differences of the same run.",
    method=f"Mean squared error of the tip over {_STEPS} steps of 10 ms under PID control, with 5 "
    "nodes; reverse mode, through the solution of each step. Each key is multiplied by a factor.",
    reason="Where the relative velocity reverses, the second derivative of the drag jumps. "
    "Differences over 1e-5 leave that share of it, and 1e-12/1e-5 = 1e-7 of round-off.",
)
def gradient() -> Evidence:
    loop, state = closed_loop(_SCENARIO)
    given = parameters(_SCENARIO)

    def error(factors: Float[Array, " keys"]) -> Float[Array, ""]:
        """Return the mean squared error of the tip (mm2), with the numbers of keys multiplied."""
        changed = given
        for where, factor in zip(_KEYS.values(), factors, strict=True):
            changed = eqx.tree_at(where, changed, factor * where(changed))
        run = rollout(with_parameters(loop, changed), state, _STEPS)
        return 1e6 * jnp.mean(jnp.sum(run.kept.error[:, :2] ** 2, axis=1))

    both = jax.jit(jax.value_and_grad(error), compiler_options=ONCE)
    ones = jnp.ones(len(_KEYS))
    _, slopes = both(ones)
    differences = []
    for index in range(len(_KEYS)):
        ends = [float(both(ones.at[index].add(h))[0]) for h in (_H, -_H)]
        differences.append((ends[0] - ends[1]) / (2 * _H))
    checks = [
        Check(f"slope by {name}", difference, float(slope), 1e-6, "mm2", True)
        for name, difference, slope in zip(_KEYS, differences, slopes, strict=True)
    ]

    def draw(axes: Axes) -> None:
        places = np.arange(len(_KEYS))
        axes.barh(places, slopes, color=BLUE, label="gradient")
        axes.plot(differences, places, "o", mfc="none", color="k", label="central differences")
        axes.set(yticks=places, yticklabels=list(_KEYS), xlabel="slope by relative change (mm$^2$)")
        axes.invert_yaxis()

    return Evidence(checks, None, {"": _SCENARIO}, draw)
