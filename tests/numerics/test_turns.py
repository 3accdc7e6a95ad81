"""Sine and cosine in turns, against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.flow.turbulence import cosine, cosine_and_sine

RANDOM = np.random.default_rng(0)
TURNS = np.concatenate(
    [
        np.linspace(-2.0, 2.0, 4001),  # all ends of ranges among them
        RANDOM.uniform(-1.0, 1.0, 100_000),
        RANDOM.uniform(-1e6, 1e6, 100_000),
        [0.25 - 2**-54, 0.25 + 2**-53, 0.5, -0.5, 0.75 - 2**-53, 1e12 + 0.25, 2.0**60],
    ]
)


def sine(turns):
    return cosine_and_sine(turns)[1]


@pytest.mark.parametrize(("wave", "known"), [(cosine, np.cos), (sine, np.sin)])
def test_waves_are_those_of_numpy(wave, known):
    # taking off whole turns is exact in NumPy too; NumPy's own error is 1e-16, that of 2 pi x 3e-16
    expected = known(2 * np.pi * (TURNS - np.round(TURNS)))
    assert np.abs(np.asarray(jax.jit(wave)(TURNS)) - expected).max() < 8e-16


@pytest.mark.parametrize(("wave", "known"), [(cosine, [1, 0, -1, 0]), (sine, [0, 1, 0, -1])])
def test_quarters_are_exact_to_the_last_digits(wave, known):
    quarters = jnp.arange(-8, 12) / 4
    np.testing.assert_allclose(wave(quarters), np.tile(known, 5), atol=1.2e-16)


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivatives_are_waves_again(mode):
    turn, wave, rate = 0.3 + 1e5, cosine, 2 * np.pi
    for order in range(4):  # each a quarter of a turn ahead of the one before
        value = rate**order * np.cos(rate * (turn - 1e5 + order / 4))
        np.testing.assert_allclose(wave(jnp.asarray(turn)), value, rtol=1e-12)
        wave = mode(wave)
