"""Reduced linear model of arm, actuators, sensors and water, from which controllers are designed.

From one control period to the next, with as few coordinates of the arm as inputs, water and sensors
tell apart: ``x' = arm x + held s + driven s' + stirred w' + hastened w_t'``. The states of the
actuators ``s`` at both ends of the period are known, the water's velocity ``w`` and acceleration
``w_t`` at its end, by shapes along the arm, are not.
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

from crinoid.actuation import for_small_commands
from crinoid.assembly.arrays import array
from crinoid.assembly.plan import AssembledScenario
from crinoid.compilation import ONCE, compiled
from crinoid.control import Measurand, Sensor, WaterVelocity
from crinoid.dynamics import State, System, Transition, numbers_of
from crinoid.dynamics.resting import stand
from crinoid.elements import Threads, Vortices
from crinoid.flow import Flow, Uniform, Water
from crinoid.numerics.ramp import Onset
from crinoid.numerics.signals_and_systems import balanced_by_reach

Matrix = Float[np.ndarray, "_ _"]
Velocity = Float[np.ndarray, " d"]

SHARE = 1e-5  # least Hankel singular value of a state that is kept, over the largest
_MOST = 40
_DISCOUNT = 0.9999  # share of a motion that a period leaves in Gramians, also without damping
_USUAL = 0.1  # usual movement of an input over its range
_CALM = 0.25  # share of the time in which the water is slower than in the linearisation
_SETTLED = 100  # steps over which the response to inputs is summed


class LinearModel(NamedTuple):
    """Small changes over one control period, on the host. SI units."""

    arm: Float[np.ndarray, "x x"]
    held: Float[np.ndarray, "x s"]
    driven: Float[np.ndarray, "x s"]
    stirred: Float[np.ndarray, "x w"]
    hastened: Float[np.ndarray, "x w"]
    actuators: Float[np.ndarray, "s s"]
    commanded: Float[np.ndarray, "s u"]  # by the inputs that are driven
    observed: Float[np.ndarray, "y x"]  # values of the sensors by the arm: the tip's pose first
    observed_actuators: Float[np.ndarray, "y s"]
    observed_water: Float[np.ndarray, "y w"]
    nodes: Float[np.ndarray, "coordinate x"]  # positions of the nodes by the arm
    nodes_actuators: Float[np.ndarray, "coordinate s"]
    values: Float[np.ndarray, " y"]  # values of the sensors at the state that it is linear about
    at_rest: Float[np.ndarray, " s"]  # states of the actuators there
    kept: tuple[int, ...]  # which of the numbers in the states of all actuators these are
    rows: tuple[int, ...]  # which inputs are driven
    usual: Float[np.ndarray, " u"]  # by how much the driven inputs are usually moved
    current: Float[np.ndarray, " d"]  # steady current that it is linear about (m/s)
    steeper: float  # slope of the drag on average over that in this current
    hankel: Float[np.ndarray, " h"]  # Hankel singular values, of which the largest were kept


class _NodePositions(Measurand):
    """Positions of the nodes from the base's set position (m), an output of the linear model."""

    def of(self, system: System, state: State) -> Float[Array, " coordinate"]:
        return state.position[1:].reshape(-1)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        return ()


def linear_model(
    plan: AssembledScenario, driven: tuple[str, ...], shapes: int, deviation: Velocity
) -> LinearModel:
    """Linearise the arm of a plan about its start in the mean current, and reduce it.

    ``driven`` names the inputs that move, ``shapes`` is the number of shapes along the arm
    (Legendre polynomials) of the water's velocity, ``deviation`` its standard deviation along each
    axis (m/s).
    """
    current, steeper = calm_current(np.array(plan.current, float), deviation)
    outputs = (*plan.sensors, replace(plan.sensors[0], measurand=_NodePositions()))
    given = linearised(plan.system, plan.state, array(current), outputs)
    found, values, at_rest = jax.tree.map(np.asarray, given)
    readings = sum(sensor.noise.shape[0] for sensor in plan.sensors)
    seen, positions = np.split(found.observed_arm, [readings])
    rows = plan.rows(driven)
    lower, upper = plan.limits[:, rows]
    usual = _USUAL * (upper - lower)
    commanded, actuators = found.commanded[:, rows], found.actuators
    # without clocks and inputs that are not driven
    kept = np.flatnonzero(_spread(actuators, commanded * usual))
    actuators, commanded = actuators[np.ix_(kept, kept)], commanded[kept]
    observed_actuators, nodes_actuators = np.split(found.observed_actuators[:, kept], [readings])
    steps = max(1, round(plan.period / plan.scenario.simulation.time_step))
    nodes = plan.state.position.shape[0]  # the ghost's first
    place = np.clip((np.arange(nodes) - 1) / (nodes - 2), 0.0, 1.0)
    along = legendre.legvander(2 * place - 1, shapes - 1)
    stirred, hastened = (
        np.einsum("and,nj->ajd", each[:, :nodes], along).reshape(each.shape[0], -1)
        for each in (found.stirred, found.hastened)
    )
    arm, held, driving, water = _over(
        found.arm, found.held[:, kept], found.driven[:, kept], np.hstack([stirred, hastened]), steps
    )
    stirred, hastened = np.split(water, 2, axis=1)
    # scaled by as much as each usually does
    moved, stir = _spread(actuators, commanded * usual), np.tile(deviation, shapes)
    inputs = np.hstack([driving * moved, stirred * stir, hastened * stir / plan.period])
    reduced, _ = balanced_by_reach(arm, inputs, seen, share=SHARE, most=_MOST, discount=_DISCOUNT)
    left = reduced.left
    return LinearModel(
        arm=reduced.A,
        held=left @ held,
        driven=left @ driving,
        stirred=left @ stirred,
        hastened=left @ hastened,
        actuators=np.linalg.matrix_power(actuators, steps),
        commanded=sum(
            (np.linalg.matrix_power(actuators, k) @ commanded for k in range(steps)),
            np.zeros_like(commanded),
        ),
        observed=seen @ reduced.right,
        observed_actuators=observed_actuators,
        observed_water=_observed_water(plan, along),
        nodes=positions @ reduced.right,
        nodes_actuators=nodes_actuators,
        values=values[:readings],
        at_rest=at_rest[kept],
        kept=tuple(map(int, kept)),
        rows=tuple(rows),
        usual=usual,
        current=current,
        steeper=steeper,
        hankel=reduced.hankel,
    )


