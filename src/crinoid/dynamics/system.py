"""The assembled arm: everything that a time step needs, and the step itself."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid import chain
from crinoid.actuation import Actuator, Input, drives, followed
from crinoid.base import Base
from crinoid.dynamics import modes, start, statics
from crinoid.dynamics.books import Books
from crinoid.dynamics.fold import SHARPEST, facing
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.grasp import Grasp, begun, gripped
from crinoid.dynamics.grip import holding
from crinoid.dynamics.guess import expected_acceleration, first_guess
from crinoid.dynamics.halving import Progress, halve
from crinoid.dynamics.influence import Influence, influence
from crinoid.dynamics.integrator import Integrator
from crinoid.dynamics.newton import Kept, Settings, solve
from crinoid.dynamics.outcome import Outcome
from crinoid.dynamics.prescribed import prescribed
from crinoid.dynamics.round_off import warn_of_round_off
from crinoid.dynamics.state import State
from crinoid.dynamics.surroundings import Stir
from crinoid.dynamics.tangent import HELD
from crinoid.dynamics.tip import tip_pose
from crinoid.dynamics.transition import Transition, transition
from crinoid.dynamics.vehicle import Voyage
from crinoid.frames import Frames
from crinoid.reference import Reference

Command = Float[Array, " input"]
Rows = Float[Array, "rows b"]


class System(eqx.Module):
    """A soft arm on its base in the water, as arrays: `jax.jit`, `jax.grad` and `jax.vmap` apply.

    Built by `crinoid.system`. To compile a method, use ``equinox.filter_jit(system.step)``
    or pass the system as an argument of a function under `jax.jit`.
    """

    reference: Reference
    forces: Forces
    base: Base
    integrator: Integrator
    settings: Settings
    time_step: Float[Array, ""]
    max_error: Float[Array, ""]
    """Largest estimated local error of a step that counts (m); infinite where any does."""
    max_halvings: Int[Array, ""]
    actuators: tuple[Actuator, ...] = ()
    """Actuators beside the servos of the base."""
    grasp: Grasp | None = None
    """Touches at which the tip takes up its tool, or lets it go; None where none decides."""

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The inputs that a command stands for: the base's channels, then those of actuators."""
        return tuple(each for one in self.followers for each in one.inputs)

    @property
    def followers(self) -> tuple[Actuator, ...]:
        """The servos of the base, and the other actuators: who follows a command, in its order."""
        return (self.base.servo, *self.actuators)

    def rest(self, time: float | Array = 0.0) -> State:
        """Return the arm without load, as the base holds it at ``time``."""
        time = jnp.asarray(time, float)
        return self._begin(time, *start.undeformed(self.reference, self.base, self.forces, time))

    def undeformed(self, time: float | Array) -> tuple[Forces, Array, Rows, Frames | None]:
        """Return the forces with actuators at rest, the time, and the arm without load then."""
        time = jnp.asarray(time, float)
        forces = self.forces.driven(drives(self.actuators, [x.at_rest() for x in self.actuators]))
        return forces, time, *start.undeformed(self.reference, self.base, forces, time)

    def clearance(self, time: float | Array = 0.0) -> Float[Array, " m"]:
        """Return how far each obstacle is from the arm without load (m)."""
        if self.forces.obstacles is None:
            return jnp.zeros(0)
        _, _, rows, _ = self.undeformed(time)
        return jnp.min(self.forces.obstacles.gaps(self.forces.without_vehicle(rows)), axis=1)

    def equilibrium(self, time: float | Array = 0.0) -> State:
        """Return the arm in static equilibrium at ``time``, moving along with its base.

        A `RuntimeWarning` says where round-off of the stretch is not small beside the loads.

        Raises
        ------
        RuntimeError
            If none was found. Under a JAX transformation nothing can be raised: there, use
            `find_equilibrium` and its outcome.
        """
        state, outcome = eqx.filter_jit(System.find_equilibrium)(self, jnp.asarray(time, float))
        if not isinstance(outcome.converged, jax.core.Tracer) and not outcome.converged:
            where = outcome.imbalance(self.reference.nodes, self.forces.free)
            raise RuntimeError(f"no static equilibrium found: {where}")
        warn_of_round_off(self.reference, self.forces, state.base_force)
        return state

    def find_equilibrium(self, time: float | Array = 0.0) -> tuple[State, Outcome]:
        """Find the static equilibrium at ``time``; the outcome says whether there was one.

        The water flows on as it does at that time: what it is just gaining or losing in speed
        would be no lasting load. Of its acceleration that of the steady flows counts.
        See ``crinoid.dynamics.statics`` for how.
        """
        forces, time, rows, frames = self.undeformed(time)
        position, frames, outcome = statics.find(
            self.reference,
            forces.frozen(time),
            self.settings,
            time,
            start.clamped(self.base, time, rows, frames),
            frames,
        )
        return self._begin(time, position, frames), outcome

    def stand(self, state: State) -> State:
        """Return the same shape without any motion, in water that flows on as it does: statics."""
        forces = self._driven(state).frozen(state.time)
        motion = statics.standing(forces, state.time, state.motion.position, state.frames)
        at_rest, kept = (state.servo, *state.actuators), state.kept
        reaction = forces.residual(motion)[0][:HELD]
        return start.steady(forces, motion, reaction, at_rest, state.attitude, state.grip, kept)

    def step(
        self,
        state: State,
        command: Command,
        step: float | Array | None = None,
        *,
        throw: bool = False,
    ) -> tuple[State, Outcome]:
        """Advance by one time step, the actuators following ``command``, in units of `inputs`.

        Differentiable in both modes. Where Newton's method fails the state comes back with the
        outcome that says so, and should not be used; `advance` recovers. With ``throw`` an error is
        raised there, under `jax.jit` as well (`equinox.error_if`, which asks the host).
        """
        h = self.time_step if step is None else jnp.asarray(step, float)
        at_start = (state.servo, *state.actuators)
        after, outcome = self.moved(state, followed(self.followers, at_start, command, h), h)
        return outcome.required(after) if throw else after, outcome

    def moved(
        self, state: State, ends: Sequence[Any], step: Float[Array, ""], stir: Stir | None = None
    ) -> tuple[State, Outcome]:
        """Advance by one time step at whose end the actuators are in the states ``ends``.

        ``stir`` changes the water at the nodes then.
        """
        h, before, method = step, state.motion, self.integrator
        servo, *actuators = ends
        grip = gripped(self.grasp, self.forces.obstacles, state)
        forces = holding(self.forces.driven(drives(self.actuators, actuators)), grip)
        stage = method.stage(before, state.ahead, h, state.frames)
        forces = start.mounted(forces, self.base, stage.time, servo, state)
        stage = prescribed(forces, self.base, stage, state, servo, h)

        def moved(acceleration: Rows) -> Rows:
            free = method.correction(acceleration, h)[HELD:]  # the others are prescribed
            return jnp.pad(free, ((HELD, 0), (0, 0)))

        # the water is costly: looked at once, where the arm gets to if its acceleration stays, and
        # expanded from there. Not from Newton's guess, which is chosen: a step would jump with it
        around = forces.surroundings(stage, moved(before.acceleration))
        if stir is not None:
            around = around.stirred(stir)
        guess = moved(expected_acceleration(forces, state))
        if forces.mount is None:
            held = self.base.prescribe(stage.time, servo)
            guess = first_guess(forces, held, stage, state, guess)
        correction, reaction, outcome, kept = solve(
            forces, around, stage, guess, self.settings, None, state.kept
        )
        motion = forces.motion(stage, correction, around)
        after = State(
            motion=motion,
            ahead=method.ahead(before.acceleration, state.ahead, motion.acceleration, h),
            servo=servo,
            actuators=tuple(actuators),
            reaction=reaction,
            gap=forces.gaps(motion.position),
            earlier=jnp.concatenate([before.acceleration[None], state.earlier[:-1]]),
            guessed=outcome.iterations == 0,
            kept=jax.lax.stop_gradient(kept),
            attitude=forces.attitude(motion),
            grip=grip,
        )
        return after, self._judged(forces, state, after, outcome, h)

    def advance(
        self, state: State, command: Command, step: float | Array | None = None
    ) -> tuple[State, Progress]:
        """Advance by one time step, halving it where Newton's method fails or it errs too much.

        Down to ``2**-max_halvings`` of the step; past that the last good state comes back with a
        failed outcome. Not differentiable in reverse mode (a loop of unknown length): use `step`.
        """
        h = self.time_step if step is None else jnp.asarray(step, float)
        return halve(
            lambda s, part: self.step(s, command, part),
            state,
            h,
            self.max_halvings,
            self.max_error,
        )

    def advance_with_books(
        self, state: State, books: Books, command: Command, step: float | Array | None = None
    ) -> tuple[State, Books, Progress]:
        """Advance like `advance`, and keep the accounts of each part of the step."""

        def once(carry: tuple[State, Books], part: Array) -> tuple[tuple[State, Books], Outcome]:
            state, books = carry
            after, outcome = self.step(state, command, part)
            return (after, books.after(self.forces, state, after, part)), outcome

        h = self.time_step if step is None else jnp.asarray(step, float)
        (state, books), progress = halve(once, (state, books), h, self.max_halvings, self.max_error)
        return state, books, progress

    def energy(self, state: State) -> Float[Array, " energy"]:
        """Return the stored energies, in the order of `crinoid.elements.ENERGIES` (J)."""
        return holding(self.forces, state.grip).energy(state.motion)

    def tip(self, state: State) -> Float[Array, " pose"]:
        """Return the tip's pose in the world (`crinoid.space.POSE`): position (m) and direction."""
        pose = tip_pose(state.position)
        axes = self.forces.axes
        return pose + jnp.pad(self.forces.origin, (0, pose.size - axes))

    def voyage(self, state: State) -> Voyage | None:
        """Return where the vehicle is and what its thrusters do; None where the base is held."""
        vehicle = self.forces.vehicle
        if vehicle is None or state.attitude is None:
            return None
        return vehicle.voyage(state.motion, state.attitude)

    def strains(self, state: State) -> Float[Array, "n strain"]:
        """Return the curvature at each node (1/m); in space kappa_1, kappa_2 and twist (rad/m).

        The tip's are carried on from the two nodes before, as nothing bends round the tip.
        """
        rest, length = self.reference.rest_strain[:-1], self.reference.strain_length[:-1]
        inner = rest + self.forces.strains(state.motion) / length
        return jnp.concatenate([inner, 2 * inner[-1:] - inner[-2:-1]])

    def linearise(self, state: State) -> tuple[chain.Bands, chain.Bands]:
        """Return stiffness (N/m) and mass (kg) of small motions of all nodes about ``state``.

        The state is taken as still, obstacles included, in water that flows on as it does; the
        mass contains the added mass. `influence` has the stiffness of lines.
        """
        small = self.small_motions(state, jnp.zeros(self.forces.axes))
        return small.stiffness, small.mass

    def small_motions(self, state: State, current: Float[Array, " d"]) -> modes.SmallMotions:
        """Return what `linearise` does, and more, for a steady ``current`` (m/s)."""
        motion = state.motion
        forces = self._driven(state)
        return modes.linearise(forces, state.time, motion.position, state.frames, current)

    def natural_frequencies(
        self, state: State, *, count: int = modes.COUNT
    ) -> Float[np.ndarray, " mode"]:
        """Return the natural frequencies of small vibrations about ``state`` (Hz), ascending.

        The base is held and damping left out; 0 stands for a motion that does not swing back.
        Computed on the host: not for use under a JAX transformation.
        See `crinoid.dynamics.find_modes` for how, and for the shapes.
        """
        bands, lines = eqx.filter_jit(System.linearise)(self, state), None
        if self.forces.lines is not None:
            lines = eqx.filter_jit(System.influence)(self, state).lines
        return modes.find_modes(*bands, count, lines).frequency

    def static_jacobian(self, state: State) -> Float[Array, "pose input"]:
        """Return d(tip)/d(inputs) at rest: how the tip follows the inputs when moved slowly.

        The forces are linearised about ``state``, taken as still.
        """
        return self.influence(state).static(self.linearise(state)[0])

    def influence(self, state: State) -> Influence:
        """Return what small moves of the inputs do to the arm about ``state``, taken as still."""
        return influence(self.base, self._driven(state), state)

    def transition(
        self,
        state: State,
        command: Command,
        *,
        observe: Callable[["System", State], Float[Array, " y"]] | None = None,
    ) -> Transition:
        """Linearise the time step from ``state`` under ``command``, exact for the integrator.

        ``observe`` says what is seen of a state, that of the tip if left out; a
        `crinoid.Measurand` has it as its method ``of``. See ``crinoid.dynamics.transition`` for the
        coordinates.
        """
        return transition(self, state, command, self.time_step, observe or System.tip)

    def _judged(
        self, forces: Forces, state: State, after: State, outcome: Outcome, step: Array
    ) -> Outcome:
        """Return the outcome of a step, which counts only if neither folds, errors nor hits forbid.

        Whether Newton's method converged the outcome says on entry.
        """
        before, now = state.motion, after.motion
        folded = jnp.any(facing(forces, now.position) < SHARPEST)
        errors = self.integrator.error(before.acceleration, now.acceleration, step)
        errors = jax.lax.stop_gradient(forces.unknown(errors, forces.reach)[:, : forces.axes])
        largest = jnp.sqrt(jnp.max(jnp.sum(errors**2, axis=1)))
        error = jnp.where(outcome.converged, largest, 0.0)
        good, resolved = outcome.converged & ~folded & (error <= self.max_error), outcome.resolved
        if forces.obstacles is not None:
            assert state.gap is not None
            assert after.gap is not None
            rows = map(forces.without_vehicle, (before.position, now.position))
            was, now_at = rows
            resolved = ~good | forces.obstacles.resolved(was, state.gap, now_at, after.gap, step)
        return eqx.tree_at(
            lambda o: (o.converged, o.resolved, o.folded, o.error),
            outcome,
            (good & resolved, resolved, folded, error),
        )

    def _begin(self, time: Array, position: Rows, frames: Frames | None) -> State:
        """Start from a shape, moving rigidly with the base, with the acceleration that follows."""
        servo, *actuators = (one.at_rest() for one in self.followers)
        forces = self.forces.driven(drives(self.actuators, actuators))
        forces, motion, held = start.begin(forces, self.base, servo, time, position, frames)
        attitude, grip = forces.attitude(motion), begun(self.grasp)
        kept = Kept.nothing(forces, motion.position)
        return start.steady(forces, motion, held, (servo, *actuators), attitude, grip, kept)

    def _driven(self, state: State) -> Forces:
        """Return the forces with the actuators as they are in a state."""
        return holding(self.forces.driven(drives(self.actuators, state.actuators)), state.grip)
