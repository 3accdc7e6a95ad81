"""The assembled arm: everything that a time step needs, and the step itself."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid import chain
from crinoid.actuation import Actuator, Input, drives, split
from crinoid.base import Base
from crinoid.dynamics import modes, start, statics
from crinoid.dynamics.books import Books
from crinoid.dynamics.fold import SHARPEST, facing
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.halving import Progress, halve
from crinoid.dynamics.integrator import Integrator, Stage
from crinoid.dynamics.newton import Outcome, Settings, newton_step, solve
from crinoid.dynamics.prescribed import prescribed
from crinoid.dynamics.start import as_rows
from crinoid.dynamics.state import State
from crinoid.dynamics.tangent import HELD
from crinoid.dynamics.tip import tip_pose
from crinoid.elements import Motion
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

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The inputs that a command stands for: the base's channels, then those of actuators."""
        return tuple(each for one in self._followers for each in one.inputs)

    @property
    def _followers(self) -> tuple[Actuator, ...]:
        return (self.base.servo, *self.actuators)

    def rest(self, time: float | Array = 0.0) -> State:
        """Return the arm without load, as the base holds it at ``time``."""
        time = jnp.asarray(time, float)
        return self._begin(time, *start.undeformed(self.reference, self.base, self.forces, time))

    def clearance(self, time: float | Array = 0.0) -> Float[Array, " m"]:
        """Return how far each obstacle is from the arm without load (m)."""
        if self.forces.obstacles is None:
            return jnp.zeros(0)
        time = jnp.asarray(time, float)
        rows, _ = start.undeformed(self.reference, self.base, self.forces, time)
        return jnp.min(self.forces.obstacles.gaps(rows), axis=1)

    def equilibrium(self, time: float | Array = 0.0) -> State:
        """Return the arm in static equilibrium at ``time``, moving along with its base.

        Raises
        ------
        RuntimeError
            If none was found. Under a JAX transformation nothing can be raised: there, use
            `find_equilibrium` and its outcome.
        """
        state, outcome = eqx.filter_jit(System.find_equilibrium)(self, jnp.asarray(time, float))
        if not isinstance(outcome.converged, jax.core.Tracer) and not outcome.converged:
            raise RuntimeError(
                f"no static equilibrium found: node {int(outcome.worst_node)} is out of balance "
                f"by {float(outcome.residual):.3g} N among forces of up to "
                f"{float(outcome.scale):.3g} N"
            )
        return state

    def find_equilibrium(self, time: float | Array = 0.0) -> tuple[State, Outcome]:
        """Find the static equilibrium at ``time``; the outcome says whether there was one.

        The water flows on as it does at that time: what it is just gaining or losing in speed
        would be no lasting load. Of its acceleration that of the steady flows counts.
        See ``crinoid.dynamics.statics`` for how.
        """
        time = jnp.asarray(time, float)
        at_rest = [one.at_rest() for one in self.actuators]
        forces = self.forces.driven(drives(self.actuators, at_rest))
        rows, frames = start.undeformed(self.reference, self.base, forces, time)
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
        rows = state.motion.position
        stage, none = statics.still(state.time, rows, state.frames), jnp.zeros_like(rows)
        forces = self._driven(state).frozen(state.time)
        motion = forces.motion(stage, none, forces.surroundings(stage, none))
        return self._steady(forces, motion, (state.servo, *state.actuators))

    def step(
        self, state: State, command: Command, step: float | Array | None = None
    ) -> tuple[State, Outcome]:
        """Advance by one time step, the actuators following ``command``, in units of `inputs`.

        Differentiable in both modes. Where Newton's method fails the state comes back with the
        outcome that says so, and should not be used; `advance` recovers.
        """
        h = self.time_step if step is None else jnp.asarray(step, float)
        before, method = state.motion, self.integrator
        servo, *actuators = (
            one.advance(of_one, part, h)
            for one, of_one, part in zip(
                self._followers,
                (state.servo, *state.actuators),
                split(command, self._followers),
                strict=True,
            )
        )
        forces = self.forces.driven(drives(self.actuators, actuators))
        stage = method.stage(before, state.ahead, h, state.frames)
        stage = prescribed(forces, self.base, stage, state, servo, h)

        def moved(acceleration: Rows) -> Rows:
            return method.correction(acceleration, h).at[:HELD].set(0.0)  # these are prescribed

        # the water is costly: looked at once, where the arm gets to if its acceleration stays, and
        # expanded from there. Not from Newton's guess, which is chosen: a step would jump with it
        around = forces.surroundings(stage, moved(before.acceleration))
        guess = moved(state.expected_acceleration)
        correction, reaction, outcome = solve(forces, around, stage, guess, self.settings, None)
        motion = forces.motion(stage, correction, around)
        after = State(
            motion=motion,
            ahead=method.ahead(before.acceleration, state.ahead, motion.acceleration, h),
            servo=servo,
            actuators=tuple(actuators),
            reaction=reaction,
            gap=self._gap(forces, motion),
            earlier=jnp.stack([before.acceleration, state.earlier[0]]),
        )
        return after, self._judged(state, after, outcome, h)

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
        return self.forces.audit(state.motion)[0]

    def tip(self, state: State) -> Float[Array, " pose"]:
        """Return the tip's pose in the world (`crinoid.space.POSE`): position (m) and direction."""
        pose = tip_pose(state.position)
        axes = self.forces.axes
        return pose.at[:axes].add(self.forces.origin)

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
        mass contains the added mass.
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
        return modes.find_modes(*eqx.filter_jit(System.linearise)(self, state), count).frequency

    def static_jacobian(
        self, state: State, stiffness: chain.Bands | None = None
    ) -> Float[Array, "pose channel"]:
        """Return d(tip)/d(channels) at rest: how the tip follows the base when moved slowly.

        The forces are linearised about ``state``, taken as still; ``stiffness`` is that of
        `linearise` where it is at hand already.
        """
        bands = self.linearise(state)[0] if stiffness is None else stiffness
        held, axes = self.held(state), self.forces.axes

        def follow(moved: Float[Array, "2 b"]) -> Float[Array, "n d"]:
            nodes = jnp.zeros((state.position.shape[0], moved.shape[1])).at[:HELD].set(moved)
            free = chain.solve(bands[HELD:], -chain.matvec(bands, nodes)[HELD:])
            return nodes.at[HELD:].set(free)[:, :axes]

        moved = jax.vmap(follow, -1, -1)(held)
        return jax.vmap(lambda d: jax.jvp(tip_pose, (state.position,), (d,))[1], -1, -1)(moved)

    def held(self, state: State) -> Float[Array, "2 b channel"]:
        """Return how the ghost node and the root follow small moves of the channels."""
        pose, _, _ = self.base.pose(state.time, state.servo)
        return jax.vmap(lambda rate: self.base.moving(pose, rate)[1], out_axes=-1)(
            jnp.eye(pose.size)
        )

    def tip_follows(self, state: State) -> Float[Array, "pose 3 d"]:
        """Return how the tip's pose follows small moves of the last three nodes."""
        return jax.jacfwd(tip_pose)(state.position[-3:])

    def _judged(self, state: State, after: State, outcome: Outcome, step: Array) -> Outcome:
        """Return the outcome of a step, which counts only if neither folds, errors nor hits forbid.

        Whether Newton's method converged the outcome says on entry.
        """
        before, now = state.motion, after.motion
        folded = jnp.any(facing(self.forces, now.position) < SHARPEST)
        error = jnp.where(outcome.converged, self._error(before, now, step), 0.0)
        good, resolved = outcome.converged & ~folded & (error <= self.max_error), outcome.resolved
        if self.forces.obstacles is not None:
            assert state.gap is not None
            assert after.gap is not None
            resolved = ~good | self.forces.obstacles.resolved(
                before.position, state.gap, now.position, after.gap, step
            )
        return eqx.tree_at(
            lambda o: (o.converged, o.resolved, o.folded, o.error),
            outcome,
            (good & resolved, resolved, folded, error),
        )

    def _error(self, before: Motion, after: Motion, step: Array) -> Float[Array, ""]:
        """Return the largest estimated local error of a position that a step solves for (m)."""
        error = self.integrator.error(before.acceleration, after.acceleration, step)
        error = jax.lax.stop_gradient(self.forces.unknown(error)[:, : self.forces.axes])
        return jnp.sqrt(jnp.max(jnp.sum(error**2, axis=1)))

    def _begin(self, time: Array, position: Rows, frames: Frames | None) -> State:
        """Start from a shape, moving rigidly with the base, with the acceleration that follows."""
        servo, *actuators = (one.at_rest() for one in self._followers)
        forces, axes = self.forces.driven(drives(self.actuators, actuators)), self.forces.axes
        held = self.base.prescribe(time, servo)
        velocity = start.carried(held, forces.nodes(position))
        velocity = velocity.at[:HELD].set(held.velocity)
        obstacles = forces.obstacles
        if obstacles is not None:
            points = position[-obstacles.count :, :axes]
            started = obstacles.begin(points, lambda p: forces.flow_velocity(p, time))
            velocity = jnp.concatenate([velocity, as_rows(started, velocity.shape[1])])
        stage = Stage(
            time,
            position,
            velocity,
            jnp.zeros_like(position).at[:HELD].set(held.acceleration),
            jnp.zeros(()),
            jnp.zeros(()),
            jnp.ones(()),
            frames,
        )
        # forces are affine in the acceleration: one Newton step is exact
        none = jnp.zeros_like(position)
        around = forces.surroundings(stage, none)
        residual, _ = forces.residual(forces.motion(stage, none, around))
        acceleration = newton_step(forces, around, stage, none, residual)
        motion = forces.motion(stage, acceleration, around)
        return self._steady(forces, motion, (servo, *actuators))

    def _steady(self, forces: Forces, motion: Motion, followers: Sequence[Any]) -> State:
        """Return the state of an arm whose motion is known, and steady."""
        residual, _ = forces.residual(motion)
        servo, *actuators = followers
        return State(
            motion=motion,
            ahead=jnp.zeros_like(motion.position),
            servo=servo,
            actuators=tuple(actuators),
            reaction=residual[:HELD],
            gap=self._gap(forces, motion),
            earlier=jnp.stack([motion.acceleration] * 2),
        )

    def _driven(self, state: State) -> Forces:
        """Return the forces with the actuators as they are in a state."""
        return self.forces.driven(drives(self.actuators, state.actuators))

    @staticmethod
    def _gap(forces: Forces, motion: Motion) -> Float[Array, "m e"] | None:
        return None if forces.obstacles is None else forces.obstacles.gaps(motion.position)
