"""The quadratic program of a receding horizon: against an exact solver, and its limits."""

from typing import NamedTuple

import daqp
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from crinoid.control.braking import Braking
from crinoid.control.qp import HorizonQp

EVEN = np.ones(20)
BLOCKS = np.array([1.0] * 6 + [2.0] * 5 + [4.0] * 5 + [8.0] * 4)
DRAWS = 100


class Problem(NamedTuple):
    """A plant with one or two oscillations, followed over the horizon by two inputs."""

    hessian: np.ndarray
    gradient: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    last: np.ndarray
    moving: np.ndarray


def problem(seed: int, lengths: np.ndarray) -> Problem:
    """Draw one: from hardly any limit active to nearly all; Hessians of conditions up to 1e6."""
    draw = np.random.default_rng(seed)
    periods, modes, outputs, inputs = int(lengths.sum()), int(draw.integers(1, 3)), 2, 2
    poles = draw.uniform(0.7, 0.99, modes) * np.exp(1j * draw.uniform(0.05, 1.0, modes))
    drive, see = draw.normal(size=(2, modes, 2)) + 1j * draw.normal(size=(2, modes, 2))
    reached = (1 - poles ** np.arange(1, periods + 1)[:, None]) / (1 - poles)
    steps = np.einsum("km,mo,mi->koi", reached, see, drive).real
    late = np.subtract.outer(np.arange(periods), np.arange(periods))
    one_period = np.moveaxis(steps[late] * (late >= 0)[..., None, None], 1, 3)
    block = np.repeat(np.eye(lengths.size), lengths.astype(int), axis=0)
    response = (one_period @ block).reshape(periods * outputs, -1)
    weight = np.tile(10 ** draw.uniform(-1, 1, outputs), periods)
    squares = response.T @ (weight[:, None] * response)
    count = inputs * lengths.size
    hessian = squares + 10 ** draw.uniform(-4, 0) * np.trace(squares) / count * np.eye(count)
    error = draw.normal(size=(periods, outputs)).cumsum(axis=0) * draw.uniform(0.1, 1)
    gradient = -response.T @ (weight * (error + 3 * draw.normal(size=outputs)).ravel())
    free = np.linalg.solve(hessian, -gradient).reshape(inputs, -1)
    rate = np.abs(free).max(axis=1) * 10 ** draw.uniform(-1.3, 0.3, inputs)
    acceleration = rate * 10 ** draw.uniform(-1, 0.3, inputs)
    limit = np.abs((free * lengths).cumsum(axis=1)).max(axis=1) * 10 ** draw.uniform(-1, 0.3, 2)
    return Problem(
        hessian.reshape(inputs, lengths.size, inputs, lengths.size),
        gradient.reshape(inputs, -1),
        rate,
        acceleration,
        -limit,
        limit,
        draw.uniform(-0.9, 0.9, inputs) * limit,
        np.zeros(inputs),
    )


def built(one: Problem, lengths: np.ndarray) -> HorizonQp:
    limits = {"rate": one.rate, "acceleration": one.acceleration}
    return HorizonQp.of(one.hessian, lengths=lengths, **limits)


@jax.jit
def solve(qp, gradient, lower, upper, last, moving):
    return qp.solve(gradient, lower=lower, upper=upper, last=last, moving=moving)


solve_all = jax.jit(jax.vmap(lambda *given: solve(*given)))


def solve_each(problems: list[Problem], lengths: np.ndarray):
    qps = jax.tree.map(lambda *each: jnp.stack(each), *(built(one, lengths) for one in problems))
    given = [np.stack(each) for each in zip(*(one[1:2] + one[4:] for one in problems), strict=True)]
    return jax.tree.map(np.asarray, solve_all(qps, *given))


def fastest(room: float, rate: float, acceleration: float) -> float:
    """Return the largest move after which full braking, period by period, ends within a room."""

    def beyond(move: float) -> float:
        return sum(np.arange(move, 0.0, -acceleration)) - room

    return rate if beyond(rate) <= 0 else brentq(beyond, 0.0, rate, xtol=1e-15 * rate)


