"""The arm of a scenario as a flex rod of MuJoCo, to be timed and compared with crinoid.

MuJoCo's rods bend and twist but do not stretch: their edges keep their length by soft constraints.
The water is left out but for its buoyancy, which reduces gravity. Damping is Rayleigh's, with the
arm's damping time. Implicit elasticity of a rod asks for the integrator "discrete".
"""

import mujoco
import numpy as np

from crinoid import Scenario
from rest_shape import rest_shape


def rod(
    scenario: Scenario,
    time_step: float,
    *,
    planar: bool = False,
    stiff: bool = True,
    centred: bool = False,
) -> mujoco.MjModel:
    """Declare a rod that leaves its clamp along x, with as many vertices as the arm has nodes.

    Its first two vertices are pinned.

    Parameters
    ----------
    scenario
        Whose arm, water density and gravity to take.
    time_step
        In s.
    planar
        Two degrees of freedom for each vertex, instead of three and a twist for each edge. The
        arm's x and z are then MuJoCo's x and y.
    stiff
        Ask for edges that hardly stretch; with the default constraint the rod grows longer the
        more vertices it has.
    centred
        Shift the vertices so that the clamp, half an edge behind the second of them, is at the
        origin and the tip at the arm's length, and give the tip half of a vertex's mass and each
        edge the polar inertia of its own length.
    """
    arm, water = scenario.arm, scenario.water
    radius = arm.radius
    gravity = water.gravity * (1 - water.density / arm.density)
    edge = arm.length / (arm.nodes - (1.5 if centred else 1))
    places, _ = rest_shape(arm, edge)
    if centred:
        places -= [edge / 2, 0.0, 0.0]
    if planar:
        places = places[:, [0, 2, 1]]
    mass = arm.density * np.pi * radius**2 * edge
    hard = 'solref="0.004 1" solimp="0.999 0.9999 0.001"' if stiff else ""
    points = " ".join(repr(x) for x in places.ravel().tolist())
    shear = arm.youngs_modulus / (2 * (1 + arm.poisson_ratio))
    edges = " ".join(f"{i} {i + 1}" for i in range(arm.nodes - 1))
    model = mujoco.MjModel.from_xml_string(
        f"""
        <mujoco>
          <option integrator="discrete" timestep="{time_step}"
                  gravity="{f"0 {-gravity} 0" if planar else f"0 0 {-gravity}"}">
            <flag contact="disable"/>
          </option>
          <worldbody>
            <body name="base">
              <flexcomp name="rod" type="direct" dim="1" dof="{"2d" if planar else "full"}"
                        radius="{radius}" mass="{mass * arm.nodes}"
                        point="{points}" element="{edges}">
                <edge equality="true" {hard}/>
                <elasticity young="{arm.youngs_modulus}" shear="{shear}"
                            damping="{arm.damping_time}"/>
                <contact selfcollide="none" contype="0" conaffinity="0"/>
                <pin id="0 1"/>
              </flexcomp>
            </body>
          </worldbody>
        </mujoco>"""
    )
    if centred:
        model.body(f"rod_{arm.nodes - 1}").mass *= 0.5
        # MuJoCo shares the mass of all vertices among the edges, of which there is one less
        twisting = [i for i in range(model.nbody) if "twist" in model.body(i).name]
        model.body_inertia[twisting] *= 1 - 1 / arm.nodes
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def run(model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> None:
    """Let the rod swing from rest, all steps in one call of the C library."""
    mujoco.mj_resetData(model, data)
    mujoco.mj_step(model, data, steps)


def tips(model: mujoco.MjModel, data: mujoco.MjData, samples: int, steps: int) -> np.ndarray:
    """Let the rod swing from rest; return its tip after each ``steps``, ``(samples, 3)`` in m.

    Where MuJoCo warns, what is left of them is not a number.
    """
    mujoco.mj_resetData(model, data)
    body = model.body(f"rod_{model.nflexvert - 1}")
    moved = slice(start := model.jnt_qposadr[body.jntadr[0]], start + body.jntnum[0])
    places = np.full((samples, 3), np.nan)
    for place in places:
        mujoco.mj_step(model, data, steps)
        if warnings(data):
            break
        # not the vertices, which MuJoCo finds at the beginning of a step
        place[:] = body.pos
        place[: body.jntnum[0]] += data.qpos[moved]
    return places


def warnings(data: mujoco.MjData) -> int:
    """Return how many steps since the start MuJoCo warned about."""
    return sum(warning.number for warning in data.warning)


# it reports through `warnings` instead of a line on the screen each and a log file
mujoco.set_mju_user_warning(lambda _: None)
