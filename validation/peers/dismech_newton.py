"""An arm without water as a discrete elastic rod of DiSMech-Newton, on the CPU."""

import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation
from warp._src.codegen import Struct

# `Struct | None` in its annotations, which Warp 1.19 refuses where Python evaluates them
if "__or__" not in vars(Struct):
    Struct.__or__ = lambda struct, _: struct
import newton
from dismech_newton import DiSMechSolver

from crinoid.scenario import Scenario
from validation.peers.swing import Swing, Tips, clocked, radius_of, rod_at_rest

wp.config.quiet = True


def prepare(
    scenario: Scenario, time_step: float, interval: float, samples: int, iterations: int = 2
) -> Swing:
    """Return a run by the implicit midpoint rule, with so many Newton iterations a step.

    It does not test whether they converge: with fewer, long steps are wrong without a message.
    """
    arm = scenario.arm
    _, vertices, frames = rod_at_rest(scenario)
    # the third axis of its frames is the tangent
    turns = Rotation.from_matrix(frames[:, [1, 2, 0]].transpose(0, 2, 1)).as_quat()
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -scenario.water.gravity))
    rod = newton.Rod(
        vertices,
        quaternions=turns,
        radius=radius_of(scenario),
        youngs_modulus=arm.youngs_modulus,
        shear_modulus=arm.youngs_modulus / (2 * (1 + arm.poisson_ratio)),
    )
    section = newton.ModelBuilder.ShapeConfig(density=arm.density)
    edges = DiSMechSolver.add_rod(builder, rod, cfg=section, collide=False, proxies=False)
    DiSMechSolver.fix_segment(builder, edge=edges[0])
    model = builder.finalize(device="cpu")
    solver = DiSMechSolver(model, iterations=iterations, exact=True, theta=0.5, self_contact=False)
    columns = [0, 2] if arm.dimension == 2 else [0, 1, 2]
    steps = round(interval / time_step)

    def swing() -> Tips:
        now, later = model.state(), model.state()
        tips = np.empty((samples, len(columns)))
        for tip in tips:
            for _ in range(steps):
                solver.step(now, later, None, None, time_step)
                now, later = later, now
            tip[:] = now.particle_q.numpy()[-1, columns]
        return tips

    swing()  # compiles
    return clocked(swing)
