"""Static equilibrium: the arm at rest under its loads, however far they bend it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.forces import Forces
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.newton import (
    Kept,
    Settings,
    constant,
    imbalance,
    implied,
    solve,
    tangent_at,
)
from crinoid.dynamics.outcome import Outcome
from crinoid.dynamics.surroundings import Surroundings
from crinoid.elements import Motion
from crinoid.frames import Frames
from crinoid.reference import Reference

Rows = Float[Array, "rows b"]

_FIRST_SHARE = 0.25
"""Share of the loads that the first solve brings on."""
_SMALLEST_SHARE = 1e-3
"""Share below which the rest of the loads is brought on at once, for the relaxation to mend."""
_NEARER = 0.9
"""Share of the imbalance that an accepted solve may leave in the water where the arm now is."""
_SHIFT_FALL = 0.5
"""Factor of the resistance from one solve to the next while the arm comes to rest."""
_SHIFT_RISE = 4.0
"""Factor of the resistance after a solve that was not accepted."""
_KICK = 1e-3
"""Push aside that tries an equilibrium, over the arm's length; less a solve is no progress."""
_STILL = 1e-9
"""Movement over the arm's length that is none."""
_LEAVING = 1.2
"""Growth of the movement, at the same resistance, from which on the arm leaves where it is."""
_MAX_SOLVES = 400
"""Solves in which the arm must come to rest."""
_LAST_SOLVES = 20
"""Solves after that for an arm that is given back the shape that first bore all loads."""

_TOLERANCE_SHARE = 1e-3
"""Tolerance over that of a time step: what the search leaves aside would stay there."""


def still(
    time: Array, position: Rows, frames: Frames | None, by_acceleration: Array | float = 0.0
) -> Stage:
    """Return a stage without velocity in which the correction moves the nodes."""
    zero, one = jnp.zeros_like(position), jnp.ones(())
    shift = jnp.asarray(by_acceleration, float)
    return Stage(time, position, zero, zero, one, jnp.zeros(()), shift, frames, ("velocity",))


def standing(forces: Forces, time: Array, position: Rows, frames: Frames | None) -> Motion:
    """Return the motion of an arm that does not move, in the water around it."""
    stage, none = still(time, position, frames), jnp.zeros_like(position)
    return forces.motion(stage, none, forces.surroundings(stage, none))


def find(
    reference: Reference,
    forces: Forces,
    settings: Settings,
    time: Float[Array, ""],
    start: Rows,
    frames: Frames | None,
) -> tuple[Rows, Frames | None, Outcome]:
    """Find a stable `equilibrium` of an arm, searching as far and as finely as its sections ask.

    ``settings`` are those of a time step.
    """
    # bending over length, and loads over mass: the squared rates at which an arm leaves a
    # shape that does not hold lie between the first, the softer way, and the sum of both
    mass, length = forces.mass, reference.length
    bending = forces.bending_stiffness(reference) / (mass * length**3)
    _, loads = forces.residual(standing(forces, time, start, frames))
    load = jnp.max(settings.weights * loads)
    room = None if forces.obstacles is None else forces.obstacles.finest / 2
    careful = eqx.tree_at(
        lambda s: (s.tolerance, s.max_turn, s.max_move),
        settings,
        (_TOLERANCE_SHARE * settings.tolerance, jnp.asarray(0.5), room),
        is_leaf=lambda x: x is None,
    )
    return equilibrium(
        forces,
        time,
        start,
        frames,
        careful,
        1e-3 * jnp.min(bending),
        1e3 * (jnp.max(bending) + load * reference.nodes / (mass * length)),
    )


class _Shape(eqx.Module):
    position: Rows
    frames: Frames | None
    around: Surroundings
    """The water where the arm is."""


class _Search(eqx.Module):
    shape: _Shape
    first_loaded: _Shape
    """Where the arm first bore the whole load."""
    bore_load: Bool[Array, ""]
    """Whether it ever did: it may have been let go without."""
    load_factor: Float[Array, ""]
    share: Float[Array, ""]
    """Share of the loads to bring on next."""
    loaded: Bool[Array, ""]
    """Whether the whole load is on."""
    shift: Float[Array, ""]
    """Viscosity of the medium, times the mass (1/s2)."""
    moved: Float[Array, ""]
    """How far the last solve with this shift moved the arm (m); negative before the first."""
    settled: Bool[Array, ""]
    """Whether the arm has come to rest, or has given up: solves are without a medium."""
    solves: Int[Array, ""]
    iterations: Int[Array, ""]


