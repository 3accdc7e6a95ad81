"""Other programs for the release of an arm: omissions, meshes and time steps."""

from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from typing import NamedTuple

from benchmarks.releases import IN_A_CURRENT, IN_SPACE, IN_THE_PLANE, Release
from crinoid.scenario import Scenario
from validation.peers.swing import Swing

Program = Callable[[Scenario, float, float, int], Swing]
"""The run of an arm by time step (s), interval of samples (s), and their number."""


class Engine(NamedTuple):
    """A program that lets an arm go."""

    name: str
    states: tuple[str, ...]
    """Names of the releases that it can state."""
    omits: str
    """What it leaves out of the physics or does otherwise, in words."""
    order: int
    """Order in the time step."""
    meshes: tuple[int, ...]
    """Numbers of nodes, or of segments, from coarse to fine."""
    steps: tuple[float, float]
    """Largest and smallest time step (s)."""
    program: Program | None = None
    segments: bool = False
    """Whether a mesh is a number of segments."""

    def prepare(self, release: Release, mesh: int, time_step: float) -> Swing:
        """Return the run of a release with a mesh and a time step (s)."""
        assert self.program is not None
        scenario = release.scenario(mesh + self.segments, time_step)
        return self.program(scenario, time_step, release.interval, release.samples)


_FINE = (11, 21, 41, 81)
PEERS = {
    "mujoco": Engine(
        "MuJoCo",
        (IN_THE_PLANE.name, IN_SPACE.name),
        "water; its edges keep their length by soft constraints, and its time integration damps",
        order=1,
        meshes=_FINE,
        steps=(0.01, 0.000125),
    ),
    "pyelastica": Engine(
        "PyElastica",
        (IN_SPACE.name,),
        "water; its rod also shears, and its sections have inertia against tilting",
        order=2,
        meshes=_FINE,
        steps=(0.002, 0.00005),
    ),
    "dismech_newton": Engine(
        "DiSMech-Newton",
        (IN_THE_PLANE.name, IN_SPACE.name),
        "water; single precision, and a fixed number of iterations without a test of convergence",
        order=2,
        meshes=_FINE,
        steps=(0.02, 0.0025),
    ),
    "soromox": Engine(
        "SoRoMoX",
        (IN_THE_PLANE.name,),
        "water; its segments have one curvature and one extension each",
        order=5,
        meshes=(2, 4, 6, 12),
        steps=(0.01, 0.00025),
        segments=True,
    ),
    "moordyn": Engine(
        "MoorDyn",
        (IN_A_CURRENT.name,),
        "compression, twist, curvature at rest and damping in bending",
        order=4,
        meshes=_FINE,
        steps=(0.002, 0.00005),
    ),
    "cabledyn": Engine(
        "CableDyn",
        (IN_A_CURRENT.name,),
        "curvature at rest and a free end: a body of some mass is at the tip",
        order=1,  # as measured
        meshes=(6, 11, 21, 41),
        steps=(0.01, 0.0005),
    ),
}
"""Peers by package."""


def find_peers() -> tuple[tuple[Engine, ...], list[str]]:
    """Return the peers that are installed, and a line for each that is not."""
    found, missing = [], []
    for name, peer in PEERS.items():
        try:
            program = import_module(f"validation.peers.{name}").prepare
            found.append(peer._replace(name=f"{peer.name} {version(name)}", program=program))
        except ImportError as error:
            missing.append(f"{name} is left out ({error}): pip install -e '.[peers]'")
    return tuple(found), missing
