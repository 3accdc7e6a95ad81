"""From the description of a flow to the arrays that it is computed with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from crinoid.assembly.door import made
from crinoid.assembly.measured import measured
from crinoid.assembly.numbers import array
from crinoid.flow import (
    Flow,
    GaussMarkov,
    Gust,
    LogarithmicShear,
    PowerShear,
    Sine,
    Turbulence,
    Uniform,
    Waves,
)
from crinoid.flow.flow import panels_of
from crinoid.onset import Onset
from crinoid.scenario import FlowTable, Scenario
from crinoid.scenario import flow as flows

if TYPE_CHECKING:
    from crinoid.recording import Recording  # xarray, slow to load


def build_flow(
    scenario: Scenario, index: int, flow: flows.Flow, recording: Recording | None = None
) -> Flow:
    """Return the flow that stands at ``index`` in a scenario; a measured one from its recording."""
    onset = flow_onset(flow)
    # two random flows of one scenario are not the same
    seed = np.random.SeedSequence(scenario.seed, spawn_key=(index,))
    match flow:
        case flows.UniformFlow():
            return Uniform(onset, array(flow.velocity))
        case flows.GustFlow():
            panels = panels_of(flow.ramp_time, flow.duration)
            return Gust(onset, array(flow.velocity), array(flow.duration), panels=panels)
        case flows.SineFlow():
            return Sine(
                onset,
                array(flow.amplitude),
                array(flow.frequency_hz),
                array(np.deg2rad(flow.phase_deg)),
                panels=panels_of(flow.ramp_time, 1 / flow.frequency_hz),
            )
        case flows.ShearFlow():
            depth = scenario.water.depth
            assert depth is not None  # the scenario refuses a shear flow without one
            profile = (
                onset,
                array(flow.velocity),
                array(depth - flow.reference_depth),
                array(-depth),
            )
            if flow.power_exponent is None:
                return LogarithmicShear(*profile, array(flow.roughness_length))
            return PowerShear(*profile, array(flow.power_exponent))
        case flows.GaussMarkovFlow():
            return GaussMarkov.of(
                onset,
                mean=np.array(flow.mean),
                standard_deviation=np.array(flow.standard_deviation),
                correlation_time=flow.correlation_time,
                duration=scenario.simulation.duration,
                generator=np.random.default_rng(seed),
            )
        case flows.TurbulenceFlow():
            return Turbulence.of(
                onset,
                mean=np.array(flow.mean),
                intensity=flow.intensity,
                length_scale=flow.length_scale,
                modes=flow.modes,
                generator=np.random.default_rng(seed),
            )
        case flows.WavesFlow():
            depth = scenario.water.depth
            assert depth is not None  # likewise
            return Waves.of(
                onset,
                significant_height=flow.significant_height,
                peak_period=flow.peak_period,
                heading=_heading(scenario, np.deg2rad(flow.direction_deg)),
                gamma=flow.gamma,
                components=flow.components,
                depth=depth,
                gravity=scenario.water.gravity,
                generator=np.random.default_rng(seed),
            )
        case flows.MeasuredFlow():
            assert recording is not None
            return measured(onset, recording, scenario.base.position)
        case _:  # of an installed package
            generator = np.random.default_rng(seed)
            return made(f"flow {index}", Flow, flow.build, scenario, generator)


def flow_onset(flow: FlowTable) -> Onset:
    """Return when and how a flow sets in."""
    return Onset(*map(array, (flow.start, flow.ramp_time, np.inf)))


def _heading(scenario: Scenario, direction: float) -> Float[np.ndarray, " level"]:
    """Return what the level axes have of a direction (rad): x, and in space y."""
    level = scenario.arm.dimension - 1
    return np.array([np.cos(direction), np.sin(direction)][:level])