@eqx.filter_custom_jvp
def equilibrium(
    forces: Forces,
    time: Float[Array, ""],
    start: Rows,
    frames: Frames | None,
    settings: Settings,
    slowest_rate: Float[Array, ""],
    fastest_rate: Float[Array, ""],
) -> tuple[Rows, Frames | None, Outcome]:
    """Find a stable equilibrium of the forces at ``time``.

    First the forces from outside are brought on in shares, halved where Newton's method fails and
    doubled where it does not. Then the arm is pushed aside by a thousandth of its length and let
    go in a very viscous medium (implicit Euler steps of ``s M dq/ds = -residual``, pseudo-transient
    continuation, Kelley and Keyes 1998). The viscosity ``s`` is halved from step to step while
    the arm comes to rest, and kept while two steps at the same viscosity show it moving faster
    and faster: it comes back to an equilibrium that is stable, leaves one that is not (a column
    past its buckling load), and also arrives where the shares got stuck at a limit point. Loads
    that turn or twist the arm need not leave it any stable equilibrium; if it is still moving
    after the allowed solves, the shape that first bore the whole load is what there is.

    Each solve takes the water as it is where the arm is, expanded to first order. One that carries
    the arm to where the water is another counts only if the balance there, in the water as it is,
    is nearer than before: else the arm would wander from eddy to eddy for ever.

    ``slowest_rate`` and ``fastest_rate`` (1/s2) bracket the squared rates at which the arm can
    leave an equilibrium. Returns the positions (m; the first two as in ``start``, and those of the
    obstacles), in space the frames there, and the outcome: the balance at these positions, in the
    water as it is there, with all iterations counted. The positions, spins with them, are
    differentiable as the solution of the balance; the frames are to be carried on from there.
    """
    tip = forces.nodes(start).shape[0] - 1
    along = jnp.linspace(0.0, 1.0, tip - 1)[1:, None]
    edges = jnp.diff(start[1 : tip + 1, : forces.axes], axis=0)
    reach = jnp.sum(jnp.sqrt(jnp.sum(edges**2, axis=1)))
    none = jnp.zeros_like(start)
    nothing_kept = Kept.nothing(forces, start)

    def allowed(search: _Search) -> Int[Array, ""]:
        return jnp.where(search.bore_load, _MAX_SOLVES + _LAST_SOLVES, _MAX_SOLVES)

    def unfinished(carry: tuple[_Search, Outcome]) -> Bool[Array, ""]:
        search, outcome = carry
        return ~outcome.converged & (search.solves <= allowed(search))

    def advance(carry: tuple[_Search, Outcome]) -> tuple[_Search, Outcome]:
        search, _ = carry
        shape = search.shape
        # after the last solve the balance as it is decides, as that of a time step would
        last = search.solves == allowed(search)
        judged = eqx.tree_at(
            lambda s: (s.tolerance, s.max_iterations),
            settings,
            (
                jnp.where(last, 1 / _TOLERANCE_SHARE, 1.0) * settings.tolerance,
                jnp.where(last, 0, settings.max_iterations),
            ),
        )
        load_factor = jnp.minimum(1.0, search.load_factor + search.share)
        load_factor = jnp.where(search.loaded | last, 1.0, load_factor)
        bare = last | search.settled | ~search.loaded
        stage = still(time, shape.position, shape.frames, jnp.where(bare, 0.0, search.shift))

        def balance(around: Surroundings, correction: Rows) -> Outcome:
            return imbalance(forces, around, stage, correction, judged, load_factor)[1]

        correction, _, solved, _ = solve(
            forces, shape.around, stage, none, judged, load_factor, nothing_kept
        )
        there = forces.surroundings(stage, correction)
        both = jax.vmap(balance)(*_stacked((shape.around, none), (there, correction)))
        outcome = jax.tree.map(lambda x: x[1], both)
        nearer = outcome.residual <= _NEARER * both.residual[0]
        good = solved.converged & (outcome.converged | nearer)
        position = shape.position + correction
        frames = shape.frames
        if frames is not None:
            nodes = forces.nodes(position)
            frames = Frames.of(nodes, frames.at(nodes))
        shape = _choose(good, _Shape(position, frames, there), shape)

        share = jnp.where(good, 2.0, 0.5) * search.share
        bears_load = good & (load_factor >= 1.0)
        loaded = search.loaded | bears_load | (share < _SMALLEST_SHARE)
        just_loaded = loaded & ~search.loaded
        first_loaded = _choose(search.loaded, search.first_loaded, shape)

        moved = jnp.max(jnp.abs(correction[:, : forces.axes]))
        leaving = (moved > _LEAVING * search.moved) & (moved > _STILL * reach)
        kept = good & ((search.moved < 0) | leaving)
        fall = jnp.where(kept, 1.0, jnp.where(good, _SHIFT_FALL, _SHIFT_RISE))
        shift = jnp.where(search.loaded, fall * search.shift, search.shift)

        # still moving after the allowed solves: give up, and go back to the shape that first
        # bore the whole load; an arm that no longer gets anywhere is stuck short of one
        wandering = good & (moved > _KICK * reach) & ~search.settled
        gives_up = search.bore_load & wandering & (search.solves >= _MAX_SOLVES)
        # frames and water are those of before the kick: they reach that far
        chord = shape.position[tip] - shape.position[1]
        kick = _KICK * reach * along**2 * _aside(chord, reach, forces.axes)
        beside = ((3, shape.position.shape[0] - tip - 1), (0, 0))
        kicked = shape.position + jnp.pad(jnp.where(just_loaded, kick, 0.0), beside)
        shape = _choose(gives_up, first_loaded, _Shape(kicked, shape.frames, shape.around))
        iterations = search.iterations + solved.iterations
        return _Search(
            shape=shape,
            first_loaded=first_loaded,
            bore_load=search.bore_load | (just_loaded & bears_load),
            load_factor=jnp.where(good, load_factor, search.load_factor),
            share=share,
            loaded=loaded,
            shift=jnp.where(gives_up, 0.0, shift),
            moved=jnp.where(search.loaded & kept, moved, -1.0),
            settled=gives_up | (search.loaded & good & (shift < slowest_rate)),
            solves=search.solves + 1,
            iterations=iterations,
        ), eqx.tree_at(
            # only a bare balance decides, in the water as it is where the arm has come to lie
            lambda o: (o.converged, o.iterations),
            outcome,
            (solved.converged & outcome.converged & (search.settled | last), iterations),
        )

    beginning = still(time, start, frames)
    shape = _Shape(start, frames, forces.surroundings(beginning, none))
    no, nothing, zero = jnp.asarray(False), jnp.asarray(0), jnp.zeros(())
    search, outcome = jax.lax.while_loop(
        unfinished,
        advance,
        (
            _Search(
                shape=shape,
                first_loaded=shape,
                bore_load=no,
                load_factor=zero,
                share=zero + _FIRST_SHARE,
                loaded=no,
                shift=fastest_rate,
                moved=zero - 1,
                settled=no,
                solves=nothing,
                iterations=nothing,
            ),
            Outcome.of_nothing(converged=False),
        ),
    )
    return search.shape.position, search.shape.frames, outcome


