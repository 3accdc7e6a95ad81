"""Steps of Newton's method: their matrix by hand and by differentiation, and how they converge."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from crinoid.dynamics import ActingForces
from crinoid.dynamics.balance import Balance
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.start import clamped
from crinoid.dynamics.tangent_assembly import assemble_tangent
from helpers.arms import QUICKLY


def motion_of(forces, stage, correction):
    around = forces.surroundings(stage, jnp.zeros_like(stage.position))
    return forces.motion(stage, correction, around), around


@eqx.filter_jit(compiler_options=QUICKLY)
def slopes(forces, stage):
    """Return the tangent, and d(residual)/d(correction) by differentiating through the frames."""
    none = jnp.zeros_like(stage.position)
    motion, around = motion_of(forces, stage, none)

    def residual(correction):
        # the water is expanded from where it is looked up
        return forces.residual(forces.motion(stage, correction, around))[0]

    tangent = assemble_tangent(forces, stage, motion, around)
    return tangent.bands, tangent.of_lines, jax.jacfwd(residual)(none)


def factored(tangent, rhs):
    """Solve by the factors, as Newton's method does."""
    found, touching = tangent.factorise().solve(rhs), tangent.solve_touching(rhs)
    return found if touching is None else jnp.where(tangent.touches, touching, found)


@eqx.filter_jit(compiler_options=QUICKLY)
def improve(forces, stage, correction):
    """Return the correction after one step of Newton's method, in water expanded where none is."""
    motion, around = motion_of(forces, stage, correction)
    residual, _ = forces.residual(motion)
    return correction + Balance(forces, around, stage).tangent(motion).solve(-residual)


def assert_converges_quadratically(forces, stage, off, *, linear=False, least=1e-9):
    """Start Newton's method about its solution: of an error it leaves a share of the square.

    It starts an eighth, a sixteenth and a 32nd of ``off`` away. What is linear is solved at once;
    what is not leaves more than a ``least`` of the largest error.
    """
    solution = jnp.zeros_like(stage.position)
    for _ in range(15):
        solution = improve(forces, stage, solution)
    np.testing.assert_allclose(improve(forces, stage, solution), solution, atol=1e-13)
    steps = (improve(forces, stage, solution + off / part) for part in (8, 16, 32))
    left = [np.abs(step - solution).max() for step in steps]
    if linear:
        assert max(left) < 1e-13
        return
    # of half the error a quarter is left: nothing of first order
    assert left[0] > least
    np.testing.assert_allclose(np.log2(np.divide(left[:-1], left[1:])), 2.0, atol=0.2)
    # and so it goes on
    correction = solution + off / 4
    for _ in range(6):
        correction = improve(forces, stage, correction)
    assert np.abs(correction - solution).max() < 1e-13


@eqx.filter_jit(compiler_options=QUICKLY)
def solve_afloat(system, drive, noise, rhs):
    """Solve the equations of a step of an arm that floats, off its shape at rest.

    Return the solution, that by the factors, what the residual changes by along it, and what the
    rows of the held nodes make of it.
    """
    state = system.rest()
    context = replace(state.context, drive=drive, memory=())
    context = clamped(context, system.forces, system.base, state.time, state.servo)
    forces = ActingForces.of(system.forces, context)
    rates = map(jnp.asarray, (1.0, 30.0, 900.0))
    stage = StepMap(state.time, state.motion.position, *noise[:2], *rates, state.frames)
    around = forces.surroundings(stage, noise[2])

    def residual(correction):
        return forces.residual(forces.motion(stage, correction, around))[0]

    tangent = assemble_tangent(forces, stage, forces.motion(stage, noise[2], around), around)
    solved = tangent.solve(rhs)
    product = jax.jvp(residual, (noise[2],), (solved,))[1]
    return solved, factored(tangent, rhs), product, tangent.on_held(solved)