def exact(one: Problem, lengths: np.ndarray) -> tuple[np.ndarray, float, int]:
    """Return the moves by an active-set method, their cost, and how many limits are active."""
    inputs, moves = one.gradient.shape
    difference = np.eye(moves) - np.eye(moves, k=-1)
    change = 0.5 * (lengths + np.append(1.0, lengths[:-1]))
    rows, low, high = [], [], []
    for i, (rate, acceleration) in enumerate(zip(one.rate, one.acceleration, strict=True)):
        rooms = one.last[i] - one.lower[i], one.upper[i] - one.last[i]
        faster = np.full(moves - 1, rate)
        for matrix, (below, above) in (
            (np.tril(np.ones((moves, moves))) * lengths, [np.full(moves, room) for room in rooms]),
            (difference, [acceleration * change] * 2),
            (
                np.eye(moves),
                [np.append(fastest(room, rate, acceleration), faster) for room in rooms],
            ),
        ):
            rows.append(np.kron(np.eye(inputs)[i][None], matrix))
            low.append(-below)
            high.append(above)
    size = inputs * moves
    found, cost, flag, info = daqp.solve(
        one.hessian.reshape(size, size),
        one.gradient.ravel(),
        *map(np.concatenate, (rows, high, low)),
        primal_tol=1e-12,
        dual_tol=1e-12,
        eps_prox=0.0,
        iter_limit=10_000,
    )
    assert flag == 1
    active = np.sum(np.abs(info["lam"]) > 1e-9 * np.abs(info["lam"]).max())
    return found.reshape(inputs, moves), cost, active


def cost(one: Problem, moves: np.ndarray) -> float:
    return 0.5 * np.einsum("ik,ikjl,jl", moves, one.hessian, moves) + np.sum(one.gradient * moves)


@pytest.fixture(scope="module", params=[EVEN, BLOCKS], ids=["even", "blocks"])
def drawn(request):
    problems = [problem(seed, request.param) for seed in range(DRAWS)]
    return request.param, problems, solve_each(problems, request.param)


def test_the_solution_is_that_of_an_active_set_method_within_all_limits(drawn):
    lengths, problems, found = drawn
    assert found.optimal.all()
    most, between = [], 0.5 * (lengths + np.append(1.0, lengths[:-1]))
    for one, moves in zip(problems, found.moves, strict=True):
        best, least, active = exact(one, lengths)
        assert np.abs(moves - best).max() <= 1e-8 * np.abs(best).max()
        assert abs(cost(one, moves) - least) <= 1e-10 * abs(least)
        most.append(active / moves.size)
        values = one.last[:, None] + np.cumsum(moves * lengths, axis=1)
        change = np.diff(moves, axis=1, prepend=one.moving[:, None])
        assert np.all(np.abs(values) <= one.upper[:, None] * (1 + 1e-12))
        assert np.all(np.abs(moves) <= one.rate[:, None] * (1 + 1e-12))
        assert np.all(np.abs(change) <= one.acceleration[:, None] * between * (1 + 1e-9))
    # from few to as many active limits as there are unknowns, or more
    assert min(most) < 0.3
    assert max(most) >= 1.0


def test_one_alone_is_solved_as_among_others(drawn):
    lengths, problems, found = drawn
    for one, moves in zip(problems[:3], found.moves[:3], strict=True):
        alone = solve(built(one, lengths), *one[1:2], *one[4:])
        assert np.allclose(alone.moves, moves, rtol=0, atol=1e-9 * one.rate.max())