@equilibrium.def_jvp
def _equilibrium_jvp(primals: Any, tangents: Any) -> Any:
    forces, time, start, *_ = primals
    t_forces, t_time, t_start, *_ = tangents
    position, frames, outcome = equilibrium(*primals)
    held = jnp.zeros_like(start) if t_start is None else t_start

    def begin(forces: Forces, time: Array, position: Rows) -> tuple[Stage, Surroundings]:
        stage = still(time, position, frames)
        return stage, forces.surroundings(stage, jnp.zeros_like(start))

    (stage, around), (t_stage, t_around) = eqx.filter_jvp(
        begin, (forces, time, position), (t_forces, t_time, held)
    )
    full = jnp.ones(())
    none = jnp.zeros_like(start)
    correction, _ = implied(
        (forces, around, stage, full),
        (t_forces, t_around, t_stage, None),
        none,
        tangent_at(forces, around, stage, none, full),
    )
    t_frames = jax.tree.map(jnp.zeros_like, frames)
    return (position, frames, outcome), (correction + held, t_frames, constant(outcome))


def _choose(first: Bool[Array, ""], one: Any, other: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(first, a, b), one, other)


def _stacked(*trees: Any) -> Any:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


def _aside(chord: Float[Array, " b"], reach: Float[Array, ""], axes: int) -> Float[Array, " b"]:
    """Return a direction across a chord: in the plane the one up from it, in space a bit of y too.

    So the arm finds its way out of a plane in which it does not stay, and in the plane it goes to
    the same side as a planar arm. Of an arm that closes on itself the chord is taken as forward.
    """
    up = axes - 1
    length = jnp.sqrt(jnp.sum(chord[:axes] ** 2))
    closed = length < 1e-6 * reach
    unit = np.eye(chord.size)
    chord = jnp.where(closed, unit[0], chord / jnp.where(closed, 1.0, length))
    across = chord[0] * unit[up] - chord[up] * unit[0]
    if axes == 3:
        aside = unit[1] - chord[1] * chord * (np.arange(chord.size) < axes)
        across += 0.3 * aside + chord[1] ** 8 * unit[0]
    return across / jnp.sqrt(jnp.sum(across**2))
