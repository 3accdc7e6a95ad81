"""Design of the swing-up controller: modes of the upright arm, LQR gain and Kalman filter."""

import math
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import eig, eigh, expm, solve_discrete_are

from crinoid.assembly.arrays import array
from crinoid.assembly.plan import AssembledScenario
from crinoid.compilation import ONCE, compiled
from crinoid.control import Filter, Hybrid, Pendulum, UprightBalance
from crinoid.dynamics import SmallMotions, System
from crinoid.dynamics.modes import of_free
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.elements import Weight
from crinoid.scenario import refusal
from crinoid.scenario.base import ChannelLimits
from crinoid.scenario.sensor import inclination_sensor

_TIP, _BASE, _PUSH = 0.1, 0.3, 0.3
"""Errors that count alike: the tip off by this share of the length, the base by this share of its
travel, and its acceleration by this share of its greatest (Bryson and Ho 1975, section 5.2)."""
_NOISE = math.radians(0.3)
"""Least error of an inclination that the filter allows for (rad): what modes left out do."""
_KNOWN = 0.5  # highest frequency of the modelled modes, over half the controller's rate
_STIRRED = 0.15  # disturbance that it allows for, as an acceleration of the base, over its greatest
_FILTER_PERIODS = 2.0  # time constant of the filter on rates in the swing-up (control periods)
_MOMENTUM = 0.8  # momentum at which the base goes farthest, over mass times speed of free fall
_ENERGY = 0.1  # energy lacking up to which the base goes less far, over that of the hanging arm
_SHARES = (0.9, 1.5)  # shares of the base's limits for catching, and at which the arm is let go

Matrix = Float[np.ndarray, "_ _"]
Vector = Float[np.ndarray, " _"]


class _UprightModes(NamedTuple):
    """The slowest modes of the upright arm, as seen from its base.

    ``y'' + damping y' + squared y = -driven a``, where the base accelerates by ``a``.
    """

    shape: Float[np.ndarray, "node mode"]  # forward displacement of the nodes, from the root on (m)
    squared: Vector  # squares of their circular frequencies, negative where the arm leaves (1/s2)
    damping: Matrix
    driven: Vector
    mass: Float[np.ndarray, " edge"]  # mass of the nodes after the root, with added mass (kg)

    @property
    def motion(self) -> Matrix:
        """System matrix of modes and rates."""
        zero, one = np.zeros((self.order, self.order)), np.eye(self.order)
        return np.block([[zero, one], [-np.diag(self.squared), -self.damping]])

    @property
    def order(self) -> int:
        """Number of modes."""
        return self.squared.size


