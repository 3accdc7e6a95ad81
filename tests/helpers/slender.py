"""Arms as good as inextensible, and where they come to rest.

The exact shapes are those of inextensible rods. The arms here resist stretch with EA = 1e7 EI/L^2,
so that loads of 10 EI/L^2 stretch them by 1e-6: below what the tests ask for, and still far enough
from the round-off of the stretching forces, EA/l times 2e-16 = 1e-7 EI/L^2 on the finest mesh.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from crinoid.dynamics import State, System
from crinoid.elements import DistributedLoad, TipLoad
from crinoid.flow import Uniform
from helpers.arms import always, arm, order
from helpers.elastica import CRITICAL, UPRIGHT
from validation.elastica import elastica

MESHES = (11, 21, 41)
EA = 1e7
FLOOR = 2e-7
"""A few times the round-off of the stretching forces (N)."""

find = eqx.filter_jit(System.find_equilibrium)
energy = eqx.filter_jit(System.energy)
tip_pose = eqx.filter_jit(System.tip)


def equilibrium(system: System) -> State:
    """Return an arm in equilibrium, which must be found."""
    state, outcome = find(system, jnp.zeros(()))
    assert outcome.converged
    return state


def loaded(
    nodes,
    *,
    axes=2,
    dead=None,
    follower=None,
    moment=None,
    follower_moment=None,
    tangential=0.0,
    normal=0.0,
    fixed=None,
    current=None,
    **changes,
):
    """Build an arm of unit length and stiffness; always of the same elements, compiled once.

    The density and diameter of water and arm make the drag of a broadside current |u| u per
    length.
    """
    settings = {
        "EA": EA,
        "GJ": 2 / 3,
        "water_density": 1.0,
        "diameter": 2.0,
        "drag_normal": 1.0,
        "drag_tangential": 0.0,
    }

    def spread(rod):
        vector = None if fixed is None else jnp.asarray(fixed)
        return DistributedLoad.of(rod, tangential=tangential, normal=normal, fixed=vector)

    def on_tip(rod):
        loads = {
            "dead_force": dead,
            "follower_force": follower,
            "moment": moment,
            "follower_moment": follower_moment,
        }
        given = {name: jnp.asarray(load) for name, load in loads.items() if load is not None}
        return TipLoad.of(rod, **given)

    velocity = jnp.zeros(axes) if current is None else jnp.asarray(current, float)
    return arm(
        axes=axes,
        nodes=nodes,
        loads=(spread, on_tip),
        flows=(Uniform(always(), velocity),),
        **settings | changes,
    )


def column(nodes, kind, load, **case):
    """Return an upright column that bears a load, and the heights of its nodes while straight.

    The load is on its tip or its own weight.
    """
    axes = case.get("axes", 2)
    forces = {"dead": (0.0,) * (axes - 1) + (-load,)} if kind == "tip" else {"gravity": load}
    above = 1 - (np.arange(nodes - 1) + 0.5) / (nodes - 1)
    carried = load * (np.ones(nodes - 1) if kind == "tip" else above)
    heights = np.cumsum((1 - carried / EA) / (nodes - 1))
    return loaded(nodes, tilt=UPRIGHT, **forces, **case), heights


def leaning(kind, load):
    """Return the exact shape of a column past its buckling load."""
    return elastica(
        (-UPRIGHT + 1e-3, UPRIGHT - 0.5),
        tilt=UPRIGHT,
        dead=(0.0, -load if kind == "tip" else 0.0),
        distributed=lambda _: (0.0, -load if kind == "own" else 0.0),
    )


def assert_buckling_converges(loads, kind):
    """Compare the buckling loads on all meshes with the exact one; return their errors."""
    loads, exact = np.array(loads), CRITICAL[kind]
    errors = abs(loads - exact)
    print(loads, "orders", order(errors))
    assert (abs(order(errors) - 2) < 0.1).all()
    np.testing.assert_allclose(loads[2] + (loads[2] - loads[1]) / 3, exact, rtol=2e-6)
    return errors