def calm_current(mean: Velocity, deviation: Velocity) -> tuple[Velocity, float]:
    """Return a steady current for calm moments, and how much steeper drag is on average.

    Along the axis where there is most of the varying current. Drag damps the arm the less the
    slower the water is: a controller that counts on the damping of the mean would shake the arm in
    between. The slope of ``u |u|`` is ``2 |u|``, its mean ``2 E|u|`` (Borgman 1967).
    """
    from scipy.special import ndtr  # slow to load

    axis = int(np.argmax(mean**2 + deviation**2))
    middle, spread = abs(mean[axis]), deviation[axis]
    speeds = np.linspace(0.0, middle + 5 * spread, 1001)
    share = ndtr((speeds - middle) / spread) - ndtr((-speeds - middle) / spread)
    slow, current = np.interp(_CALM, share, speeds), mean.copy()
    current[axis] = slow if mean[axis] >= 0 else -slow
    return current, float(np.trapezoid(1 - share, speeds) / slow)


@compiled(**ONCE)
def linearised(
    system: System, state: State, current: Float[Array, " d"], sensors: tuple[Sensor, ...]
) -> tuple[Transition, Float[Array, " y"], Float[Array, " s"]]:
    """Return the model of a time step in a steady current, and where it is linear about.

    It observes the values of the sensors; last come these and the states of the actuators. The
    arm counts as still in the shape that it has, and answers to the smallest commands.
    """

    def observe(system: System, state: State) -> Float[Array, " y"]:
        return jnp.concatenate([each.measurand.of(system, state) for each in sensors])

    values = observe(system, state)
    system = in_steady_water(system, Uniform(Onset.of(), current))
    still = stand(system, state)
    # a servo extrapolates from the step before: that of any step, not of the first of a run
    still = eqx.tree_at(lambda s: s.servo.span, still, system.time_step)
    found = system.transition(still, jnp.zeros(len(system.inputs)), observe=observe)
    return found, values, numbers_of((state.servo, *state.actuators))[0]


def in_steady_water(system: System, *flows: Flow) -> System:
    """Return a system for a linearisation, in the water of some flows."""
    # vortices and Coulomb friction are no linear laws: disturbances
    elements = tuple(
        each.without_friction() if isinstance(each, Threads) else each
        for each in system.forces.elements
        if not isinstance(each, Vortices)
    )
    return eqx.tree_at(
        lambda s: (s.forces.elements, s.forces.water, s.base.servo, s.actuators),
        system,
        (elements, Water(flows), *for_small_commands((system.base.servo, system.actuators))),
    )


def _over(
    arm: Matrix, held: Matrix, driven: Matrix, water: Matrix, steps: int
) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return the model over several steps, in which the actuators move at a steady speed."""
    power = np.eye(arm.shape[0])
    begin, end, stir = np.zeros_like(held), np.zeros_like(driven), np.zeros_like(water)
    for step in range(steps, 0, -1):
        share = step / steps
        before = share - 1 / steps
        begin += power @ ((1 - share) * driven + (1 - before) * held)
        end += power @ (share * driven + before * held)
        stir += power @ water
        power = power @ arm
    return power, begin, end, stir


def _observed_water(plan: AssembledScenario, along: Float[np.ndarray, "n shape"]) -> Matrix:
    """Return the values of the sensors by the water's velocity."""
    axes, rows = plan.scenario.arm.dimension, []
    nodes = np.asarray(plan.state.position)
    for sensor in plan.sensors:
        size = sensor.noise.shape[0]
        block = np.zeros((size, along.shape[1] * axes))
        if isinstance(sensor.measurand, WaterVelocity):
            points = np.asarray(sensor.measurand.points)
            near = [int(np.argmin(np.sum((nodes - point) ** 2, axis=1))) for point in points]
            block = np.einsum("pj,de->pdje", along[near], np.eye(axes)).reshape(size, -1)
        rows.append(block)
    return np.concatenate(rows)


def _spread(actuators: Matrix, commanded: Matrix) -> Float[np.ndarray, " s"]:
    """Return the standard deviation of each state of the actuators under random commands."""
    moved, power = np.zeros(actuators.shape[0]), commanded
    for _ in range(_SETTLED):
        moved += np.sum(power**2, axis=1)
        power = actuators @ power
    return np.sqrt(moved)
