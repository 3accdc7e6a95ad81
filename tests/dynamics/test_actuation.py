"""Actuators beside the base's servos: a jet at the tip, whose thrust follows with a lag."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.actuation import Actuator, Input
from crinoid.elements import WORKS, Element
from crinoid.foundation.axes import CHANNELS
from helpers.arms import QUICKLY, arm, order
from helpers.motion import march_with_books

pytestmark = pytest.mark.slow

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
        loads=[nozzle],
    )
    return eqx.tree_at(lambda s: s.actuators, system, (Jet(jnp.asarray(LAG)),))


def march(system, thrust, step, steps):
    command = jnp.zeros(len(system.inputs)).at[-1].set(thrust)
    return march_with_books(system, command, step, steps)


@pytest.fixture(scope="module")
def system():
    return jet_arm(3)


@pytest.fixture(scope="module")
def runs(system):
    # so large that errors of the step, not round-off, open the balance of energy
    return [march(system, 1e-2, 0.02 / n, 50 * n) for n in (1, 2, 4)]


def test_inputs_name_the_channels_and_then_the_actuators(system):
    names = [each.name for each in system.inputs]
    assert names == [*CHANNELS[system.forces.axes], "jet"]
    assert {each.name: each.unit for each in system.inputs}["tilt"] == "rad"
    np.testing.assert_allclose([system.inputs[-1].lower, system.inputs[-1].upper], [-1.0, 1.0])


def test_a_command_of_another_length_is_refused(system):
    state, more = system.rest(), len(system.inputs) + 1
    with pytest.raises(ValueError, match=rf"^command: got the shape \({more},\); must be "):
        system.step(state, jnp.zeros(more))


def test_the_drive_follows_its_command_and_bends_the_arm(system, runs):
    for state, _, converged in runs:
        assert converged
        np.testing.assert_allclose(state.actuators[0], 1e-2 * (1 - np.exp(-1.0 / LAG)), rtol=1e-9)
    # in the end as far as the same force would
    end, _, converged = march(system, 1e-3, 0.1, 100)
    assert converged
    rise = system.tip(end)[system.forces.axes - 1]
    np.testing.assert_allclose(rise, 1e-3 * LENGTH**3 / (3 * EI), rtol=5e-3)


def test_the_work_of_an_actuator_is_in_the_ledger(system, runs):
    defects = [abs(system.energy(state).sum() - books.work.sum()) for state, books, _ in runs]
    actuation = runs[-1][1].work[WORKS.index("actuation")]
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

        def step(state, _):
            return changed.step(state, command, jnp.asarray(0.02))

        state, _ = jax.lax.scan(step, changed.rest(), length=3)
        return state.position[-1, -1]

    slope = jax.jit(jax.value_and_grad(height), compiler_options=QUICKLY)
    ahead, behind = (slope(jnp.asarray(LAG + change))[0] for change in (1e-4, -1e-4))
    got = slope(jnp.asarray(LAG))[1]
    np.testing.assert_allclose(got, (ahead - behind) / 2e-4, rtol=1e-5)
