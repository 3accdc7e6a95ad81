"""Arms for tests of the core, built straight from its parts."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from crinoid.base import Base, BaseMotion, Servo
from crinoid.dynamics import (
    ActingForces,
    Context,
    EnergyAccount,
    Forces,
    FreeBodies,
    Integrator,
    Obstacles,
    Outcome,
    Settings,
    State,
    StepStatistics,
    System,
    Touch,
)
from crinoid.dynamics.vehicle import Thrusters, Vehicle
from crinoid.elements import (
    AddedMass,
    Bend,
    Body,
    BodyContact,
    Contact,
    Drag,
    Element,
    Inertia,
    Pair,
    Stretch,
    Weight,
)
from crinoid.elements.soft_skin import surfaces
from crinoid.flow import Flow, Water
from crinoid.foundation.axes import CHANNELS
from crinoid.numerics.ramp import Onset
from crinoid.rod import Rod

QUICKLY = {"xla_backend_optimization_level": 0}
"""Options for what takes longer to compile than to run."""


def arm(
    *,
    nodes: int = 11,
    length: float = 1.0,
    EA: float | None = 1e4,
    EI: ArrayLike | None = 1.0,
    radius: ArrayLike = 1.0,
    youngs_modulus: float = 1.0,
    mass_per_length: float = 1.0,
    diameter: float = 0.02,
    displaced_area: float = 0.0,
    rest_curvature: ArrayLike = 0.0,
    damping_time: float = 0.0,
    relaxation: ArrayLike | None = None,
    axes: int = 2,
    GJ: float | None = None,
    tilt: float = 0.0,
    pan: float = 0.0,
    roll: float = 0.0,
    pinned: bool = False,
    gravity: float = 0.0,
    water_density: float = 0.0,
    drag_normal: float = 1.1,
    drag_tangential: float = 0.01,
    added_mass_normal: float = 1.0,
    added_mass_tangential: float = 0.0,
    linear_drag: float = 0.0,
    loads: Sequence[Callable[[Rod], Element]] = (),
    flows: Sequence[Flow] = (),
    motions: Sequence[BaseMotion] = (),
    limits: ArrayLike | None = None,
    integrator: Integrator | None = None,
    time_step: float = 0.01,
    tolerance: float = 1e-10,
    max_iterations: int = 30,
    max_halvings: int = 8,
    max_error: float = np.inf,
    origin: ArrayLike | None = None,
    obstacles: Callable[[Rod], Obstacles] | None = None,
    vehicle: Vehicle | None = None,
) -> System:
    """Build an arm; without further words a light, nearly inextensible one in a vacuum.

    ``EA`` and ``EI`` of None are those of the round section of ``radius`` and ``youngs_modulus``.
    An arm of 3 ``axes`` is spatial.
    ``relaxation``: rows ratio, time of the Maxwell branches.
    ``limits``: rows lower, upper, speed, acceleration, bandwidth; columns the channels.
    """
    rod = Rod.round(
        length=length,
        nodes=nodes,
        radius=radius,
        density=1.0,
        youngs_modulus=youngs_modulus,
        rest_curvature=jnp.asarray(rest_curvature, float),
        damping_time=damping_time,
        relaxation=None if relaxation is None else jnp.asarray(relaxation, float),
        EA=EA,
        EI=None if EI is None else jnp.asarray(EI, float),
        mass_per_length=mass_per_length,
        diameter=diameter,
        displaced_area=displaced_area,
        axes=axes,
        GJ=GJ,
    )
    elements: list[Element] = [
        Stretch.of(rod),
        Bend.of(rod, pinned=pinned),
        Inertia.of(rod),
        Weight.of(rod, density=water_density, gravity=gravity),
    ]
    if water_density or linear_drag:
        elements += [
            Drag.of(
                rod,
                density=water_density,
                normal=drag_normal,
                tangential=drag_tangential,
                linear=linear_drag,
            ),
            AddedMass.of(
                rod,
                density=water_density,
                normal=added_mass_normal,
                tangential=added_mass_tangential,
            ),
        ]
    elements += [load(rod) for load in loads]
    settings = Settings.for_rod(rod, tolerance, max_iterations)
    return System(
        reference=rod.reference,
        forces=Forces(
            tuple(elements),
            Water(tuple(flows)),
            jnp.zeros(axes) if origin is None else jnp.asarray(origin, float),
            obstacles(rod) if obstacles is not None else None,
            vehicle=vehicle,
        ),
        base=Base(
            jnp.asarray([tilt] if axes == 2 else [pan, tilt, roll], float),
            rod.rest_length[0],
            Servo(*jnp.asarray(_roomy(axes) if limits is None else limits, float)),
            tuple(motions),
        ),
        integrator=integrator or Integrator.newmark(),
        settings=settings,
        time_step=jnp.asarray(time_step, float),
        max_error=jnp.asarray(max_error, float),
        max_halvings=jnp.asarray(max_halvings),
    )


def _roomy(axes: int) -> ArrayLike:
    return [[limit] * len(CHANNELS[axes]) for limit in (-1.0, 1.0, 10.0, 100.0, 5.0)]


def obstacles(
    positions: ArrayLike,
    *,
    radius: ArrayLike = 0.02,
    half_axis: ArrayLike = 0.0,
    normal: ArrayLike = 0.0,
    friction: ArrayLike = 0.0,
    rolling: ArrayLike = 0.0,
    spinning: ArrayLike = 0.0,
    velocity: ArrayLike = 0.0,
    mass: ArrayLike | None = None,
    inertia: ArrayLike | None = None,
    length: ArrayLike = 0.0,
    spin: ArrayLike = 0.0,
    metacentric_height: float = 0.0,
    pairs: Sequence[Pair] = (),
    carried: tuple[int, ...] = (),
    density: float = 0.0,
    gravity: float = 0.0,
) -> Callable[[Rod], Obstacles]:
    """Say which obstacles an arm has: free, and homogeneous, are those of finite mass (kg)."""
    position = jnp.asarray(positions, float)
    count, axes = position.shape
    radii = jnp.broadcast_to(jnp.asarray(radius, float), count)
    masses = np.broadcast_to(np.asarray(np.inf if mass is None else mass, float), count)
    free = tuple(int(index) for index in np.flatnonzero(np.isfinite(masses)))
    turns, cores = 1 if axes == 2 else 3, jnp.broadcast_to(jnp.asarray(half_axis), position.shape)
    normals = jnp.broadcast_to(jnp.asarray(normal, float), position.shape)
    numbers = {"radius": radii, "half_axis": cores, "normal": normals, "mass": jnp.asarray(masses)}
    rough, rolls, spins = (
        jnp.broadcast_to(jnp.asarray(x, float), count) for x in (friction, rolling, spinning)
    )

    def of(rod: Rod) -> Obstacles:
        return Obstacles(
            (Contact.of(rod, friction=rough, **numbers),),
            (tuple(range(count)),),
            bodies(rod) if free else None,
            position,
            cores,
            jnp.broadcast_to(jnp.asarray(velocity, float), position.shape),
            carried,
        )

    def bodies(rod: Rod) -> FreeBodies:
        at = np.array(free)
        own = jnp.asarray(masses[at])
        moments = 0.4 * own * radii[at] ** 2 if inertia is None else jnp.asarray(inertia)
        moments = jnp.broadcast_to(moments.T, (turns, at.size)).T
        touching = ()
        if pairs:
            strength = jnp.max(surfaces(rod)[1])
            touching = (
                BodyContact.between(
                    pairs,
                    friction=rough,
                    rolling=rolls,
                    spinning=spins,
                    strength=strength,
                    gravity=gravity,
                    **numbers,
                ),
            )
        return FreeBodies(
            free,
            Body.of(
                mass=own,
                radius=radii[at],
                inertia=jax.vmap(jnp.diag)(moments),
                half_axis=cores[at],
                length=jnp.broadcast_to(jnp.asarray(length, float), at.shape),
                metacentric_height=metacentric_height,
                density=density,
                gravity=gravity,
            ),
            jnp.broadcast_to(jnp.asarray(spin, float), (count, turns)),
            touching,
            (tuple((pair.first, pair.second) for pair in pairs),) if pairs else (),
        )

    return of


def vehicle(
    axes: int,
    *,
    mass: float = 3.0,
    inertia: ArrayLike = 0.4,
    offset: ArrayLike | None = None,
    displaced: float | None = None,
    added_mass: ArrayLike = 0.0,
    added_inertia: ArrayLike = 0.0,
    drag: ArrayLike = 0.0,
    angular_drag: ArrayLike = 0.0,
    metacentric_height: float = 0.0,
    gravity: float = 0.0,
    bandwidth: float = 0.0,
    max_force: float = np.inf,
    max_moment: float = np.inf,
) -> Vehicle:
    """Build a submarine that floats; without further words a neutral one that nothing holds."""
    turns = 1 if axes == 2 else 3

    def many(values: ArrayLike, count: int) -> Array:
        return jnp.broadcast_to(jnp.asarray(values, float), (count,))

    carried, spun = many(added_mass, axes), many(added_inertia, turns)
    rate, moments = 2 * jnp.pi * bandwidth, many(inertia, turns)
    numbers = (mass, mass if displaced is None else displaced, metacentric_height, gravity)
    own, water, height, pull = (jnp.asarray(number, float) for number in numbers)
    return Vehicle(
        mass=own,
        inertia=moments,
        displaced=water,
        added_mass=carried,
        added_inertia=spun,
        drag=many(drag, axes),
        angular_drag=many(angular_drag, turns),
        metacentric_height=height,
        gravity=pull,
        offset=many((-0.3,) + (0.0,) * (axes - 1) if offset is None else offset, axes),
        thrusters=Thrusters(
            rate**2 * (own + carried),
            2 * rate * (own + carried),
            rate**2 * (moments + spun),
            2 * rate * (moments + spun),
            jnp.asarray(max_force, float),
            jnp.asarray(max_moment, float),
        ),
    )


def facing(rotation: ArrayLike) -> dict[str, float]:
    """Return pan, tilt and roll of a base that a rotation of the world turns from x, y, z."""
    tangent, m_1, _ = np.transpose(rotation)
    pan, tilt = np.arctan2(tangent[1], tangent[0]), np.arcsin(np.clip(tangent[2], -1.0, 1.0))
    port = np.array([-np.sin(pan), np.cos(pan), 0.0])
    return {"pan": pan, "tilt": tilt, "roll": np.arctan2(m_1 @ np.cross(tangent, port), m_1 @ port)}


def always() -> Onset:
    """Return the onset of what is there from the start."""
    return Onset.of()


def order(errors: Sequence[float], refinement: float = 2.0) -> Array:
    """Return the observed orders of convergence of successive errors."""
    errors = np.asarray(errors)
    return np.log(errors[:-1] / errors[1:]) / np.log(refinement)


def only(forces: Forces, *kinds: type[Element]) -> Forces:
    """Silence all elements but some, by their numbers: what is compiled stays the same."""

    def silenced(element: Element) -> Element:
        if isinstance(element, Stretch):  # which divides by its length
            return eqx.tree_at(lambda e: e.EA, element, jnp.zeros_like(element.EA))
        return jax.tree.map(jnp.zeros_like, element)

    elements = tuple(e if isinstance(e, kinds) else silenced(e) for e in forces.elements)
    return eqx.tree_at(lambda f: f.elements, forces, elements)


def dense(bands: ArrayLike) -> np.ndarray:
    """Write the bands out as a matrix with axes node, unknown, node, unknown."""
    bands = np.asarray(bands)
    n, _, b, _ = bands.shape
    matrix = np.zeros((n, b, n, b))
    for i in range(n):
        for d in range(max(0, 2 - i), min(5, n + 2 - i)):
            matrix[i, :, i + d - 2] = bands[i, d]
    return matrix


class Kept(eqx.Module):
    """A state with its books; what is asked of it beyond these the state answers."""

    state: State
    account: EnergyAccount
    energy: Array

    @staticmethod
    def of(system: System, state: State, account: EnergyAccount | None = None) -> "Kept":
        return Kept(state, account or EnergyAccount.of(system.forces, state), system.energy(state))

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.state, name)

    @property
    def work(self) -> Array:
        return self.account.work

    @property
    def working(self) -> dict[str, Array]:
        return self.account.nonconservative_forces

    @property
    def touch(self) -> Touch | None:
        return self.account.contact

    def step(self, system: System, command: Array, step: Array) -> tuple["Kept", Outcome]:
        state, outcome = system.step(self.state, command, step)
        account = self.account.after(system.forces, self.state, state, step)
        return Kept.of(system, state, account), outcome

    def advance(
        self, system: System, command: Array, step: Array | None = None
    ) -> tuple["Kept", StepStatistics]:
        state, account, progress = system.advance_with_account(
            self.state, self.account, command, step
        )
        return Kept.of(system, state, account), progress


def ways(
    parameters: Sequence[str], commands: tuple[int, ...], *, seeds: int
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return directions to differentiate along, by name: changes of parameters and of commands.

    Each parameter alone, then all commands at once, a way for each seed.
    """
    alone = np.eye(len(parameters))
    return {name: (alone[i], np.zeros(commands)) for i, name in enumerate(parameters)} | {
        f"commands-{seed}": (
            np.zeros(len(parameters)),
            0.3 * np.random.default_rng(seed).normal(size=commands),
        )
        for seed in range(seeds)
    }


def acting(system, context=None):
    """Return the forces of a system in a context; the plain one has no drive and no memory."""
    return ActingForces.of(system.forces, Context() if context is None else context)
