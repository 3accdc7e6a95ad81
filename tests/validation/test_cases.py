"""Every validation case holds, and its references are the published ones."""

import numpy as np
import pytest

from validation.case import KINDS, Check, Evidence
from validation.cases import all_cases
from validation.cases.bends import exact as loaded
from validation.cases.bends_in_space import exact as bent
from validation.cases.fish import sine

CASES = {case.name: case for case in all_cases()}


@pytest.mark.release
@pytest.mark.parametrize("name", CASES)
def test_case_holds(name):
    case = CASES[name]
    if case.missing:
        pytest.skip(f"needs {case.missing}")
    found = case.run()
    missed = [check for check in found.checks if not check.holds]
    assert not missed
    assert all(np.isfinite([check.reference, check.value]).all() for check in found.checks)


def test_cases_say_what_they_are():
    for name, case in CASES.items():
        assert case.run.__name__ == name.replace("-", "_")
        assert case.kind in KINDS
        assert all(text.endswith(".") for text in (case.title, case.method, case.reason))


def test_references_are_the_published_ones():
    # Mattiasson 1981, table: P L^2/EI = 1, 2, 5, 10
    published = [
        (0.461352, 0.301721, 0.056433),
        (0.781750, 0.493457, 0.160642),
        (1.215368, 0.713792, 0.387628),
        (1.430286, 0.810609, 0.554996),
    ]
    for load, numbers in zip((1.0, 2.0, 5.0, 10.0), published, strict=True):
        np.testing.assert_allclose(loaded(load), numbers, rtol=0, atol=6e-7)
    np.testing.assert_allclose(bent(), [58.780, 22.245, 40.189], rtol=0, atol=6e-4)


def test_a_check_holds_within_its_tolerance_only():
    assert Check("x", 2.0, 2.1, 0.1 + 1e-12).holds
    assert not Check("x", 2.0, 2.1, 0.09).holds
    assert Check("x", 2.0, 2.1, 0.06, relative=True).error == pytest.approx(0.05)
    assert not Check("x", 2.0, np.nan, 1e9).holds
    assert not Check("x", np.inf, np.inf, 1e9).holds
    for wrong in (np.nan, np.inf, -1.0):
        with pytest.raises(ValueError, match="tolerance must be"):
            Check("x", 2.0, 2.0, wrong)
    with pytest.raises(ValueError, match="no relative error"):
        Check("x", 0.0, 0.0, 0.1, relative=True)
    assert Check("x", np.float64(2.0), np.float64(2.0), np.float64(0.0)).holds is True
    with pytest.raises(ValueError, match="at least one check"):
        Evidence([])


def test_the_sine_of_a_record_has_its_amplitude_phase_and_slope():
    turns = np.linspace(0.0, 2.0, 50)
    wave, slope = sine(turns, 2.0 + 0.1 * turns + 0.3 * np.cos(2 * np.pi * turns + 0.5))
    np.testing.assert_allclose(wave, 0.3 * np.exp(0.5j), rtol=0, atol=1e-12)
    assert slope == pytest.approx(0.1)
