"""An arm without water as a flex rod of MuJoCo."""

import mujoco
import numpy as np

from crinoid.scenario import Scenario
from validation.peers.swing import Swing, Tips, clocked, radius_of, rod_at_rest


def _rod(scenario: Scenario, time_step: float) -> mujoco.MjModel:
    """Declare a rod that is clamped in the right place and hardly stretches.

    In the plane a vertex has two coordinates, and x and z of the arm are x and y of MuJoCo. The
    implicit elasticity of a rod asks for the integrator "discrete".
    """
    arm, planar, radius = scenario.arm, scenario.arm.dimension == 2, radius_of(scenario)
    edge, places, _ = rod_at_rest(scenario)
    if planar:
        places = places[:, [0, 2, 1]]
    fall = f"0 {-scenario.water.gravity} 0" if planar else f"0 0 {-scenario.water.gravity}"
    mass = arm.density * np.pi * radius**2 * edge * arm.nodes
    shear = arm.youngs_modulus / (2 * (1 + arm.poisson_ratio))
    model = mujoco.MjModel.from_xml_string(
        f"""
        <mujoco>
          <option integrator="discrete" timestep="{time_step}" gravity="{fall}">
            <flag contact="disable"/>
          </option>
          <worldbody>
            <body name="base">
              <flexcomp name="rod" type="direct" dim="1" dof="{"2d" if planar else "full"}"
                        radius="{radius}" mass="{mass}"
                        point="{" ".join(map(repr, places.ravel().tolist()))}"
                        element="{" ".join(f"{i} {i + 1}" for i in range(arm.nodes - 1))}">
                <edge equality="true" solref="0.004 1" solimp="0.999 0.9999 0.001"/>
                <elasticity young="{arm.youngs_modulus}" shear="{shear}" damping="0"/>
                <contact selfcollide="none" contype="0" conaffinity="0"/>
                <pin id="0 1"/>
              </flexcomp>
            </body>
          </worldbody>
        </mujoco>"""
    )
    model.body(f"rod_{arm.nodes - 1}").mass *= 0.5  # the tip has half an edge
    # MuJoCo shares the mass of all vertices among the edges, of which there is one less
    twisting = [i for i in range(model.nbody) if "twist" in model.body(i).name]
    model.body_inertia[twisting] *= 1 - 1 / arm.nodes
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def prepare(scenario: Scenario, time_step: float, interval: float, samples: int) -> Swing:
    """Return a run; a warning of MuJoCo ends it."""
    model = _rod(scenario, time_step)
    data, body = mujoco.MjData(model), model.body(f"rod_{scenario.arm.nodes - 1}")
    count, steps = int(body.jntnum[0]), round(interval / time_step)
    moved = slice(start := model.jnt_qposadr[body.jntadr[0]], start + count)

    def swing() -> Tips:
        mujoco.mj_resetData(model, data)
        tips = np.full((samples, count), np.nan)
        for tip in tips:
            mujoco.mj_step(model, data, steps)
            if any(warning.number for warning in data.warning):
                break
            # not the vertices, which MuJoCo finds at the beginning of a step
            tip[:] = body.pos[:count] + data.qpos[moved]
        return tips

    return clocked(swing)


mujoco.set_mju_user_warning(lambda _: None)  # a warning counts in `data.warning`
