"""The arm of a release as a flex rod of MuJoCo."""

import mujoco
import numpy as np

from crinoid.benchmarks.peers import Engine, Swing, Tips, clocked
from crinoid.benchmarks.releases import IN_SPACE, IN_THE_PLANE, Release, shape_at_rest


def _rod(release: Release, nodes: int, time_step: float) -> mujoco.MjModel:
    """Declare a rod that is clamped in the right place and hardly stretches.

    In the plane a vertex has two coordinates, and x and z of the arm are x and y of MuJoCo. The
    implicit elasticity of a rod asks for the integrator "discrete".
    """
    scenario = release.scenario(nodes, time_step)
    arm, planar = scenario.arm, scenario.arm.dimension == 2
    edge = arm.length / (nodes - 1.5)
    places, _ = shape_at_rest(arm, edge)
    if planar:
        places = places[:, [0, 2, 1]]
    fall = f"0 {-scenario.water.gravity} 0" if planar else f"0 0 {-scenario.water.gravity}"
    mass = arm.density * np.pi * np.square(arm.radius) * edge * nodes
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
                        radius="{arm.radius}" mass="{mass}"
                        point="{" ".join(map(repr, places.ravel().tolist()))}"
                        element="{" ".join(f"{i} {i + 1}" for i in range(nodes - 1))}">
                <edge equality="true" solref="0.004 1" solimp="0.999 0.9999 0.001"/>
                <elasticity young="{arm.youngs_modulus}" shear="{shear}" damping="0"/>
                <contact selfcollide="none" contype="0" conaffinity="0"/>
                <pin id="0 1"/>
              </flexcomp>
            </body>
          </worldbody>
        </mujoco>"""
    )
    model.body(f"rod_{nodes - 1}").mass *= 0.5  # the tip has half an edge
    # MuJoCo shares the mass of all vertices among the edges, of which there is one less
    twisting = [i for i in range(model.nbody) if "twist" in model.body(i).name]
    model.body_inertia[twisting] *= 1 - 1 / nodes
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _prepare(release: Release, nodes: int, time_step: float) -> Swing:
    model = _rod(release, nodes, time_step)
    data, body = mujoco.MjData(model), model.body(f"rod_{nodes - 1}")
    count, steps = int(body.jntnum[0]), release.steps(time_step)
    moved = slice(start := model.jnt_qposadr[body.jntadr[0]], start + count)

    def swing() -> Tips:
        mujoco.mj_resetData(model, data)
        tips = np.full((release.samples, count), np.nan)
        for tip in tips:
            mujoco.mj_step(model, data, steps)
            if any(warning.number for warning in data.warning):
                break
            # not the vertices, which MuJoCo finds at the beginning of a step
            tip[:] = body.pos[:count] + data.qpos[moved]
        return tips

    return clocked(swing)


mujoco.set_mju_user_warning(lambda _: None)  # a warning counts in `data.warning`

ENGINE = Engine(
    f"MuJoCo {mujoco.__version__}",
    (IN_THE_PLANE.name, IN_SPACE.name),
    "water; its edges keep their length by soft constraints, and its time integration damps",
    order=1,
    meshes=(11, 21, 41, 81),
    steps=(0.01, 0.000125),
    prepare=_prepare,
)
