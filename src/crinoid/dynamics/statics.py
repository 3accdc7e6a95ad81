"""Static equilibrium: the arm at rest under its loads, however far they bend it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.forces import Forces
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.newton import Outcome, Settings, constant, implied, solve
from crinoid.dynamics.surroundings import Surroundings
from crinoid.frames import Frames
from crinoid.rod import Rod

Rows = Float[Array, "rows b"]

_FIRST_SHARE = 0.25
_SMALLEST_SHARE = 1e-3
_SHIFT_FALL = 0.5
_KICK = 1e-3
_STILL = 1e-9
_LEAVING = 1.2
_MAX_SOLVES = 400
_LAST_SOLVES = 20

_TOLERANCE_SHARE = 1e-3
"""Tolerance over that of a time step: what the search leaves aside would stay there."""


def still(
    time: Array, position: Rows, frames: Frames | None, by_acceleration: Array | float = 0.0
) -> Stage:
    """Return a stage without velocity in which the correction moves the nodes."""
    zero, one = jnp.zeros_like(position), jnp.ones(())
    shift = jnp.asarray(by_acceleration, float)
    return Stage(time, position, zero, zero, one, jnp.zeros(()), shift, frames)


def find(
    rod: Rod,
    forces: Forces,
    settings: Settings,
    time: Float[Array, ""],
    start: Rows,
    frames: Frames | None,
) -> tuple[Rows, Frames | None, Outcome]:
    """Find a stable `equilibrium` of a rod, searching as far and as finely as its sections ask.

    ``settings`` are those of a time step.
    """
    # bending over length, and loads over mass: the squared rates at which an arm leaves a
    # shape that does not hold lie between the first, the softer way, and the sum of both
    mass = jnp.sum(rod.mass_per_length * rod.voronoi_length)
    bending = jnp.mean(rod.EI, axis=0) / (mass * rod.length**3)
    stage, none = still(time, start, frames), jnp.zeros_like(start)
    _, loads = forces.residual(forces.motion(stage, none, forces.surroundings(stage, none)))
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
        1e3 * (jnp.max(bending) + load * rod.nodes / (mass * rod.length)),
    )


class _Search(eqx.Module):
    position: Rows
    frames: Frames | None
    balanced: tuple[Rows, Frames | None]
    """Where the arm first bore the whole load."""
    borne: Bool[Array, ""]
    load_factor: Float[Array, ""]
    share: Float[Array, ""]
    loaded: Bool[Array, ""]
    shift: Float[Array, ""]
    moved: Float[Array, ""]
    """How far the last solve with this shift moved the arm (m); negative before the first."""
    settled: Bool[Array, ""]
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
    that turn or twist the arm need not leave it any stable equilibrium; if it roams about to the
    end, the one at which it first bore the whole load is what there is.

    ``slowest_rate`` and ``fastest_rate`` (1/s2) bracket the squared rates at which the arm can
    leave an equilibrium. Returns the places (m; the first two as in ``start``, and those of the
    obstacles), in space the frames there, and the outcome of the last solve, with all iterations
    counted. The places, spins with them, are differentiable as the solution of the balance; the
    frames are to be carried on from there.
    """
    tip = forces.nodes(start).shape[0] - 1
    along = jnp.linspace(0.0, 1.0, tip - 1)[1:, None]
    edges = jnp.diff(start[1 : tip + 1, : forces.axes], axis=0)
    reach = jnp.sum(jnp.sqrt(jnp.sum(edges**2, axis=1)))

    def unfinished(carry: tuple[_Search, Outcome]) -> Bool[Array, ""]:
        search, outcome = carry
        solves = jnp.where(search.borne, _MAX_SOLVES + _LAST_SOLVES, _MAX_SOLVES)
        return ~outcome.converged & (search.solves < solves)

    def advance(carry: tuple[_Search, Outcome]) -> tuple[_Search, Outcome]:
        search, _ = carry
        load_factor = jnp.where(
            search.loaded, 1.0, jnp.minimum(1.0, search.load_factor + search.share)
        )
        shift = jnp.where(search.loaded & ~search.settled, search.shift, 0.0)
        stage = still(time, search.position, search.frames, shift)
        none = jnp.zeros_like(start)
        # the water is expanded anew around the place that each solve starts from
        around = forces.surroundings(stage, none)
        correction, outcome = solve(forces, around, stage, none, settings, load_factor)
        good = outcome.converged
        position = jnp.where(good, search.position + correction, search.position)
        share = jnp.where(good, 2.0, 0.5) * search.share
        loaded = search.loaded | (good & (load_factor >= 1.0)) | (share < _SMALLEST_SHARE)
        frames = search.frames
        if frames is not None:
            nodes = forces.nodes(position)
            frames = Frames.of(nodes, frames.at(nodes))
        kick = _KICK * reach * along**2 * _aside(position[tip] - position[1], reach, forces.axes)
        moved = jnp.max(jnp.abs(correction[:, : forces.axes]))
        first = search.moved < 0
        leaving = (moved > _LEAVING * search.moved) & (moved > _STILL * reach)
        kept = good & (first | leaving)
        next_shift = jnp.where(kept, 1.0, jnp.where(good, _SHIFT_FALL, 4.0)) * search.shift
        iterations = search.iterations + outcome.iterations
        bears = loaded & ~search.loaded
        borne = search.borne | (bears & good & (load_factor >= 1.0))
        balanced = _choose(search.loaded, search.balanced, (position, frames))
        # frames are those of before the kick: they follow the arm from there
        kicked = position.at[3 : tip + 1].add(jnp.where(bears, kick, 0.0))
        # one that no longer gets anywhere is stuck, and there is an equilibrium out of its reach
        roams = good & (moved > _KICK * reach) & ~search.settled
        resigns = search.borne & roams & (search.solves >= _MAX_SOLVES)
        position, frames = _choose(resigns, balanced, (kicked, frames))
        next_shift = jnp.where(resigns, 0.0, next_shift)
        return _Search(
            position,
            frames,
            balanced,
            borne,
            jnp.where(good, load_factor, search.load_factor),
            share,
            loaded,
            jnp.where(search.loaded, next_shift, search.shift),
            jnp.where(search.loaded & kept, moved, -1.0),
            resigns | (search.loaded & good & (next_shift < slowest_rate)),
            search.solves + 1,
            iterations,
        ), eqx.tree_at(
            # only the last solve, of the bare balance, decides: one that had nothing to mend, in
            # the water as it is where the arm has come to lie
            lambda o: (o.converged, o.iterations),
            outcome,
            (good & search.settled & (outcome.iterations == 0), iterations),
        )

    no, nothing, none = jnp.asarray(False), jnp.asarray(0), jnp.zeros(())
    search, outcome = jax.lax.while_loop(
        unfinished,
        advance,
        (
            _Search(
                start,
                frames,
                (start, frames),
                no,
                none,
                none + _FIRST_SHARE,
                no,
                fastest_rate,
                none - 1,
                no,
                nothing,
                nothing,
            ),
            Outcome.of_nothing(converged=False),
        ),
    )
    return search.position, search.frames, outcome


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
    correction = implied(
        (forces, around, stage, full), (t_forces, t_around, t_stage, None), jnp.zeros_like(start)
    )
    t_frames = jax.tree.map(jnp.zeros_like, frames)
    return (position, frames, outcome), (correction + held, t_frames, constant(outcome))


def _choose(first: Bool[Array, ""], one: Any, other: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(first, a, b), one, other)


def _aside(chord: Float[Array, " b"], reach: Float[Array, ""], axes: int) -> Float[Array, " b"]:
    """Return a direction across a chord: in the plane the one up from it, in space a bit of y too.

    So the arm finds its way out of a plane in which it does not stay, and in the plane it goes to
    the same side as a planar arm. Of an arm that closes on itself the chord is taken as forward.
    """
    up = axes - 1
    length = jnp.sqrt(jnp.sum(chord[:axes] ** 2))
    closed = length < 1e-6 * reach
    forward = jnp.zeros_like(chord).at[0].set(1.0)
    chord = jnp.where(closed, forward, chord / jnp.where(closed, 1.0, length))
    across = jnp.zeros_like(chord).at[0].set(-chord[up]).at[up].set(chord[0])
    if axes == 3:
        aside = jnp.zeros(3).at[1].set(1.0) - chord[1] * chord[:3]
        along_y = jnp.zeros(3).at[0].set(chord[1] ** 8)
        across = across.at[:3].add(0.3 * aside + along_y)
    return across / jnp.sqrt(jnp.sum(across**2))
