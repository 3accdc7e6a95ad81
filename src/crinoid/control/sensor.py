"""Sensors: sampling of a measurand at a rate, with delay, noise and quantisation."""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from crinoid.control.controller import Reading
from crinoid.dynamics import ActingForces, State, System
from crinoid.foundation.axes import AXES, POSE

Values = Float[Array, " m"]


class Measurand(eqx.Module):
    """A quantity that follows from the state of an arm: one or more numbers.

    Examples
    --------
    The distance of the tip ahead of the base:

    >>> class Reach(crinoid.Measurand):
    ...     def of(self, system, state):
    ...         return state.position[-1:, 0]
    ...
    ...     def names(self, axes):
    ...         return (("reach", "m"),)
    >>> system = crinoid.system("still-water")
    >>> Reach().of(system, system.rest()).round(3).tolist()
    [0.5]
    """

    @abstractmethod
    def of(self, system: System, state: State) -> Values:
        """Return the true values, in the units that `names` gives."""

    @abstractmethod
    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        """Return the name and the unit of each value, for an arm in 2 or 3 dimensions."""


class TipPose(Measurand):
    """Pose of the tip: its position (m) and its direction (`crinoid.foundation.axes.POSE`)."""

    def of(self, system: System, state: State) -> Values:
        return system.tip(state)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        units = {"angle": "rad"} | dict.fromkeys(AXES[axes], "m")
        return tuple((name, units.get(name, "1")) for name in POSE[axes])


class Shape(Measurand):
    """Curvature at stations along the arm, in space with twist, as of fibre-optic sensors."""

    stations: Float[Array, " s"]
    """Distance from the root over the arm's length, 0 to 1."""

    def of(self, system: System, state: State) -> Values:
        strains, found = system.strains(state), self.stations * (state.position.shape[0] - 2)
        before = jnp.clip(jnp.floor(found).astype(int), 0, strains.shape[0] - 2)
        share = (found - before)[:, None]
        return ((1 - share) * strains[before] + share * strains[before + 1]).reshape(-1)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        parts: tuple[tuple[str, str], ...] = (("curvature", "m-1"),)
        if axes == 3:
            parts = (("kappa_1", "m-1"), ("kappa_2", "m-1"), ("twist", "rad m-1"))
        return tuple(
            (f"{name}_{index}", unit)
            for index in range(self.stations.shape[0])
            for name, unit in parts
        )


class BaseWrench(Measurand):
    """Force (N) and moment about the root (N m) of the arm on the submarine."""

    def of(self, system: System, state: State) -> Values:
        return jnp.concatenate([state.base_force, jnp.atleast_1d(state.base_moment)])

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        turns = ("y",) if axes == 2 else AXES[3]
        forces = tuple((f"force_{name}", "N") for name in AXES[axes])
        return (*forces, *((f"moment_{name}", "N m") for name in turns))


class ContactForce(Measurand):
    """Resultant force of all obstacles on the arm, or on a part of it, along the world's axes."""

    inside: Bool[Array, " edge"]
    """Edges that feel it."""

    def of(self, system: System, state: State) -> Values:
        forces = ActingForces.of(system.forces, state.context)
        if forces.obstacles is None:
            raise ValueError("a contact sensor requires an obstacle")
        num_nodes = forces.num_nodes(state.motion.position)
        return forces.obstacles.edge_force(state.motion, num_nodes, forces.pose, self.inside)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        return tuple((f"force_{name}", "N") for name in AXES[axes])


class WaterVelocity(Measurand):
    """Velocity of the water at points fixed to the submarine: a current meter, or an ADCP."""

    points: Float[Array, "p d"]
    """Positions of the points from the base's set position (m)."""

    def of(self, system: System, state: State) -> Values:
        pose, _, _ = system.base.pose(state.time, system.base.servo.at_rest())
        axes = self.points.shape[1]
        turn, points, centre = system.base.rotation(pose), self.points, pose[:axes]
        vehicle = system.forces.vehicle
        if vehicle is not None and state.attitude is not None:
            turn, points = state.attitude, points - vehicle.offset
            centre = state.vehicle_position
        turned = jnp.sum(turn * points[:, None, :], axis=-1)
        return system.forces.flow_velocity(centre + turned, state.time).reshape(-1)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        return tuple(
            (f"velocity_{name}_{index}", "m s-1")
            for index in range(self.points.shape[0])
            for name in AXES[axes]
        )


class Inclination(Measurand):
    """Angle of the arm's tangent above the horizontal at stations (rad): inclinometers."""

    stations: Float[Array, " s"]
    """Distance from the root over the arm's length, 0 to 1."""

    def of(self, system: System, state: State) -> Values:
        edges = jnp.diff(state.position[1:], axis=0)
        level = jnp.sqrt(jnp.sum(edges[:, :-1] ** 2, axis=1))
        # in the plane the arm may point backward, past the vertical
        level = edges[:, 0] if edges.shape[1] == 2 else level
        angles = jnp.unwrap(jnp.arctan2(edges[:, -1], level))
        # an edge has its angle at its middle
        middle = (jnp.arange(edges.shape[0]) + 0.5) / edges.shape[0]
        return jnp.interp(self.stations, middle, angles)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        return tuple((f"inclination_{index}", "rad") for index in range(self.stations.shape[0]))


