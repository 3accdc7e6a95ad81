"""The algebra of a chain against the same algebra on dense matrices."""

import itertools
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.numerics import banded, index_array
from helpers.arms import QUICKLY, dense

# every remainder of 4, which the solve fills up to (pairs of nodes, an even number of them)
NODES, SIZE = (3, 4, 6, 9), 3


def matrix_of(bands):
    return dense(bands).reshape((bands.shape[0] * bands.shape[2],) * 2)


def random_bands(rng, n, b):
    """Make a band that is dominated by its diagonal but far from symmetric.

    The entries that point outside the chain are filled too: they must be ignored.
    """
    bands = rng.uniform(-1.0, 1.0, (n, 5, b, b)) / (5 * b)
    bands[:, 2] += np.eye(b) * rng.choice([-1.5, 1.5], (n, 1, 1))
    assert np.abs(bands[0, :2]).min() > 0
    return bands


# a few shapes to compile, each to run once: little optimisation is the quickest
@partial(jax.jit, compiler_options=QUICKLY)
def algebra(bands, rhs, bands_dot, rhs_dot, cotangent):
    """Do everything that a chain can, for one shape, in one compilation."""
    solution, linear = jax.linearize(banded.solve, bands, rhs)
    bands_bar, rhs_bar = jax.linear_transpose(linear, bands, rhs)(cotangent)
    return {
        "matvec": banded.matvec(bands, rhs),
        "transposed": banded.matvec(banded.transpose(bands), rhs),
        "solution": solution,
        "solution_dot": linear(bands_dot, rhs_dot),
        "bands_bar": bands_bar,
        "rhs_bar": rhs_bar,
    }


@pytest.fixture(scope="module", params=NODES)
def case(request):
    n, b = request.param, SIZE
    rng = np.random.default_rng(100 * n + b)
    shapes = {"rhs": (n, b), "bands_dot": (n, 5, b, b), "rhs_dot": (n, b), "cotangent": (n, b)}
    given = {"bands": random_bands(rng, n, b)}
    given |= {name: rng.normal(size=shape) for name, shape in shapes.items()}
    return given, jax.tree.map(np.asarray, algebra(**given))


def close(actual, expected):
    # the matrices have condition numbers below 100: round-off stays far below this
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_solutions_are_those_of_the_dense_matrix(case):
    given, got = case
    matrix, rhs = matrix_of(given["bands"]), given["rhs"].ravel()
    assert np.linalg.cond(matrix) < 100
    close(got["solution"].ravel(), np.linalg.solve(matrix, rhs))
    # and so are products
    close(got["matvec"].ravel(), matrix @ rhs)
    close(got["transposed"].ravel(), matrix.T @ rhs)


def test_solution_is_derived_in_forward_mode(case):
    # A x = b: A dx = db - dA x
    given, got = case
    matrix, x = matrix_of(given["bands"]), got["solution"].ravel()
    change = given["rhs_dot"].ravel() - matrix_of(given["bands_dot"]) @ x
    expected = np.linalg.solve(matrix, change)
    close(got["solution_dot"].ravel(), expected)


def test_solution_is_derived_in_reverse_mode(case):
    # of y . x with A x = b: to b A^-T y, to A minus (A^-T y) x^T, to what is ignored nothing
    given, got = case
    n, b = given["rhs"].shape
    adjoint = np.linalg.solve(matrix_of(given["bands"]).T, given["cotangent"].ravel())
    close(got["rhs_bar"].ravel(), adjoint)
    outer = -np.einsum("ni,mj->nimj", adjoint.reshape(n, b), got["solution"])
    expected = np.zeros((n, 5, b, b))
    for i in range(n):
        for d in range(max(0, 2 - i), min(5, n + 2 - i)):
            expected[i, d] = outer[i, :, i + d - 2]
    close(got["bands_bar"], expected)


def test_solve_batches():
    rng = np.random.default_rng(2)
    bands = np.stack([random_bands(rng, 5, 2) for _ in range(3)])
    rhs = rng.normal(size=(3, 4, 5, 2))
    # three matrices, and four right-hand sides for each
    batched = jax.jit(jax.vmap(jax.vmap(banded.solve, (None, 0))))
    together = batched(jnp.asarray(bands), jnp.asarray(rhs))
    for matrix, known, solution in zip(bands, rhs, np.asarray(together), strict=True):
        expected = np.linalg.solve(matrix_of(matrix), known.reshape(4, 10).T).T
        close(solution.reshape(4, 10), expected)


