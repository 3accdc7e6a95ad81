"""The algebra of a chain against the same algebra on dense matrices."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid import chain

# Every remainder of 4, which the solve fills up to (pairs of nodes, an even number of them); twice
# over for the blocks of a planar arm.
CASES = [(n, 2) for n in range(3, 10)] + [(n, b) for b in (1, 4) for n in range(3, 7)]


def random_bands(rng, n, b):
    """Make a band that is dominated by its diagonal but far from symmetric.

    The entries that point outside the chain are filled too: they must be ignored.
    """
    bands = rng.uniform(-1.0, 1.0, (n, 5, b, b)) / (5 * b)
    bands[:, 2] += np.eye(b) * rng.choice([-1.5, 1.5], (n, 1, 1))
    assert np.abs(bands[0, :2]).min() > 0
    return bands


def dense(bands):
    """Write the bands out as a matrix, one entry after the other."""
    n, _, b, _ = bands.shape
    matrix = np.zeros((n, b, n, b))
    for i in range(n):
        for d in range(5):
            if 0 <= i + d - 2 < n:
                matrix[i, :, i + d - 2] = bands[i, d]
    return matrix.reshape(n * b, n * b)


# fifteen shapes to compile, each to run a few times: little optimisation is the quickest
@partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
def algebra(bands, rhs, bands_dot, rhs_dot, cotangent):
    """Do everything that a chain can, for one shape, in one compilation."""
    solution, linear = jax.linearize(chain.solve, bands, rhs)
    bands_bar, rhs_bar = jax.linear_transpose(linear, bands, rhs)(cotangent)
    return {
        "matvec": chain.matvec(bands, rhs),
        "transposed": chain.matvec(chain.transpose(bands), rhs),
        "solution": solution,
        "solution_dot": linear(bands_dot, rhs_dot),
        "bands_bar": bands_bar,
        "rhs_bar": rhs_bar,
    }


def solve(bands, rhs):
    """Solve through the compilation that the case of this shape needs anyway."""
    nothing = jnp.zeros_like(rhs)
    return algebra(bands, rhs, jnp.zeros_like(bands), nothing, nothing)["solution"]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: "n{}-b{}".format(*case))
def case(request):
    n, b = request.param
    rng = np.random.default_rng(100 * n + b)
    inputs = {
        "bands": random_bands(rng, n, b),
        "rhs": rng.normal(size=(n, b)),
        "bands_dot": rng.normal(size=(n, 5, b, b)),
        "rhs_dot": rng.normal(size=(n, b)),
        "cotangent": rng.normal(size=(n, b)),
    }
    outputs = algebra(*map(jnp.asarray, inputs.values()))
    return inputs, {key: np.asarray(value) for key, value in outputs.items()}


def close(actual, expected):
    # the matrices have condition numbers below 100: round-off stays far below this
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_products_are_those_of_the_dense_matrix(case):
    given, got = case
    matrix = dense(given["bands"])
    assert np.linalg.cond(matrix) < 100
    close(got["matvec"].ravel(), matrix @ given["rhs"].ravel())
    close(got["transposed"].ravel(), matrix.T @ given["rhs"].ravel())


def test_solutions_are_those_of_the_dense_matrix(case):
    given, got = case
    matrix = dense(given["bands"])
    close(got["solution"].ravel(), np.linalg.solve(matrix, given["rhs"].ravel()))


def test_transpose_is_solved_by_its_own_bands():
    rng = np.random.default_rng(7)
    bands, rhs = jnp.asarray(random_bands(rng, 6, 2)), jnp.asarray(rng.normal(size=(6, 2)))
    solution = solve(chain.transpose(bands), rhs)
    close(np.ravel(solution), np.linalg.solve(dense(np.asarray(bands)).T, np.ravel(rhs)))


def test_solution_is_derived_in_forward_mode(case):
    # A x = b: A dx = db - dA x
    given, got = case
    matrix, x = dense(given["bands"]), got["solution"].ravel()
    change = given["rhs_dot"].ravel() - dense(given["bands_dot"]) @ x
    expected = np.linalg.solve(matrix, change)
    close(got["solution_dot"].ravel(), expected)


def test_solution_is_derived_in_reverse_mode(case):
    # of y . x with A x = b: to b A^-T y, to A minus (A^-T y) x^T, to what is ignored nothing
    given, got = case
    n, b = given["rhs"].shape
    adjoint = np.linalg.solve(dense(given["bands"]).T, given["cotangent"].ravel())
    close(got["rhs_bar"].ravel(), adjoint)
    outer = -np.einsum("ni,mj->nimj", adjoint.reshape(n, b), got["solution"])
    expected = np.zeros((n, 5, b, b))
    for i in range(n):
        for d in range(5):
            if 0 <= i + d - 2 < n:
                expected[i, d] = outer[i, :, i + d - 2]
    close(got["bands_bar"], expected)


def test_derivatives_are_those_of_finite_differences(case):
    given, got = case
    bands, rhs = given["bands"], given["rhs"]
    h = 1e-5

    def moved(step):
        matrix = dense(bands + step * given["bands_dot"])
        return np.linalg.solve(matrix, (rhs + step * given["rhs_dot"]).ravel())

    # truncation of order h^2 = 1e-10, round-off 1e-16 / h = 1e-11, times what the solve amplifies
    difference = (moved(h) - moved(-h)) / (2 * h)
    scale = np.abs(difference).max()
    np.testing.assert_allclose(got["solution_dot"].ravel(), difference, rtol=0, atol=1e-7 * scale)
    # both modes give the same directional derivative
    forward = np.sum(given["cotangent"] * got["solution_dot"])
    reverse = np.sum(got["bands_bar"] * given["bands_dot"]) + np.sum(
        got["rhs_bar"] * given["rhs_dot"]
    )
    np.testing.assert_allclose(reverse, forward, rtol=1e-10)


def test_solve_batches():
    rng = np.random.default_rng(2)
    bands = np.stack([random_bands(rng, 5, 2) for _ in range(3)])
    rhs = rng.normal(size=(3, 4, 5, 2))
    # three matrices, and four right-hand sides for each
    batched = jax.jit(jax.vmap(jax.vmap(chain.solve, (None, 0))))
    together = batched(jnp.asarray(bands), jnp.asarray(rhs))
    for matrix, known, solution in zip(bands, rhs, np.asarray(together), strict=True):
        expected = np.linalg.solve(dense(matrix), known.reshape(4, 10).T).T
        close(solution.reshape(4, 10), expected)


def test_a_singular_matrix_is_not_solved_silently():
    bands = np.zeros((6, 5, 2, 2))
    bands[:, 2] = np.eye(2)
    bands[2, 2, 0, 0] = 0.0
    solution = solve(jnp.asarray(bands), jnp.ones((6, 2)))
    assert not np.isfinite(solution).all()


@pytest.mark.parametrize("stencil", [1, 2, 3])
@pytest.mark.parametrize("first", [0, 1, 2])
def test_windows_are_runs_of_neighbours(first, stencil):
    rng = np.random.default_rng(4)
    nodes = rng.normal(size=(7, 2))
    count = 7 - first - stencil + 1
    windows = chain.gather(jnp.asarray(nodes), first, count, stencil)
    assert windows.shape == (count, stencil, 2)
    for i in range(count):
        np.testing.assert_array_equal(windows[i], nodes[first + i : first + i + stencil])


@pytest.mark.parametrize("stencil", [1, 2, 3])
@pytest.mark.parametrize(("first", "count"), [(0, 3), (1, 4), (2, 1)])
def test_scatter_is_the_transpose_of_gather(first, count, stencil):
    rng = np.random.default_rng(5)
    nodes = jnp.asarray(rng.normal(size=(7, 2)))
    windows = jnp.asarray(rng.normal(size=(count, stencil, 2)))
    gathered = chain.gather(nodes, first, count, stencil)
    scattered = chain.scatter(windows, first, 7)
    np.testing.assert_allclose(
        np.sum(gathered * windows), np.sum(nodes * scattered), rtol=1e-14, atol=1e-14
    )


def test_blocks_of_all_stencils_add_up():
    rng = np.random.default_rng(6)
    n, b = 6, 2
    placed = [(0, 3), (1, 2), (3, 1), (4, 2), (1, 3)]
    counts = [4, 3, 2, 1, 2]
    blocks = [
        (first, rng.normal(size=(count, k, b, k, b)))
        for (first, k), count in zip(placed, counts, strict=True)
    ]
    expected = np.zeros((n, b, n, b))
    for first, block in blocks:
        for i, window in enumerate(block):
            k = window.shape[0]
            expected[first + i : first + i + k, :, first + i : first + i + k] += window
    bands = chain.assemble([(first, jnp.asarray(block)) for first, block in blocks], n)
    np.testing.assert_allclose(
        dense(np.asarray(bands)), expected.reshape(n * b, n * b), rtol=0, atol=1e-14
    )


def test_a_window_too_wide_is_refused():
    with pytest.raises(ValueError, match="at most 3 nodes, got 4"):
        chain.assemble([(0, jnp.zeros((2, 4, 2, 4, 2)))], 6)
