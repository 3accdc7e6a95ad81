"""The numbers of a scenario by name, and what gradients and batches by them are."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.parameters import keulegan_carpenter
from crinoid.dynamics.start import undeformed
from crinoid.dynamics.statics import static_stage
from helpers.arms import QUICKLY, acting

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
    "arm": PLANE["arm"] | {"dimension": 3, "rest_curvature": [0.5, 1.0, 2.0]},
    "flow": [{"kind": "uniform", "velocity": [0.3, 0.1, 0.1]}],
    "load": [{"kind": "tip", "force": [0.1, 0.0, 0.2]}],
    **TABLES,
}


def test_parameters_say_their_numbers_with_units_also_within_a_trace():
    parameters = crinoid.parameters(crinoid.Scenario(**PLANE))
    told = {line.split()[0]: line for line in str(parameters).splitlines()}
    assert told["Parameters"].startswith("Parameters of an arm in the plane of 5 nodes: ")
    assert "length 0.5 m, radius [0.02, 0.015] m, density 1080 kg/m3, " in told["arm"]
    assert told["arm"].endswith(" more")
    assert told["flow[0]"].endswith("uniform_velocity [0.3, 0.1]")
    assert "time_step 0.01 s" in told["simulation"]
    assert "<td>length 0.5 m, " in parameters._repr_html_()
    traced = []
    jax.eval_shape(lambda p: traced.append(str(p)), parameters)
    assert "length (" in traced[0]


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
    forces, now = acting(system), jnp.zeros(())
    rows, frames = undeformed(system.reference, system.base, forces, now)
    bent = rows + 0.01 * jnp.sin(jnp.arange(rows.size)).reshape(rows.shape)
    stage, none = static_stage(now, bent, frames), jnp.zeros_like(rows)
    residual, _ = forces.residual(forces.motion(stage, none, forces.surroundings(stage, none)))
    return jnp.sum(residual * jnp.cos(jnp.arange(rows.size)).reshape(rows.shape))


def scaled(parameters, factors):
    """Multiply each of `NAMES`: both ends of a taper, all components of a velocity."""
    for where, factor in zip(NAMES.values(), factors, strict=True):
        parameters = eqx.tree_at(where, parameters, factor * where(parameters))
    return parameters


def test_added_mass_of_the_literature_follows_the_swings_of_the_water():
    # KC = U T / d: of a sine, and of a wave on deep water a w e^(k z) T / d = 2 pi a e^(k z) / d
    sine = {"kind": "sine", "amplitude": [0.06, 0.08], "frequency_hz": 0.25}
    wave = {"kind": "regular-wave", "height": 0.3, "period": 3.0}
    water = {"coefficients": "literature"}
    base = {"position": [0.0, -1.0]}
    number = (2 * np.pi / 3.0) ** 2 / 9.81
    swing = {"sine": 0.1 * 4.0, "wave": 2 * np.pi * 0.15 * np.exp(-number)}
    for flow, wanted in (([sine], swing["sine"]), ([sine, wave], swing["wave"]), ([], 0.0)):
        scenario = crinoid.Scenario(arm={"radius": 0.04}, water=water, base=base, flow=flow)
        found = keulegan_carpenter(scenario, crinoid.parameters(scenario).flow)
        assert found == pytest.approx(wanted / 0.08, rel=1e-9)
        mass = float(crinoid.parameters(scenario).water.added_mass_normal)
        assert mass == pytest.approx(max(0.6, 1 - 0.044 * max(0.0, found - 3)), rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("document", "function", "slope"),
    # backward through an equilibrium, and forward, which compiles faster, in space
    [(PLANE, height, jax.grad), (SPACE, push, jax.jacfwd)],
    ids=["equilibrium in the plane", "forces in space"],
)
def test_slopes_are_those_of_central_differences(document, function, slope):
    parameters = crinoid.parameters(crinoid.Scenario.from_dict(document))

    def of(factors):
        return function(scaled(parameters, factors))

    both = eqx.filter_jit(lambda x: (of(x), slope(of)(x)), compiler_options=QUICKLY)
    given = jnp.ones(len(NAMES))
    found = both(given)[1]
    assert np.all(np.abs(found) > 1e-5)  # each is felt
    for which, name in enumerate(NAMES):
        up, down = (both(given.at[which].add(sign * H))[0] for sign in (1, -1))
        np.testing.assert_allclose(found[which], (up - down) / (2 * H), rtol=1e-6, err_msg=name)


def test_a_batch_over_the_modulus_equals_single_runs():
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