def build_hybrid(plan: AssembledScenario) -> Hybrid:
    """Return the hybrid controller of a scenario."""
    scenario, system = plan.scenario, plan.system
    sensor, slide = inclination_sensor(scenario.sensors), scenario.base.channels.slide
    bend, weight = system.forces.bend, _weight(system)
    assert sensor is not None
    assert slide is not None
    assert bend is not None
    limits, settings = slide.limits, scenario.control.hybrid
    fastest = _KNOWN * np.pi / plan.period
    upright = _modes(_about_upright(system), settings.modes, float(fastest))
    lengths = np.asarray(system.reference.rest_length)
    length, heavy = lengths.sum(), np.asarray(weight.force)[1:]
    # the arm leans forward by what its modes move forward along an edge: inclinations fall
    slopes = -np.diff(upright.shape, axis=0) / lengths[:, None]
    middles = (np.cumsum(lengths) - lengths / 2) / length
    seen = [np.interp(sensor.stations, middles, slope) for slope in slopes.T]
    to_modes = np.linalg.pinv(np.stack(seen, axis=1))
    noise = max(_NOISE, math.radians(sensor.noise_deg))
    servo = system.base.servo.natural[0]
    try:
        balance = UprightBalance(
            modes=array(to_modes),
            gain=array(_gain(upright, limits, float(servo), plan.period, length)),
            capture=array(_capture(upright, limits)),
            filter=_filter(upright, noise**2 * to_modes @ to_modes.T, limits, plan.period),
        )
    except (np.linalg.LinAlgError, ValueError) as error:
        text = f'got "hybrid", but no slide balances this arm upright ({error})'
        raise refusal("control.kind", text) from error
    mass = upright.mass.sum()
    pendulum = Pendulum(
        sampled=array(slopes @ to_modes),
        length=array(lengths),
        mass=array(upright.mass),
        weight=array(heavy),
        stiffness=bend.stiffness[:, 0],
    )
    return Hybrid(
        pendulum=pendulum,
        balance=balance,
        sensor=sensor.called,
        channel=0,
        period=array(plan.period),
        late=math.ceil(sensor.delay / plan.period - 1e-6),
        filter_time=array(_FILTER_PERIODS * plan.period),
        momentum=array(_MOMENTUM * math.sqrt(mass * abs(heavy.sum()) * length)),
        momentum_time=array(1 / math.sqrt(abs(upright.squared[1]))),
        reach=array(length),
        energy=array(_ENERGY * _depth(pendulum)),
        catch=array([math.radians(settings.catch_deg), _SHARES[0]]),
        release=array([math.radians(settings.release_deg), _SHARES[1]]),
    )


def _depth(pendulum: Pendulum) -> float:
    """Return the energy that the hanging arm lacks (J); of a standing one that of a 1 rad lean."""
    from scipy.optimize import minimize  # slow to load

    def stored(leans: Vector) -> float:
        bent = 2 * np.tan(0.5 * np.clip(np.diff(leans, prepend=0.0), -2.0, 2.0))
        height = np.cumsum(np.asarray(pendulum.length) * (np.cos(leans) - 1.0))
        return float(pendulum.weight @ height + 0.5 * pendulum.stiffness @ bent**2)

    initial = np.linspace(0.1, 1.0, pendulum.length.size)
    return max(-minimize(stored, initial).fun, abs(stored(initial)))


def _weight(system: System) -> Weight:
    return next(each for each in system.forces.elements if isinstance(each, Weight))


@compiled(**ONCE)
def _about_upright(system: System) -> SmallMotions:
    """Linearise about the straight arm, upright and squeezed by its weight, in still water."""
    state, stretch = system.rest(), system.forces.stretch
    assert stretch is not None
    above = jnp.cumsum(_weight(system).force[::-1])[::-1][1:]  # what each edge carries (N)
    edges = stretch.rest_length * (1 - above / stretch.EA)
    height = jnp.concatenate([jnp.stack([-system.base.ghost_length, 0.0]), jnp.cumsum(edges)])
    straight = jnp.stack([jnp.zeros_like(height), height], axis=1)
    rows = state.motion.position.at[: height.size].set(straight)
    upright = eqx.tree_at(lambda s: s.motion.position, state, rows)
    return system.small_motions(upright, jnp.zeros(2))


def _modes(small: SmallMotions, count: int, fastest: float) -> _UprightModes:
    """Return modes of what moves forward, which upright does not go with what moves up.

    At least two, and of the others those that are not too fast (rad/s).
    """
    K, C, M = (
        of_free(bands).toarray()[::2, ::2]
        for bands in (small.stiffness_in_current, small.damping_in_current, small.mass)
    )
    squared, shape = eigh(0.5 * (K + K.T), M, subset_by_index=(0, count - 1))
    count = max(2, int(np.sum(squared < fastest**2)))
    squared, shape = squared[:count], shape[:, :count]
    # rows of the free nodes, columns of all: everything moves forward with the base
    carried = np.asarray(small.mass)[BOUNDARY_NODES:, :, 0, 0].sum(axis=1)
    ends = np.concatenate([np.zeros((1, count)), shape])
    return _UprightModes(ends, squared, shape.T @ C @ shape, shape.T @ carried, carried)


