"""Chart of shed vortices."""

import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.view.figures.charts.vortices import has_vortices, shedding_frequency, vortex_chart
from crinoid.view.figures.run import Run

TIME = np.linspace(0.0, 10.0, 501)


def run(phase):
    force = np.zeros((TIME.size, 2, 3))
    force[:, -1, 2] = 0.4 * np.cos(phase)
    return xr.Dataset(
        {
            "vortex_phase": (("time", "edge"), np.stack([0.5 * phase, phase], axis=1)),
            "vortex_force": (("time", "edge", "axis"), force),
            "natural_frequency": ("mode", [1.4, 30.0]),
        },
        {"time": TIME, "axis": list("xyz")},
    )


@pytest.mark.parametrize("wrapped", [False, True])
def test_the_frequency_of_shedding_is_the_rate_of_the_phase(wrapped):
    phase = 2 * np.pi * 1.3 * TIME
    if wrapped:
        phase = np.angle(np.exp(1j * phase))
    data = run(phase)
    np.testing.assert_allclose(shedding_frequency(data, 1), 1.3, rtol=1e-6)


def test_the_chart_shows_frequencies_next_to_those_of_the_arm_and_the_largest_force():
    both = Run(run(2 * np.pi * 1.3 * TIME), run(2 * np.pi * 1.0 * TIME))
    assert has_vortices(both)
    assert not has_vortices(Run(both.result.drop_vars("vortex_force")))
    frequency, force = vortex_chart(both).panels
    assert [level.value for level in frequency.levels] == [1.4]
    np.testing.assert_allclose(frequency.traces[0].values, 1.3, rtol=1e-6)
    assert "z" in force.label
    assert [trace.words for trace in force.traces] == [
        "with control: 0.283 N/m RMS",
        "without control: 0.283 N/m RMS",
    ]


def test_lock_in_ends_by_the_mass_ratio_or_by_the_model():
    def ends(density, **water):
        scenario = crinoid.Scenario(arm={"density": density}, water={"density": 1000.0} | water)
        return Prepared(scenario).facts.lock_in

    # Govardhan and Williamson 2000: 9.25 sqrt((m + 1) / (m - 0.54))
    assert ends(1050.0) == pytest.approx((4.0, 9.25 * np.sqrt(2.05 / 0.51)))
    assert ends(500.0) == (4.0, np.inf)
    assert ends(1050.0, vortices={}) == pytest.approx((1 / 0.26, 1 / 0.1))
