"""The quadratic program of a receding horizon: against an exact solver, and its limits."""

from typing import NamedTuple

import daqp
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

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


def problem(seed: int, lengths: np.ndarray, *, inputs: int = 2) -> Problem:
    """Draw one: from hardly any limit active to nearly all; Hessians of conditions up to 1e6."""
    draw = np.random.default_rng(seed)
    periods, size, outputs = int(lengths.sum()), 2 * int(draw.integers(1, 3)), 2
    turn, shrink = draw.uniform(0.05, 1.0, size // 2), draw.uniform(0.7, 0.99, size // 2)
    move = np.zeros((size, size))
    for k, (angle, radius) in enumerate(zip(turn, shrink, strict=True)):
        c, s = np.cos(angle), np.sin(angle)
        move[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = radius * np.array([[c, -s], [s, c]])
    drive, see = draw.normal(size=(size, inputs)), draw.normal(size=(outputs, size))
    state, steps = np.zeros((size, inputs)), []
    for _ in range(periods):
        state = move @ state + drive
        steps.append(see @ state)
    one_period = np.zeros((periods, outputs, inputs, periods))
    for k in range(periods):
        for j in range(k + 1):
            one_period[k, :, :, j] = steps[k - j]
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


def way_to_stop(move: float, acceleration: float) -> float:
    """Return how far an input goes with a move and full braking after it."""
    way = 0.0
    while move > 0:
        way, move = way + move, move - acceleration
    return way


def exact(one: Problem, lengths: np.ndarray) -> tuple[np.ndarray, float, int]:
    """Return the moves by an active-set method, their cost, and how many limits are active."""
    inputs, moves = one.gradient.shape
    difference = np.eye(moves) - np.eye(moves, k=-1)
    change = 0.5 * (lengths + np.append(1.0, lengths[:-1]))
    rows, low, high = [], [], []
    for i in range(inputs):
        unit = np.eye(inputs)[i][None]
        rows += [np.kron(unit, np.tril(np.ones((moves, moves))) * lengths)]
        low += [np.full(moves, one.lower[i] - one.last[i])]
        high += [np.full(moves, one.upper[i] - one.last[i])]
        rows += [np.kron(unit, difference)]
        low += [-one.acceleration[i] * change]
        high += [one.acceleration[i] * change]
        # the first move is one that can be stopped after, period by period
        fast = []
        for room in (one.last[i] - one.lower[i], one.upper[i] - one.last[i]):
            tried, step = 0.0, one.rate[i]
            while step > 1e-14 * one.rate[i]:
                fits = way_to_stop(tried + step, one.acceleration[i]) <= room
                tried, step = (tried + step, step) if fits else (tried, step / 2)
                tried = min(tried, one.rate[i])
                step = step if tried < one.rate[i] else 0.0
            fast.append(tried)
        rows += [np.kron(unit, np.eye(moves))]
        low += [-np.append(fast[0], np.full(moves - 1, one.rate[i]))]
        high += [np.append(fast[1], np.full(moves - 1, one.rate[i]))]
    size = inputs * moves
    found, cost, flag, info = daqp.solve(
        one.hessian.reshape(size, size),
        one.gradient.ravel(),
        np.concatenate(rows),
        np.concatenate(high),
        np.concatenate(low),
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


def test_the_solution_is_that_of_an_active_set_method(drawn):
    lengths, problems, found = drawn
    assert found.optimal.all()
    most = []
    for one, moves in zip(problems, found.moves, strict=True):
        best, least, active = exact(one, lengths)
        assert np.abs(moves - best).max() <= 1e-8 * np.abs(best).max()
        assert abs(cost(one, moves) - least) <= 1e-10 * abs(least)
        most.append(active / moves.size)
    # from few to as many active limits as there are unknowns, or more
    assert min(most) < 0.3
    assert max(most) >= 1.0


def test_the_solution_keeps_to_all_limits(drawn):
    lengths, problems, found = drawn
    for one, moves in zip(problems, found.moves, strict=True):
        values = one.last[:, None] + np.cumsum(moves * lengths, axis=1)
        change = np.diff(moves, axis=1, prepend=one.moving[:, None])
        between = 0.5 * (lengths + np.append(1.0, lengths[:-1]))
        assert np.all(np.abs(values) <= one.upper[:, None] * (1 + 1e-12))
        assert np.all(np.abs(moves) <= one.rate[:, None] * (1 + 1e-12))
        assert np.all(np.abs(change) <= one.acceleration[:, None] * between * (1 + 1e-9))


def test_one_alone_is_solved_as_among_others(drawn):
    lengths, problems, found = drawn
    for index in range(3):
        one = problems[index]
        alone = solve(built(one, lengths), *one[1:2], *one[4:])
        assert np.allclose(alone.moves, found.moves[index], rtol=0, atol=1e-9 * one.rate.max())


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


def test_from_wherever_it_starts_it_comes_within_the_limits():
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
        began_inside = np.abs(one.last) <= one.upper
        within_rate = np.abs(moves) <= one.rate[:, None] * (1 + 1e-12)
        assert within_rate[began_inside].all()
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


SHORT = np.ones(3)


def test_a_horizon_that_is_too_short_to_stop_in_leads_into_no_limit():
    # pushed to and fro at random, with a horizon of 3 periods where to stop takes 10
    rate, acceleration, limit = np.array([1.0]), np.array([0.1]), 7.3
    qp = HorizonQp.of(
        np.eye(3)[None, :, None, :], rate=rate, acceleration=acceleration, lengths=SHORT
    )
    draw = np.random.default_rng(1)
    pushes = np.repeat(draw.choice([-1.0, 1.0], 20), 25)

    @jax.jit
    def run(pushes):
        def once(carry, push):
            last, moving = carry
            sides = -limit * jnp.ones(1), limit * jnp.ones(1)
            found = qp.solve(
                jnp.full((1, 3), push), lower=sides[0], upper=sides[1], last=last, moving=moving
            )
            move = found.moves[:, 0]
            return (last + move, move), (last + move, move)

        return jax.lax.scan(once, (jnp.zeros(1), jnp.zeros(1)), pushes)[1]

    values, moves = (np.asarray(each)[:, 0] for each in run(10.0 * pushes))
    assert np.abs(values).max() <= limit * (1 + 1e-12)
    assert np.abs(values).max() >= 0.999 * limit
    assert np.abs(moves).max() <= 1.0 + 1e-12
    assert np.abs(np.diff(moves, prepend=0.0)).max() <= 0.1 * (1 + 1e-9)
    assert np.abs(moves).max() == pytest.approx(1.0)


def test_braking_stops_at_the_limit():
    braking = Braking.of(np.array([1.0]), np.array([0.25]), EVEN)
    wanted = jnp.full((1, EVEN.size), 5.0)
    within = eqx.filter_jit(braking.within)
    moves = np.asarray(within(wanted, jnp.array([-9.0]), jnp.array([6.0]), jnp.zeros(1)))[0]
    assert moves.sum() == pytest.approx(6.0)
    assert moves[:4] == pytest.approx([0.25, 0.5, 0.75, 1.0])
    assert np.diff(moves).min() >= -0.25 - 1e-12
