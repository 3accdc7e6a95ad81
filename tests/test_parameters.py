"""The numbers of a scenario by name, and what gradients and batches by them are."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.controller import build_controller
from crinoid.assembly.plan import Plan
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.sensor import build_sensors
from crinoid.assembly.target import build_target
from crinoid.control import Clock
from crinoid.dynamics.start import undeformed
from crinoid.dynamics.statics import still
from crinoid.simulation.loop import Loop
from crinoid.simulation.setup import with_parameters
from physics import QUICKLY

H = 1e-4
"""Step of the central differences, relative."""

# Newton's method ends at round-off
TABLES = {"base": {"tilt_deg": -30.0}, "simulation": {"tolerance": 1e-12}}
PLANE = {
    "arm": {"nodes": 5, "radius": [0.02, 0.015]},
    "flow": [{"kind": "uniform", "velocity": [0.3, 0.1]}],
    **TABLES,
}
SPACE = {
    "arm": {"nodes": 5, "radius": [0.02, 0.015], "dimension": 3, "rest_curvature": [0.5, 1.0, 2.0]},
    "flow": [{"kind": "uniform", "velocity": [0.3, 0.1, 0.1]}],
    "load": [{"kind": "tip", "force": [0.1, 0.0, 0.2]}],
    **TABLES,
}
NAMES = {
    "arm.youngs_modulus": lambda p: p.arm.youngs_modulus,
    "arm.radius": lambda p: p.arm.radius,
    "arm.density": lambda p: p.arm.density,
    "arm.length": lambda p: p.arm.length,
    "water.density": lambda p: p.water.density,
    "a current's speed": lambda p: p.flow[0].uniform_velocity,
}


def height(parameters):
    """Return how high the tip is in equilibrium (m)."""
    system = crinoid.assemble(parameters)
    return system.tip(system.find_equilibrium()[0])[system.forces.axes - 1]


def push(parameters):
    """Return the forces on an arm that is held away from where it is without load, summed (N)."""
    system = crinoid.assemble(parameters)
    forces, now = system.forces, jnp.zeros(())
    rows, frames = undeformed(system.reference, system.base, forces, now)
    bent = rows + 0.01 * jnp.sin(jnp.arange(rows.size)).reshape(rows.shape)
    stage, none = still(now, bent, frames), jnp.zeros_like(rows)
    residual, _ = forces.residual(forces.motion(stage, none, forces.surroundings(stage, none)))
    return jnp.sum(residual * jnp.cos(jnp.arange(rows.size)).reshape(rows.shape))


def scaled(parameters, factors):
    """Multiply each of `NAMES`: both ends of a taper, all components of a velocity."""
    for where, factor in zip(NAMES.values(), factors, strict=True):
        parameters = eqx.tree_at(where, parameters, factor * where(parameters))
    return parameters


@pytest.fixture(
    scope="module",
    # backward through an equilibrium, and forward, which compiles faster, in space
    params=[(PLANE, height, jax.grad), (SPACE, push, jax.jacfwd)],
    ids=["equilibrium in the plane", "forces in space"],
)
def studied(request):
    document, function, slope = request.param
    parameters = crinoid.parameters(crinoid.Scenario.from_dict(document))

    def of(factors):
        return function(scaled(parameters, factors))

    both = eqx.filter_jit(lambda x: (of(x), slope(of)(x)), compiler_options=QUICKLY)
    return both, both(jnp.ones(len(NAMES)))[1]


@pytest.mark.parametrize("name", NAMES)
def test_slopes_are_those_of_central_differences(studied, name):
    both, found = studied
    which = list(NAMES).index(name)
    up, down = (both(jnp.ones(len(NAMES)).at[which].add(sign * H))[0] for sign in (1, -1))
    assert abs(found[which]) > 1e-5  # it is felt
    np.testing.assert_allclose(found[which], (up - down) / (2 * H), rtol=1e-6)


def test_a_batch_over_the_modulus_is_what_each_is_alone():
    parameters = crinoid.parameters(crinoid.Scenario.from_dict(SPACE))
    moduli = parameters.arm.youngs_modulus * jnp.array([0.5, 1.0, 3.0])

    def of(modulus):
        return push(eqx.tree_at(lambda p: p.arm.youngs_modulus, parameters, modulus))

    together = eqx.filter_jit(jax.vmap(of), compiler_options=QUICKLY)(moduli)
    one = eqx.filter_jit(of, compiler_options=QUICKLY)
    np.testing.assert_allclose(together, [one(modulus) for modulus in moduli], rtol=1e-13)
    # what resists grows with the modulus, and water and weight do not
    stiffening = np.diff(together) / np.diff(moduli)
    np.testing.assert_allclose(stiffening, stiffening[0], rtol=1e-9)


def test_an_edit_of_a_system_is_never_without_effect():
    # what the arm is made of is held by the elements, once; beside them there is only its shape
    system = crinoid.system(crinoid.Scenario.from_dict(PLANE))
    of = eqx.filter_grad(lambda reference: jnp.sum(reference.rest_shape(0.1) ** 2))
    slopes = of(system.reference)
    assert np.all(slopes.rest_length != 0)
    assert np.any(slopes.rest_curvature != 0)
    assert set(vars(system.reference)) == {"rest_length", "rest_curvature", "rest_twist"}


def test_what_was_built_to_look_for_room_is_what_is_run(monkeypatch):
    ball = {"kind": "sphere", "position": [0.3, -9.5], "radius": 0.1}
    prepared = Prepared(crinoid.Scenario(arm={"nodes": 5}, obstacle=[ball]))
    prepared.check()
    found = prepared.system, prepared.room
    for part in ("system.assemble_once", "room.find_room"):
        monkeypatch.setattr(f"crinoid.assembly.{part}", None)  # nothing is done again
    prepared.check()
    assert prepared.system is found[0]
    assert prepared.room is found[1]
    np.testing.assert_allclose(prepared.room, [0.5 - 0.1 - 0.02], rtol=1e-4)


def test_how_often_a_step_may_be_halved_is_a_number_too():
    one, other = (
        crinoid.system(crinoid.Scenario(**PLANE).with_values({"simulation.max_halvings": number}))
        for number in (0, 12)
    )
    assert (one.max_halvings, other.max_halvings) == (0, 12)
    # so that they take the same compiled programs
    assert jax.tree.structure(one) == jax.tree.structure(other)


def test_gains_are_numbers_too():
    scenario = crinoid.Scenario(
        arm={"nodes": 5},
        base={"channels": {"slide": {}, "heave": {}}},
        control={"kind": "pid", "pid": {"slide": {"kp": 0.3, "ki": 0.2}, "heave": {"kd": 0.05}}},
    )
    prepared = Prepared(scenario)
    parameters, system = prepared.parameters, prepared.system
    np.testing.assert_array_equal(parameters.pid.kp, [0.3, 0.0])
    loop = Loop(
        system=system,
        sensors=build_sensors(scenario),
        controller=build_controller(Plan(scenario, parameters, system, system.rest(), jnp.eye(3))),
        clock=Clock(jnp.asarray(0.01)),
        switched_on=jnp.zeros(()),
        target=build_target(scenario, None, system, jnp.zeros(3)),
        feed_forward=None,
        enabled=jnp.asarray(True),
    )

    def command(parameters):
        pid = with_parameters(loop, parameters).controller
        state = system.rest()
        seen = loop.seen(state, loop.start(state).sensors, jnp.zeros(3))
        wanted = jnp.array([0.02, 0.03, 0.0])
        seen = replace(seen, measured=jnp.zeros(3), wanted=wanted)
        return jnp.sum(pid.command(pid.start(seen), seen)[0])

    found = eqx.filter_jit(eqx.filter_grad(command))(parameters).pid
    np.testing.assert_allclose(
        found.kp, (loop.controller.mapping @ jnp.array([0.02, 0.03, 0.0]))[:2], rtol=1e-12
    )
    assert found.kp[0] == pytest.approx(0.02)