class Clock(eqx.Module):
    """Ticks every ``period`` seconds, at the first time step that begins at or after a tick."""

    period: Float[Array, ""]
    """Time between two ticks (s)."""

    def due(self, ticks: Int[Array, ""], time: Float[Array, "*many"]) -> Bool[Array, "*many"]:
        """Return whether the tick that follows ``ticks`` earlier ones has come.

        A tick that a rounded sum of time steps misses by a millionth of the period still counts.
        """
        return time >= (ticks - 1e-6) * self.period


class SensorState(eqx.Module):
    """Memory of a sensor: number of samples, and the latest samples."""

    ticks: Int[Array, ""]
    """Number of samples taken."""
    times: Float[Array, " kept"]
    """Times of the stored samples (s), newest last; minus infinity where there is none."""
    samples: Float[Array, "kept m"]
    """Values of the kept samples, with their errors."""


class Sensor(eqx.Module):
    """A sensor with its own rate; a sample is known ``delay`` after its measurement.

    Noise is white and Gaussian, drawn for each sample from ``key`` and the sample's number, so
    that it depends on neither the time step nor an interruption of the run.

    Parameters
    ----------
    name : str
        Its name in `crinoid.ControllerInput.readings` and in results.
    measurand : Measurand
        Quantity that it measures, of ``m`` numbers.
    clock : Clock
        Times of the samples.
    delay : scalar array
        Age of a sample when it is known (s).
    noise : array (m)
        Standard deviation of each value, in its unit.
    resolution : array (m)
        Each value is rounded to a multiple of this; 0: it is not.
    key : key of jax.random
        Seed of the noise.
    kept : int
        Largest number of samples under way at the same time.

    Examples
    --------
    The inclination in the middle of the arm, 50 times a second:

    >>> from crinoid.control import Clock, Inclination
    >>> middle = Inclination(jnp.array([0.5]))
    >>> clock, zero = Clock(jnp.array(0.02)), jnp.zeros(1)
    >>> key = jax.random.PRNGKey(0)
    >>> sensor = crinoid.Sensor("middle", middle, clock, jnp.array(0.0), zero, zero, key, kept=1)
    >>> state = sensor.start(jnp.array([0.1]))
    >>> sensor.reading(state, jnp.array(0.0)).value.tolist()
    [0.1]
    """

    name: str = eqx.field(static=True)
    measurand: Measurand
    clock: Clock
    delay: Float[Array, ""]
    noise: Values
    resolution: Values
    key: PRNGKeyArray
    kept: int = eqx.field(static=True)

    def start(self, values: Values) -> SensorState:
        """Begin with the true values known."""
        times = jnp.full(self.kept, -jnp.inf)
        samples = jnp.broadcast_to(values, (self.kept, values.size))
        return SensorState(jnp.asarray(0), times, samples)

    def sample(self, before: SensorState, values: Values, time: Float[Array, ""]) -> SensorState:
        """Take a sample of the true values if one is due."""
        due = self.clock.due(before.ticks, time)
        noisy = values + _errors(self.noise, self.key, before.ticks)
        coarse = self.resolution > 0
        grain = jnp.where(coarse, self.resolution, 1.0)
        noisy = jnp.where(coarse, grain * jnp.round(noisy / grain), noisy)
        samples = jnp.concatenate([before.samples[1:], noisy[None]])
        times = jnp.append(before.times[1:], time)
        return SensorState(
            before.ticks + due,
            jnp.where(due, times, before.times),
            jnp.where(due, samples, before.samples),
        )

    def reading(self, state: SensorState, time: Float[Array, ""]) -> Reading:
        """Return the newest sample that is known at ``time``; that of the start counts as new."""
        slack = 1e-6 * self.clock.period
        known = jnp.sum(state.times <= time - self.delay + slack)
        # samples come in order, those of before the start count as known
        newest = jnp.maximum(known - 1, 0)
        taken = state.times[newest]
        return Reading(state.samples[newest], jnp.where(taken >= 0, taken, time))


@jax.custom_jvp
def _errors(noise: Values, key: PRNGKeyArray, sample: Int[Array, ""]) -> Values:
    """Return the errors of a sample; drawing them is slow, and most sensors have none."""
    return jax.lax.cond(
        jnp.any(noise != 0),
        lambda: noise * _drawn(noise, key, sample),
        lambda: jnp.zeros_like(noise),
    )


# they follow the noise where there is none, too
_errors.defjvps(lambda change, _, *given: change * _drawn(*given), None, None)


def _drawn(noise: Values, key: PRNGKeyArray, sample: Int[Array, ""]) -> Values:
    return jax.random.normal(jax.random.fold_in(key, sample), noise.shape)
