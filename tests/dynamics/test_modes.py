"""Small vibrations: natural frequencies and mode shapes against solutions on paper."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.linalg import eigh

from crinoid.dynamics import ModesError, State, System, find_modes
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.flow import Uniform
from helpers.arms import QUICKLY, always, arm, dense
from helpers.motion import natural_frequencies


@eqx.filter_jit(compiler_options=QUICKLY)
def _rest(system: System) -> State:
    return system.rest()


def frequencies(system: System) -> np.ndarray:
    """Return circular frequencies about the shape without load (rad/s)."""
    return 2 * np.pi * natural_frequencies(system, _rest(system))


@eqx.filter_jit(compiler_options=QUICKLY)
def loaded(system: System) -> tuple[tuple[Array, Array], Array]:
    state, outcome = system.find_equilibrium()
    return system.linearise(state), outcome.converged


def matrix(bands: Array) -> np.ndarray:
    """Write out the rows and columns of the free nodes."""
    free = dense(bands[BOUNDARY_NODES:])
    size = free.shape[0] * free.shape[1]
    return free.reshape(size, size)


@pytest.mark.slow
def test_a_stiff_arm_that_hangs_from_a_pin_swings_as_a_physical_pendulum():
    # omega^2 = m g (L / 2) / J with J = m L^2 / 3 on any mesh; its weight makes the arm longer,
    # which lowers omega by a share of 7/24 m g / EA
    pendulum = np.sqrt(9.81 * 0.5 * 3.0) / (2 * np.pi) * (1 - 7 / 24 * 9.81 / 1e7)
    hanging, converged = loaded(arm(EI=1e5, EA=1e7, pinned=True, gravity=9.81, tilt=-np.pi / 2))
    assert converged
    # it is not quite stiff: a share of 6e-3 / EI
    assert find_modes(*hanging).frequency[0] == pytest.approx(pendulum, rel=1e-7)


def test_matrices_that_are_no_numbers_have_no_modes():
    bands = jnp.full((5, 5, 2, 2), jnp.nan)
    with pytest.raises(ModesError, match="no natural frequencies found"):
        find_modes(bands, bands)


def test_an_arm_that_turns_freely_has_a_mode_of_no_frequency():
    frequency = frequencies(arm(pinned=True))
    assert frequency[0] == 0.0
    # the first bending mode on a pin: beta L = 3.9266023 (Blevins 1979, table 8-1)
    assert frequency[1] == pytest.approx(3.9266023**2, rel=6e-4)


def test_a_thrust_lowers_the_first_frequency_to_nothing_at_the_buckling_load():
    def squared(share: float) -> float:
        thrust = share * np.pi**2 / 4  # of Euler's load, EI = L = 1
        system = arm(nodes=21)
        state = _rest(system)
        squeezed = eqx.tree_at(
            lambda s: s.motion.position, state, state.position * (1.0 - thrust / 1e4)
        )
        return float((2 * np.pi * natural_frequencies(system, squeezed)[0]) ** 2)

    free = squared(0.0)
    # nearly a straight line between both ends
    assert squared(0.5) / free == pytest.approx(0.5, abs=0.03)
    assert squared(0.98) / free == pytest.approx(0.02, abs=0.005)
    assert squared(1.1) == 0.0


@pytest.mark.release
def test_modes_of_a_bent_arm_are_those_of_the_dense_matrices():
    bent = arm(
        EA=1e3,
        mass_per_length=0.9,
        displaced_area=8e-4,
        water_density=1000.0,
        added_mass_tangential=0.2,
        gravity=9.81,
        diameter=0.03,
        flows=(Uniform(always(), jnp.array([0.3, 0.5])),),
    )
    (stiffness, mass), converged = loaded(bent)
    assert converged
    frequency, shapes = find_modes(stiffness, mass, 19)  # of 20
    K, M = matrix(stiffness), matrix(mass)
    assert np.abs(K - K.T).max() > 1e-4 * np.abs(K).max()  # the drag is not conservative
    expected, vectors = eigh(0.5 * (K + K.T), M)
    np.testing.assert_allclose((2 * np.pi * frequency) ** 2, expected[:19], rtol=1e-9)
    assert np.abs(shapes[:, 0]).max() == 0.0
    assert np.abs(shapes).max(axis=(1, 2)) == pytest.approx(1.0)
    # eigh's vectors are orthonormal in the mass: shape by shape one of them, but for its length
    overlap = np.abs(vectors.T @ M @ shapes[:, 1:].reshape(19, -1).T)
    np.testing.assert_allclose(overlap / overlap.max(axis=0), np.eye(20, 19), atol=1e-6)


@pytest.mark.slow
def test_a_round_arm_in_space_bends_both_ways_at_each_frequency():
    system = arm(axes=3, nodes=6, GJ=1.0, radius=0.02, tilt=0.3, pan=0.4, roll=0.2)
    stiffness, mass = eqx.filter_jit(System.linearise, compiler_options=QUICKLY)(
        system, _rest(system)
    )
    frequency, shapes = find_modes(stiffness, mass, 6)
    np.testing.assert_allclose(frequency[1::2], frequency[::2], rtol=1e-9)
    flat = shapes[:, 1:].reshape(6, -1)
    products = flat @ matrix(mass) @ flat.T
    size = np.sqrt(np.diag(products))
    np.testing.assert_allclose(products / np.outer(size, size), np.eye(6), atol=1e-9)


@pytest.mark.release
def test_the_lopsided_part_of_drag_hardly_moves_a_frequency():
    # half the current has a quarter of the drag; leaving that part out errs in second order of it
    def error(speed: float) -> float:
        current = (Uniform(always(), jnp.array([0.0, speed])),)
        (stiffness, mass), converged = loaded(
            arm(EA=1e3, water_density=1000.0, displaced_area=8e-4, diameter=0.03, flows=current)
        )
        assert converged
        general = np.linalg.eigvals(np.linalg.solve(matrix(mass), matrix(stiffness)))
        slowest = general[np.argmin(np.abs(general))]
        assert slowest.imag == 0.0
        return (2 * np.pi * find_modes(stiffness, mass).frequency[0]) ** 2 / slowest.real - 1.0

    strong, weak = abs(error(0.3)), abs(error(0.15))
    assert 1e-6 < strong < 1e-2
    assert strong > 16.0 * weak
