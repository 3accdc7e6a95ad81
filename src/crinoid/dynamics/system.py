"""System: the assembled arm and its time step."""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from crinoid.actuation import Actuator, Input, followed
from crinoid.base import Base
from crinoid.dynamics import resting
from crinoid.dynamics.acting import ActingForces
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.gripper import GripTriggers
from crinoid.dynamics.integrator import Integrator
from crinoid.dynamics.newton import Settings
from crinoid.dynamics.outcome import Outcome, StepStatistics, warn_of_round_off
from crinoid.dynamics.small_motions import Influence, SmallMotions, influence, linearise
from crinoid.dynamics.state import EnergyAccount, State, tip_pose
from crinoid.dynamics.time_step import halve, step_with
from crinoid.dynamics.transition import Transition, transition
from crinoid.numerics import banded
from crinoid.rod.reference import Reference

Command = Float[Array, " input"]


class System(eqx.Module):
    """A soft arm on its base in the water, as arrays: `jax.jit`, `jax.grad` and `jax.vmap` apply.

    `crinoid.system` and `crinoid.assemble` build it. To compile a method, use
    ``equinox.filter_jit(system.step)`` or pass the system to a function under `jax.jit`.

    Attributes
    ----------
    reference
        Shape without load, and its nodes.
    forces
        Force laws on the arm, and the water.
    base
        Base of the arm: prescribed motion and servos.
    integrator
        Numbers of the time integration.
    settings
        Settings of Newton's method.
    time_step
        Length of a time step (s).
    max_error
        Largest local error of an accepted step (m); infinite without a limit.
    max_halvings
        Number of times that `advance` may halve a time step.
    actuators
        Actuators besides the servos of the base.
    grip_triggers
        Touches at which the tip takes up its tool or lets it go, if there are any.

    Examples
    --------
    >>> import equinox as eqx
    >>> system = crinoid.system(crinoid.load("still-water", ["arm.nodes=5"]))
    >>> state = system.equilibrium()
    >>> system.tip(state).round(2).tolist()  # x, z (m), angle (rad)
    [0.46, -9.83, 0.56]
    >>> [each.name for each in system.inputs]
    ['slide', 'heave', 'tilt']
    >>> state, outcome = eqx.filter_jit(system.step)(state, jnp.zeros(3))
    >>> float(state.time), bool(outcome.converged)
    (0.01, True)
    """

    reference: Reference
    forces: Forces
    base: Base
    integrator: Integrator
    settings: Settings
    time_step: Float[Array, ""]
    max_error: Float[Array, ""]
    max_halvings: Int[Array, ""]
    actuators: tuple[Actuator, ...] = ()
    grip_triggers: GripTriggers | None = None

    @property
    def followers(self) -> tuple[Actuator, ...]:
        """The base's servos and the other actuators, in the order of a command."""
        return (self.base.servo, *self.actuators)

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Inputs in the order of a command: the base's channels, then those of the actuators."""
        return tuple(each for one in self.followers for each in one.inputs)

    def rest(self, time: float | Array = 0.0) -> State:
        """Return the undeformed arm, clamped to the base.

        Parameters
        ----------
        time : float
            Time of the base's pose (s).

        Returns
        -------
        State
        """
        # one by one its operations need longer to compile
        return eqx.filter_jit(resting.undeformed_state)(self, jnp.asarray(time, float))

    def equilibrium(self, time: float | Array = 0.0) -> State:
        """Return the arm in static equilibrium, moving along with its base.

        A `RuntimeWarning` reports round-off of the stretch that is not small compared to the loads.

        Parameters
        ----------
        time : float
            Time of loads, flow and base (s).

        Returns
        -------
        State

        Raises
        ------
        RuntimeError
            If there is none. Under a JAX transformation nothing can be raised: there, use
            `find_equilibrium` and its outcome.
        """
        state, outcome = eqx.filter_jit(System.find_equilibrium)(self, jnp.asarray(time, float))
        if not isinstance(outcome.converged, jax.core.Tracer) and not outcome.converged:
            where = outcome.imbalance(self.reference.nodes, self.forces.free)
            raise RuntimeError(f"no static equilibrium found: {where}")
        warn_of_round_off(self.reference, self.forces, state.base_force)
        return state

    def find_equilibrium(self, time: float | Array = 0.0) -> tuple[State, Outcome]:
        """Find the static equilibrium at ``time``; the outcome says whether there is one.

        The flow is frozen at that time: only the acceleration of steady flows is a lasting load.
        The method is in ``crinoid.dynamics.statics``.

        Parameters
        ----------
        time : float
            Time of loads, flow and base (s).

        Returns
        -------
        tuple of State and Outcome
        """
        return resting.find_equilibrium(self, jnp.asarray(time, float))

    def step(
        self,
        state: State,
        command: Command,
        step: float | Array | None = None,
        *,
        throw: bool = False,
    ) -> tuple[State, Outcome]:
        """Advance by one time step, during which the actuators follow a command.

        Differentiable in both modes. If the outcome has not converged, the state must not be used;
        `advance` recovers.

        Parameters
        ----------
        state : State
            The arm at the start of the step.
        command : array (input)
            A number for each of `inputs`, in its unit.
        step : float
            Length of the step (s), ``time_step`` by default.
        throw : bool
            Whether to raise an error if the step has not converged, under `jax.jit` as well
            (`equinox.error_if`, by a callback to the host).

        Returns
        -------
        tuple of State and Outcome
        """
        h = self.time_step if step is None else jnp.asarray(step, float)
        at_start = (state.servo, *state.actuators)
        after, outcome = step_with(self, state, followed(self.followers, at_start, command, h), h)
        return outcome.raise_unless_converged(after) if throw else after, outcome

    def advance(
        self, state: State, command: Command, step: float | Array | None = None
    ) -> tuple[State, StepStatistics]:
        """Advance by one time step, halving it where Newton's method or the error limit fails.

        The shortest substep is ``2**-max_halvings`` of the step; if it fails too, the last good
        state comes back with a failed outcome. Not differentiable in reverse mode (a loop of
        unknown length): use `step`.

        Parameters
        ----------
        state, command, step
            As for `step`.

        Returns
        -------
        tuple of State and `crinoid.dynamics.StepStatistics`
        """
        return halve(self, lambda now, part: self.step(now, command, part), state, step, None)

    def advance_with_account(
        self,
        state: State,
        account: EnergyAccount,
        command: Command,
        step: float | Array | None = None,
        before: StepStatistics | None = None,
    ) -> tuple[State, EnergyAccount, StepStatistics]:
        """Advance like `advance`, and keep the account of works over each substep.

        The statistics are those ``before``, if any, and of this time step.
        """

        def once(
            carry: tuple[State, EnergyAccount], part: Array
        ) -> tuple[tuple[State, EnergyAccount], Outcome]:
            state, account = carry
            after, outcome = self.step(state, command, part)
            return (after, account.after(self.forces, state, after, part)), outcome

        (state, account), progress = halve(self, once, (state, account), step, before)
        return state, account, progress

    def energy(self, state: State) -> Float[Array, " energy"]:
        """Return the stored energies.

        Parameters
        ----------
        state : State
            The arm.

        Returns
        -------
        array (3)
            In the order of `crinoid.elements.ENERGIES` (J).
        """
        return ActingForces.of(self.forces, state.context).arm.energy(state.motion)

    def tip(self, state: State) -> Float[Array, " pose"]:
        """Return the tip's pose in the world.

        Parameters
        ----------
        state : State
            The arm.

        Returns
        -------
        array (pose)
            x, z (m) and the angle (rad); in space x, y, z and the direction, a unit vector.
        """
        pose = tip_pose(state.position)
        axes = self.forces.axes
        return pose + jnp.pad(self.forces.origin, (0, pose.size - axes))

    def strains(self, state: State) -> Float[Array, "n strain"]:
        """Return the curvature at each node; those of the tip are extrapolated.

        Parameters
        ----------
        state : State
            The arm.

        Returns
        -------
        array (node, strain)
            Curvature (1/m); in space kappa_1, kappa_2 (1/m) and twist (rad/m).
        """
        rest, length = self.reference.rest_strain[:-1], self.reference.strain_length[:-1]
        inner = rest + self.forces.strains(state.motion) / length
        return jnp.concatenate([inner, 2 * inner[-1:] - inner[-2:-1]])

    def linearise(self, state: State) -> tuple[banded.Bands, banded.Bands]:
        """Return stiffness (N/m) and mass (kg) of small motions of all nodes about ``state``.

        The state is taken as still, obstacles included, in frozen flow; the mass includes the added
        mass. `influence` has the stiffness of lines.
        """
        small = self.small_motions(state, jnp.zeros(self.forces.axes))
        return small.stiffness, small.mass

    def small_motions(self, state: State, current: Float[Array, " d"]) -> SmallMotions:
        """Return stiffness, damping and mass about ``state``, and in a steady ``current`` (m/s)."""
        return linearise(self.forces, state, current)

    def influence(self, state: State) -> Influence:
        """Return the influence of the inputs on boundary, loads and tip about a still ``state``."""
        return influence(self.base, self.forces, state)

    def transition(
        self,
        state: State,
        command: Command,
        *,
        observe: Callable[["System", State], Float[Array, " y"]] | None = None,
    ) -> Transition:
        """Linearise the time step from ``state`` under ``command``, exact for the integrator.

        ``observe`` is the output of a state, by default the pose of the tip; the method ``of`` of a
        `crinoid.Measurand` fits. ``crinoid.dynamics.transition`` defines the coordinates.
        """
        output = partial(observe or System.tip, self)
        return transition(self, state, command, self.time_step, output)
