"""How the motion is computed and what of it is kept."""

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import AsTuple, Quantity, Seconds

__all__ = ["Output", "Simulation", "not_whole", "whole_steps"]

Integrator = Literal["newmark", "generalized-alpha", "implicit-euler"]

Gamma = Annotated[
    float,
    Field(ge=0.5),
    Quantity(takes="a number of 0.5 or more (with less, damping is negative: motion grows)"),
]

_OPTIONS: dict[Integrator, dict[str, float]] = {
    "newmark": {"beta": 0.25, "gamma": 0.5},
    "generalized-alpha": {"spectral_radius": 0.8},
    "implicit-euler": {},
}


_MAX_STEPS = 10**9


class Simulation(Model):
    """Time, time steps and the solver."""

    duration: Seconds = Field(
        default=20.0, gt=0, description="Simulated time; a whole number of time steps."
    )
    time_step: Seconds = Field(default=0.01, gt=0, description="Time step.")
    integrator: Integrator = Field(default="newmark", description="Time integrator.")
    beta: float | None = Field(
        default=None, gt=0, description="Parameter beta of newmark; 0.25 if left out."
    )
    gamma: Gamma | None = Field(
        default=None, description="Parameter gamma of newmark; 0.5 if left out."
    )
    spectral_radius: float | None = Field(
        default=None,
        ge=0,
        le=1,
        description="Spectral radius of generalized-alpha, for motion far too fast to resolve: 1 "
        "keeps it, 0 removes it; 0.8 if left out.",
    )
    tolerance: float = Field(
        default=1e-8, gt=0, le=1e-2, description="Relative residual at which a step has converged."
    )
    max_iterations: int = Field(
        default=20, ge=1, le=1000, description="Greatest number of iterations of a step."
    )
    max_halvings: int = Field(
        default=12, ge=0, le=16, description="How often a step that fails may be halved."
    )
    error: float | None = Field(
        default=None,
        gt=0,
        le=1,
        description="Largest estimated local error of a step as a share of arm.length; a step that "
        "exceeds it is halved. Off if left out.",
    )
    start: Literal["equilibrium", "rest"] = Field(
        default="equilibrium",
        description="equilibrium: still, under the loads of t = 0; rest: undeformed.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if self.time_step > self.duration:
            yield Mistake(
                "time_step", f"got {self.time_step}, takes up to duration = {self.duration} (s)"
            )
        elif self.duration / self.time_step > _MAX_STEPS:
            text = f"got {self.duration}, takes up to {_MAX_STEPS:.0e} time steps ("
            yield Mistake("duration", f"{text}{_MAX_STEPS * self.time_step:.6g} s)")
        elif whole_steps(self.duration, self.time_step) is None:
            yield Mistake("duration", not_whole(self.duration, self.time_step))
        taken = self.integrator_options
        for key in ("beta", "gamma", "spectral_radius"):
            if getattr(self, key) is not None and key not in taken:
                keys = " and ".join(taken) or "neither beta, gamma nor spectral_radius"
                text = f'does not go with integrator = "{self.integrator}", which takes {keys}'
                yield Mistake(key, text)
        if self.integrator == "newmark" and 2 * taken["beta"] < taken["gamma"]:
            beta, gamma = taken["beta"], taken["gamma"]
            key, text = "beta", f"got {beta}, takes gamma / 2 = {gamma / 2:.6g} or more"
            if self.beta is None:
                key, text = "gamma", f"got {gamma}, takes up to 2 beta = {2 * beta:.6g}"
            yield Mistake(key, f"{text} (else long time steps are unstable)")

    @property
    def integrator_options(self) -> dict[str, float]:
        """Options of the chosen integrator: beta and gamma, spectral_radius, or none."""
        given = {key: getattr(self, key) for key in _OPTIONS[self.integrator]}
        options = _OPTIONS[self.integrator]
        return {key: options[key] if value is None else value for key, value in given.items()}

    @property
    def steps(self) -> int:
        """Number of time steps."""
        return round(self.duration / self.time_step)


class Output(Model):
    """Instants and variables of a run that are saved."""

    interval: Seconds | None = Field(
        default=None,
        gt=0,
        description="Time between saved states, a whole number of time steps; 0.02 s if left out, "
        "or the nearest that fits.",
    )
    variables: (
        Annotated[
            tuple[str, ...],
            AsTuple,
            Field(min_length=1),
            Quantity(takes="a list of names of variables"),
        ]
        | None
    ) = Field(
        default=None,
        description="Variables to save of those along the arm ([result.md](result.md#variables)); "
        "all if left out. What has no number for each node or edge is always saved.",
    )


def whole_steps(time: float, time_step: float) -> int | None:
    """Return how many time steps make up a time, or None if no whole number of them does."""
    steps = round(time / time_step)
    whole = steps > 0 and math.isclose(time / time_step, steps, abs_tol=1e-6)
    return steps if whole else None


def not_whole(time: float, time_step: float) -> str:
    """Say that a time is not a whole number of time steps, and which ones nearby are."""
    below = math.floor(time / time_step)
    near = [f"{steps * time_step:.12g}" for steps in (below, below + 1) if steps > 0]
    text = f"got {time}, takes a whole number of time steps of {time_step} s"
    return f"{text}; nearest {' or '.join(near)}"
