"""Actuators beside the base's servos: a jet at the tip, whose thrust follows with a lag."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.actuation import Actuator, Input
from crinoid.dynamics import Books
from crinoid.elements import WORKS, Element
from crinoid.space import CHANNELS
from physics import arm, order

LENGTH, EI, LAG = 0.5, 0.02, 0.3


class Jet(Actuator):
    """A thrust (N) that follows its command to first order."""

    lag: jax.Array

    @property
    def inputs(self):
        return (Input("jet", "N", "share", jnp.asarray(-1.0), jnp.asarray(1.0)),)

    def at_rest(self):
        return jnp.zeros(1)

    def advance(self, state, command, step):
        return command + (state - command) * jnp.exp(-step / self.lag)

    def drive(self, state):
        return state


class Nozzle(Element):
    """Where the jet acts: upward on the tip."""

    stencil: ClassVar[int] = 1
    worked: ClassVar[str] = "actuation"
    first: int = eqx.field(static=True)
    upward: jax.Array

    def residual(self, motion):
        return -motion.drive[0] * self.upward[None]


def jet_arm(axes, nodes=6):
    def nozzle(rod):
        return Nozzle(nodes, jnp.eye(axes)[-1:])

    system = arm(
        axes=axes,
        nodes=nodes,
        length=LENGTH,
        EI=EI,
        EA=1e3,
        mass_per_length=0.4,
        damping_time=0.3,
        water_density=0.0,
        gravity=0.0,
        loads=[nozzle],
    )
    return eqx.tree_at(lambda s: s.actuators, system, (Jet(jnp.asarray(LAG)),))


@eqx.filter_jit
def march(system, thrust, step, steps):
    """Return tip, drive, stored energies and works at the end, and whether all steps converged."""
    command = jnp.zeros(len(system.inputs)).at[-1].set(thrust)
    state = system.rest()

    def tick(_, carry):
        *before, converged = carry
        state, books, progress = system.advance_with_books(*before, command, step)
        return state, books, converged & progress.outcome.converged

    start = (state, Books.of(system.forces, state), jnp.asarray(True))
    state, books, converged = jax.lax.fori_loop(0, steps, tick, start)
    return system.tip(state), state.actuators[0], system.energy(state), books.work, converged


@pytest.fixture(scope="module", params=[2, 3])
def system(request):
    return jet_arm(request.param)


@pytest.fixture(scope="module")
def runs(system):
    return [march(system, 1e-3, jnp.asarray(0.02 / n), jnp.asarray(50 * n)) for n in (1, 2, 4)]


def test_inputs_name_the_channels_and_then_the_actuators(system):
    names = [each.name for each in system.inputs]
    assert names == [*CHANNELS[system.forces.axes], "jet"]
    assert {each.name: each.unit for each in system.inputs}["tilt"] == "rad"
    np.testing.assert_allclose([system.inputs[-1].lower, system.inputs[-1].upper], [-1.0, 1.0])


def test_the_drive_follows_its_command_with_its_own_lag(runs):
    for _, drive, _, _, converged in runs:
        assert converged
        np.testing.assert_allclose(drive, 1e-3 * (1 - np.exp(-1.0 / LAG)), rtol=1e-9)


def test_the_arm_ends_where_the_same_force_would_bend_it(system):
    tip, _, _, _, converged = march(system, 1e-3, jnp.asarray(0.1), jnp.asarray(100))
    assert converged
    rise = tip[system.forces.axes - 1]
    np.testing.assert_allclose(rise, 1e-3 * LENGTH**3 / (3 * EI), rtol=5e-3)


def test_the_work_of_an_actuator_is_in_the_ledger(runs):
    defects = [abs(stored.sum() - works.sum()) for _, _, stored, works, _ in runs]
    actuation = runs[-1][3][WORKS.index("actuation")]
    assert actuation > 0
    assert defects[0] < 1e-2 * actuation
    assert (order(defects) > 1.8).all()


def test_equilibrium_is_that_of_actuators_at_rest(system):
    state, outcome = eqx.filter_jit(system.find_equilibrium)()
    assert outcome.converged
    np.testing.assert_allclose(system.tip(state)[0], LENGTH, rtol=1e-9)


def test_gradients_reach_the_numbers_of_an_actuator(system):
    def height(lag):
        changed = eqx.tree_at(lambda s: s.actuators[0].lag, system, lag)
        command = jnp.zeros(len(system.inputs)).at[-1].set(1e-3)
        state = changed.rest()
        for _ in range(3):
            state, _ = changed.step(state, command, jnp.asarray(0.02))
        return state.position[-1, -1]

    slope = jax.jit(jax.grad(height))(jnp.asarray(LAG))
    both = jax.jit(jax.vmap(height))(jnp.array([LAG + 1e-4, LAG - 1e-4]))
    np.testing.assert_allclose(slope, (both[0] - both[1]) / 2e-4, rtol=1e-5)
