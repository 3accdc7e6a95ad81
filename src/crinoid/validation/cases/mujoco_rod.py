"""A heavy arm that falls from level, and MuJoCo's flexible rod."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.cases.falling_arm import (
    DENSITY,
    LENGTH,
    MODULUS,
    RADIUS,
    STIFFER,
    hardly_stretching,
    simulated_tips,
)
from crinoid.view.figures.style import BLUE, VERMILLION, key

_TIMES = (0.2, 0.3, 0.4, 0.5)
_VERTICES, _TIME_STEP = (21, 41), 1e-4
_MODEL = """
<mujoco>
  <option integrator="discrete" timestep="{step}" gravity="0 -9.81 0">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <body name="base">
      <flexcomp name="rod" type="direct" dim="1" dof="2d" radius="{radius}" mass="{mass}"
                point="{points}" element="{edges}">
        <edge equality="true" solref="0.004 1" solimp="0.999 0.9999 0.001"/>
        <elasticity young="{young}" shear="{young}" damping="0"/>
        <contact selfcollide="none" contype="0" conaffinity="0"/>
        <pin id="0 1"/>
      </flexcomp>
    </body>
  </worldbody>
</mujoco>
"""
"""x and z of the arm are x and y of MuJoCo."""


def _fallen(vertices: int) -> Float[np.ndarray, "time axis"]:
    """Return the tip (m) of MuJoCo's rod at the times; the middle of its first edge is the clamp.

    Raises
    ------
    RuntimeError
        If MuJoCo warns.
    """
    import mujoco

    edge = LENGTH / (vertices - 1.5)
    points = " ".join(f"{edge * (number - 0.5)} 0 0" for number in range(vertices))
    model = mujoco.MjModel.from_xml_string(
        _MODEL.format(
            step=_TIME_STEP,
            radius=RADIUS,
            mass=DENSITY * np.pi * RADIUS**2 * edge * vertices,
            points=points,
            edges=" ".join(f"{number} {number + 1}" for number in range(vertices - 1)),
            young=MODULUS,
        )
    )
    tip = model.body(f"rod_{vertices - 1}")
    tip.mass *= 0.5  # of half an edge
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    first, steps, tips = int(model.jnt_qposadr[tip.jntadr[0]]), 0, []
    for when in _TIMES:
        more = round(when / _TIME_STEP) - steps
        mujoco.mj_step(model, data, more)
        steps += more
        if any(warning.number for warning in data.warning):
            raise RuntimeError(f"MuJoCo warns before {when:g} s")
        tips.append(tip.pos[:2] + data.qpos[first : first + 2])
    return np.array(tips)


def _run() -> Evidence:
    scenario = hardly_stretching()
    path = simulated_tips(scenario)
    coarse, fine = (_fallen(vertices) for vertices in _VERTICES)
    theirs = fine + (fine - coarse) / 3
    checks = []
    for when, expected, found in zip(_TIMES, theirs, map(path.at, _TIMES), strict=True):
        text = f"{when:g} s"
        checks += [
            Check(f"x of the tip, {text}", expected[0], found[0], 1e-3, "m"),
            Check(f"z of the tip, {text}", expected[1], found[1], 1e-3, "m"),
        ]

    def draw(axes: Axes) -> None:
        axes.plot(*path.tips.T, color=BLUE, label="crinoid")
        axes.plot(*theirs.T, "o", mfc="none", color=VERMILLION, label="MuJoCo")
        axes.set(xlabel="x of the tip (m)", ylabel="z of the tip (m)", aspect="equal")
        key(axes)

    return Evidence(checks, None, {"": scenario}, draw)


CASE = Case(
    name="mujoco-rod",
    title="A heavy arm that hardly stretches falls from level, as in MuJoCo.",
    source="MuJoCo 4.0.0, run in the case: a rod by flexcomp, integrator discrete.",
    method=f"41 nodes, time step 1 ms, undamped, EA {STIFFER:g} times that of the material: the "
    "edges of MuJoCo keep their length by soft constraints. MuJoCo by steps of "
    f"{_TIME_STEP:g} s, extrapolated from {_VERTICES[0]} and {_VERTICES[1]} vertices with order 2.",
    reason="The step of the extrapolation: a third of MuJoCo's change between the meshes, 1 mm at "
    "0.5 s.",
    kind="peer",
    run=_run,
    needs=("mujoco",),
)