def test_units_of_inputs_do_not_matter():
    one, unit = problem(3, EVEN), np.array([1e5, 1e-4])
    other = Problem(
        one.hessian / unit[:, None, None, None] / unit[:, None],
        one.gradient / unit[:, None],
        *(each * unit for each in one[2:]),
    )
    found = solve_each([one, other], EVEN)
    assert found.optimal.all()
    assert np.allclose(found.moves[1] / unit[:, None], found.moves[0], rtol=1e-7, atol=1e-12)


def test_moves_come_within_the_limits_from_any_start():
    problems = []
    for seed in range(DRAWS):
        one, draw = problem(seed, EVEN), np.random.default_rng(seed)
        last = draw.uniform(-2, 2, 2) * one.upper
        problems.append(one._replace(last=last, moving=draw.uniform(-3, 3, 2) * one.rate))
    found = solve_each(problems, EVEN)
    assert np.isfinite(found.moves).all()
    for one, moves in zip(problems, found.moves, strict=True):
        values = one.last[:, None] + np.cumsum(moves, axis=1)
        assert np.all(np.abs(values) <= one.upper[:, None] * (1 + 1e-12))
        within_rate = np.abs(moves) <= one.rate[:, None] * (1 + 1e-12)
        assert within_rate[np.abs(one.last) <= one.upper].all()
        assert within_rate[:, 1:].all()
        # once it is inside and can stop it keeps to the limits of acceleration as well
        change = np.abs(np.diff(moves[:, 1:], axis=1))
        assert np.all(change <= one.acceleration[:, None] * (1 + 1e-9) + 1e-14)


def test_gradients_of_any_size_do_no_harm():
    one = problem(0, EVEN)
    sizes = [0.0, 1e-300, 1e-12, 1e12, 1e100, np.nan]
    problems = [one._replace(gradient=one.gradient * size) for size in sizes]
    problems.append(one._replace(upper=one.last, lower=one.last))  # no room at all
    found = solve_each(problems, EVEN)
    assert np.isfinite(found.moves).all()
    assert np.abs(found.moves[0]).max() <= 1e-12 * one.rate.max()
    assert not found.optimal[sizes.index(np.nan)]
    assert np.abs(found.moves[-1]).max() <= 1e-15


def test_a_horizon_that_is_too_short_to_stop_in_leads_into_no_limit():
    # pushed to and fro at random, with a horizon of 3 periods where to stop takes 10
    rate, acceleration, limit = np.array([1.0]), np.array([0.1]), jnp.array([7.3])
    hessian = np.eye(3)[None, :, None, :]
    qp = HorizonQp.of(hessian, rate=rate, acceleration=acceleration, lengths=np.ones(3))

    def once(carry, push):
        found = solve(qp, jnp.full((1, 3), push), -limit, limit, *carry)
        move = found.moves[:, 0]
        carry = carry[0] + move, move
        return carry, carry

    pushes = np.repeat(np.random.default_rng(1).choice([-10.0, 10.0], 20), 25)
    _, found = jax.lax.scan(once, (jnp.zeros(1), jnp.zeros(1)), pushes)
    values, moves = (np.asarray(each)[:, 0] for each in found)
    assert np.abs(values).max() <= limit[0] * (1 + 1e-12)
    assert np.abs(values).max() >= 0.999 * limit[0]
    assert np.abs(moves).max() <= 1.0 + 1e-12
    assert np.abs(np.diff(moves, prepend=0.0)).max() <= 0.1 * (1 + 1e-9)
    assert np.abs(moves).max() == pytest.approx(1.0)


def test_braking_stops_at_the_limit():
    braking = Braking.of(np.array([1.0]), np.array([0.25]), EVEN)
    within = eqx.filter_jit(braking.within)
    wanted = jnp.full((1, EVEN.size), 5.0)
    moves = np.asarray(within(wanted, jnp.array([-9.0]), jnp.array([6.0]), jnp.zeros(1)))[0]
    assert moves.sum() == pytest.approx(6.0)
    assert moves[:4] == pytest.approx([0.25, 0.5, 0.75, 1.0])
    assert np.diff(moves).min() >= -0.25 - 1e-12
