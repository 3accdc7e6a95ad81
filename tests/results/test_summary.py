"""The summary of a result as JSON and CSV."""

import csv
import json

import numpy as np
import pytest

from crinoid.results.metrics import MEASURES
from crinoid.results.summary import SUMMARY_CSV, SUMMARY_JSON, summarised, write_summary
from crinoid.scenario import Scenario
from helpers.made_results import made_result

SCENARIO = Scenario(title="small", arm={"nodes": 6}, target={"tolerance": 0.01})


def written(result, folder):
    """Return the document and the rows of a summary."""
    write_summary(result, folder)
    rows = list(csv.DictReader((folder / SUMMARY_CSV).open(encoding="utf-8")))
    return json.loads((folder / SUMMARY_JSON).read_text("utf-8")), rows


def test_a_summary_has_each_measure_with_its_unit(tmp_path):
    result = made_result(SCENARIO)
    result.uncontrolled = made_result(SCENARIO)
    document, rows = written(result, tmp_path)
    assert document["title"] == "small"
    assert document["status"] == document["uncontrolled"]["status"] == "ok"
    assert set(MEASURES) <= set(document)
    for name, measure in MEASURES.items():
        assert document[name] == pytest.approx(measure.of(result), nan_ok=True)
        assert document["units"][name] == measure.unit
    assert document["uncontrolled"]["rms_error"] == document["rms_error_uncontrolled"]
    table = {row["name"]: row for row in rows}
    assert float(table["max_base_force"]["value"]) == document["max_base_force"]
    assert float(table["rms_error"]["uncontrolled"]) == document["rms_error_uncontrolled"]
    assert table["max_thrust"]["value"] == ""
    assert [*table] == [*document["units"]]


def test_a_run_that_failed_has_what_is_valid_and_its_status(tmp_path):
    result = made_result(SCENARIO, 0.5, "failed at t = 0.5 s: too long a step")
    result.dataset["curvature"][-1] = np.nan
    document, _ = written(result, tmp_path)
    assert document["status"].startswith("failed at t = 0.5 s")
    assert document["max_curvature"] is document["curvature_cycles"] is None
    assert document["simulated_time"] == 0.5
    assert document["rms_error"] > 0
    result.dataset["position"][-1], result.dataset["tip_error"][-1] = 1e200, np.inf
    document, _ = written(result, tmp_path)
    assert document["max_strain"] is document["max_error"] is None


def test_an_equilibrium_has_other_numbers(tmp_path):
    result = made_result(SCENARIO)
    result.dataset = result.dataset.isel(time=[-1])
    found = summarised(result)
    tip = [found[f"tip_{axis}"].value for axis in "xz"]
    np.testing.assert_array_equal(tip, result.dataset["tip_position"].values[0])
    assert "rms_error" not in found
    assert found["max_curvature"].unit == "m-1"