def _zero_order_hold(A: Matrix, B: Vector, period: float) -> tuple[Matrix, Vector]:
    """Return the matrices of a period in which the input is held (Van Loan 1978)."""
    whole = np.zeros((A.shape[0] + 1,) * 2)
    whole[:-1, :-1], whole[:-1, -1] = A, B
    step = expm(whole * period)
    return step[:-1, :-1], step[:-1, -1]


def _gain(
    upright: _UprightModes, limits: ChannelLimits, natural: float, period: float, length: float
) -> Vector:
    """Return the gain of the LQR on modes, rates, and displacement and speed of the base."""
    n = upright.order
    # the servo accelerates by natural^2 (command - displacement) - 2 natural speed
    pushed, driven = np.zeros(2 * n + 2), natural**2
    pushed[-2:] = -driven, -2 * natural
    A = np.zeros((2 * n + 2,) * 2)
    A[: 2 * n, : 2 * n] = upright.motion
    A[n : 2 * n] -= np.outer(upright.driven, pushed)
    A[-2, -1], A[-1] = 1.0, pushed
    B = np.zeros(2 * n + 2)
    B[n : 2 * n], B[-1] = -upright.driven * driven, driven
    A, B = _zero_order_hold(A, B, period)
    seen = np.zeros((2, 2 * n + 2))
    seen[0, :n] = upright.shape[-1] / (_TIP * length)
    seen[1, -2] = 1 / (_BASE * min(-limits.low, limits.high))
    effort = 1 / (_PUSH * limits.acceleration) ** 2
    Q = seen.T @ seen + effort * np.outer(pushed, pushed)
    R, S = np.array([[effort * driven**2]]), effort * driven * pushed[:, None]
    P = solve_discrete_are(A, B[:, None], Q, R, s=S)
    return np.asarray((B @ P @ A + S[:, 0]) / (R[0, 0] + B @ P @ B))


def _filter(upright: _UprightModes, noise: Matrix, limits: ChannelLimits, period: float) -> Filter:
    """Return the steady Kalman filter of modes and rates that sees the modes, with its model."""
    n = upright.order
    force = np.concatenate([np.zeros(n), -upright.driven])
    A, pushed = _zero_order_hold(upright.motion, force, period)
    stirred = np.diag(_STIRRED * limits.acceleration * np.abs(upright.driven)) * period
    through = np.concatenate([stirred * period / 2, stirred])
    P = solve_discrete_are(A.T, np.eye(2 * n, n), through @ through.T, noise)
    trust = P[:, :n] @ np.linalg.inv(P[:n, :n] + noise)
    return Filter(array(A), array(pushed), array(trust))


def _capture(upright: _UprightModes, limits: ChannelLimits) -> Float[np.ndarray, "measure state"]:
    """Return the least shares of the base's limits that bring back an unstable motion.

    Along a left eigenvector ``w`` of a rate ``r > 0`` the arm leaves by ``s' = r s + b a``: the
    acceleration can turn it round while ``|s| < |b| a_most / r``. Likewise for ``s - b v``, which
    follows the speed ``v`` alone, and ``s - b v - r b x``, which follows the displacement ``x``.
    """
    n = upright.order
    rates, left, _ = eig(upright.motion, left=True)
    travel = min(-limits.low, limits.high)
    measures = [np.zeros(2 * n + 2)]  # of a stable arm
    for index in np.flatnonzero(rates.real > 0):
        rate, row = float(rates[index].real), left[:, index].real
        moved = -float(row[n:] @ upright.driven)
        for displaced, going, most in (
            (0.0, 0.0, limits.acceleration / rate),
            (0.0, -moved, limits.speed),
            (-rate * moved, -moved, rate * travel),
        ):
            measures.append(np.array([*row, displaced, going]) / (abs(moved) * most))
    return np.array(measures)
