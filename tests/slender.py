"""Arms as good as inextensible, and where they come to rest.

The exact shapes are those of inextensible rods. The arms here resist stretch with EA = 1e7 EI/L^2,
so that loads of 10 EI/L^2 stretch them by 1e-6: below what the tests ask for, and still far enough
from the round-off of the stretching forces, EA/l times 2e-16 = 1e-7 EI/L^2 on the finest mesh.
"""

import equinox as eqx
import jax.numpy as jnp

from crinoid.dynamics import State, System
from crinoid.elements import DistributedLoad, TipLoad
from crinoid.flow import Uniform
from physics import always, arm

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
        "floor": FLOOR,
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