def test_a_singular_matrix_is_not_solved_silently():
    bands = np.zeros((6, 5, 2, 2))
    bands[:, 2] = np.eye(2)
    bands[2, 2, 0, 0] = 0.0
    assert not np.isfinite(jax.jit(banded.solve)(bands, jnp.ones((6, 2)))).all()


@pytest.mark.parametrize("stencil", [1, 2, 3])
@pytest.mark.parametrize(("first", "count"), [(0, 3), (0, None), (1, 4), (1, None), (2, 1)])
def test_windows_are_runs_of_neighbours(first, count, stencil):
    count = 8 - first - stencil if count is None else count  # up to the tip
    rng = np.random.default_rng(4)
    nodes, weights = rng.normal(size=(7, 2)), rng.normal(size=(count, stencil, 2))
    index = first + np.arange(count)[:, None] + np.arange(stencil)
    windows = np.asarray(index_array.gather(jnp.asarray(nodes), index))
    assert windows.shape == (count, stencil, 2)
    for i in range(count):
        np.testing.assert_array_equal(windows[i], nodes[first + i : first + i + stencil])
    # and scattering is the transpose of gathering
    scattered = index_array.scatter(jnp.asarray(weights), index, 7)
    expected = np.sum(windows * weights)
    np.testing.assert_allclose(np.sum(nodes * scattered), expected, rtol=1e-14, atol=1e-14)


EDGES = np.array([1, 2, 3, 4, 4])
INDICES = {
    "neighbours": np.array([[2, 3], [3, 4]]),
    "pieces": np.array([[1, 6], [2, 0], [5, 1]]),
    "many pieces": np.array([[6, 0], [2, 2], [5, 4], [1, 6], [3, 3], [6, 1]]),
    "grid": np.stack(np.broadcast_arrays(EDGES, EDGES + 1, np.array([[6], [0], [3]])), axis=-1),
}


@pytest.mark.parametrize("traced", [False, True])
@pytest.mark.parametrize("name", INDICES)
def test_windows_of_any_rows(name, traced):
    index, rng = INDICES[name], np.random.default_rng(8)
    if traced and index.ndim > 2:
        pytest.skip("a grid is known when a program is made")
    at = jnp.asarray(index) if traced else index
    rows, flat = rng.normal(size=(7, 2)), index.reshape(-1, index.shape[-1])
    np.testing.assert_array_equal(index_array.gather(jnp.asarray(rows), at), rows[flat])
    windows, expected = rng.normal(size=(*flat.shape, 2)), np.zeros((7, 2))
    np.add.at(expected, flat, windows)
    found = index_array.scatter(jnp.asarray(windows), at, 7)
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("name", INDICES)
def test_blocks_of_any_rows(name):
    index, rng = INDICES[name], np.random.default_rng(9)
    flat = index.reshape(-1, index.shape[-1])
    # a part of a window by another part: by the edges, by the bodies, and by both
    for rows, columns in ((slice(1), slice(-1, None)), (slice(-1, None),) * 2, (slice(1),) * 2):
        at, by = flat[:, rows], flat[:, columns]
        blocks = rng.normal(size=(len(flat), at.shape[1], 2, by.shape[1], 2))
        expected = np.zeros((7, 2, 7, 2))
        for block, own, other in zip(blocks, at, by, strict=True):
            for (i, row), (j, column) in itertools.product(enumerate(own), enumerate(other)):
                expected[row, :, column] += block[i, :, j]
        parts = index[..., rows], index[..., columns]
        found = index_array.scatter_blocks(jnp.asarray(blocks), *parts, (7, 7))
        np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-14)


def test_blocks_of_all_stencils_add_up():
    rng = np.random.default_rng(6)
    n, b = 6, 2
    placed = [(0, 3, 4), (1, 2, 3), (3, 1, 2), (4, 2, 1), (1, 3, 2)]
    blocks = [(first, rng.normal(size=(count, k, b, k, b))) for first, k, count in placed]
    expected = np.zeros((n, b, n, b))
    for first, block in blocks:
        for i, window in enumerate(block):
            k = window.shape[0]
            expected[first + i : first + i + k, :, first + i : first + i + k] += window
    bands = banded.assemble([(first, jnp.asarray(block)) for first, block in blocks], n, b)
    np.testing.assert_allclose(dense(bands), expected, rtol=0, atol=1e-14)


def test_a_window_too_wide_is_refused():
    with pytest.raises(ValueError, match="at most 3 nodes, got 4"):
        banded.assemble([(0, jnp.zeros((2, 4, 2, 4, 2)))], 6, 2)
