"""The arm of a release as a Cosserat rod of PyElastica."""

from importlib.metadata import version

import elastica
import numpy as np

from crinoid.benchmarks.peers import Engine, Swing, Tips, clocked
from crinoid.benchmarks.releases import IN_SPACE, Release, shape_at_rest


class _World(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):
    """A rod, its clamp and the forces on it."""


def _prepare(release: Release, nodes: int, time_step: float) -> Swing:
    scenario = release.scenario(nodes, time_step)
    arm = scenario.arm
    edge = arm.length / (nodes - 1.5)
    vertices, frames = shape_at_rest(arm, edge)
    # PyElastica's third director is the tangent
    places, directors = vertices.T.copy(), frames[:, [1, 2, 0]].transpose(1, 2, 0).copy()
    rod = elastica.CosseratRod.straight_rod(
        nodes - 1,
        vertices[0],
        frames[0, 0],
        frames[0, 1],
        edge * (nodes - 1),
        arm.radius,
        arm.density,
        youngs_modulus=arm.youngs_modulus,
        shear_modulus=arm.youngs_modulus / (2 * (1 + arm.poisson_ratio)),
        position=places,
        directors=directors,
    )
    rod.rest_kappa[:] = rod.kappa
    world = _World()
    world.append(rod)
    world.constrain(rod).using(
        elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    fall = np.array([0.0, 0.0, -scenario.water.gravity])
    world.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=fall)
    world.finalize()
    stepper, steps = elastica.PositionVerlet(), release.steps(time_step)

    def swing() -> Tips:
        rod.position_collection[:], rod.director_collection[:] = places, directors
        # the accelerations too: PyElastica does not clear one that is no number
        for rate in ("velocity", "omega", "acceleration", "alpha"):
            getattr(rod, f"{rate}_collection")[:] = 0.0
        tips = np.empty((release.samples, 3))
        now, step = np.float64(0.0), np.float64(time_step)
        for tip in tips:
            for _ in range(steps):
                now = stepper.step(world, now, step)
            tip[:] = rod.position_collection[:, -1]
        return tips

    return clocked(swing)


ENGINE = Engine(
    f"PyElastica {version('pyelastica')}",
    (IN_SPACE.name,),
    "water; its rod also shears, and its sections have inertia against tilting",
    order=2,
    meshes=(11, 21, 41, 81),
    steps=(0.002, 0.00005),
    prepare=_prepare,
)
