"""The runs of a sweep: ranges, lists, samples, seeds, structures and batches."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from crinoid.cli.sweep import sweep_table
from crinoid.cli.weights import read_weights
from crinoid.results.extremes import Gumbel
from crinoid.scenario import Scenario, ScenarioError
from crinoid.scenario.variation import Span, read_variation
from crinoid.studies.design import Design
from crinoid.studies.sweep.long_term import extremes_of, over_all_time
from crinoid.studies.sweep.plan import SweepDesign

ARM = Scenario(arm={"nodes": 5}, simulation={"duration": 0.1})


def column(plan: SweepDesign, key: str) -> list:
    return [plan.values(run)[key] for run in range(1, plan.runs + 1)]


def test_ranges_are_even_with_both_ends_and_whole_where_they_can_be():
    for text, values in {
        "0.3:0.6:4": [0.3, 0.4, 0.5, 0.6],
        "0.6:0.3:2": [0.6, 0.3],
        "5:11:4": [5, 7, 9, 11],
        "5:10:3": [5.0, 7.5, 10.0],
    }.items():
        key, span = read_variation(f"arm.length={text}")
        assert isinstance(span, Span)
        assert key == "arm.length"
        found = span.values()
        assert found == pytest.approx(values, rel=1e-15)
        assert (found[0], found[-1]) == (values[0], values[-1])
        assert [type(value) for value in found] == [type(value) for value in values]
        assert read_variation(f"arm.length={span}")[1] == span
    # a logarithmic one has equal ratios
    for text in ("1e3:1e6:7:log", "-2:-0.5:3:log"):
        values = np.array(read_variation(f"arm.youngs_modulus={text}")[1].values())
        first, last = (float(part) for part in text.split(":")[:2])
        assert (values[0], values[-1]) == (first, last)
        np.testing.assert_allclose(values[1:] / values[:-1], values[1] / values[0], rtol=1e-13)


def test_lists_are_split_at_their_own_commas_only():
    for text, values in {
        "pid, lqg": ["pid", "lqg"],
        "[0.2, 0.0],[0.3, 0.1]": [[0.2, 0.0], [0.3, 0.1]],
        "'a,b',c": ["a,b", "c"],
        "0.5": [0.5],
        "true,false": [True, False],
        "a:b.nc,c:1": ["a:b.nc", "c:1"],
    }.items():
        assert read_variation(f"some.key={text}") == ("some.key", values)


def test_combinations_are_those_of_a_scenario_with_vary():
    vary = {"arm.length": [0.4, 0.5, 0.6], "arm.radius": [0.01, 0.02]}
    scenario = ARM.from_dict(ARM.to_dict() | {"vary": vary})
    cases = scenario.cases()
    for plan in (SweepDesign.of(scenario, []), Design.of_vary(scenario)):
        assert plan.runs == len(cases) == 6
        for run, (values, case) in enumerate(cases, start=1):
            assert plan.values(run) == values
            assert plan.case(run) == case
    # what the command line says of a key goes before what the scenario says
    assert column(SweepDesign.of(scenario, ["arm.length=0.7"]), "arm.length") == [0.7, 0.7]


def test_seeds_multiply_and_change_fastest():
    plan = SweepDesign.of(ARM.with_values({"seed": 7}), ["arm.length=0.4,0.5"], seeds=3)
    assert plan.keys == ["arm.length", "seed"]
    assert column(plan, "arm.length") == [0.4] * 3 + [0.5] * 3
    assert column(plan, "seed") == [7, 8, 9] * 2
    assert plan.case(6).seed == 9
    assert plan.case(6).arm.length == 0.5


@pytest.mark.parametrize("kind", ["lhs", "sobol"])
def test_samples_fill_their_ranges_and_are_the_same_each_time(kind):
    texts = ["arm.length=0.4:0.6", "arm.youngs_modulus=1e4:1e6:log", "arm.nodes=5,7"]
    plan = SweepDesign.of(ARM, texts, sampling=kind, count=16)
    assert plan.runs == 32
    lengths, moduli = (np.array(column(plan, key)) for key in ("arm.length", "arm.youngs_modulus"))
    # each sixteenth of a range holds one of the sixteen points, by ratios where it is logarithmic
    for parts in ((lengths - 0.4) / 0.2, np.log10(moduli / 1e4) / 2):
        assert sorted(np.floor(16 * parts[:16]).astype(int)) == list(range(16))
        np.testing.assert_array_equal(parts[:16], parts[16:])
    again = SweepDesign.from_toml(plan.to_toml())
    assert [again.values(run) for run in range(1, 33)] == [plan.values(run) for run in range(1, 33)]
    other = SweepDesign.of(ARM.with_values({"seed": 1}), texts, sampling=kind, count=16)
    assert column(other, "arm.length") != column(plan, "arm.length")


def test_batches_hold_each_run_once_and_one_structure():
    texts = ["arm.nodes=5,7", "arm.length=1:3:3", "simulation.integrator=newmark,implicit-euler"]
    plan = SweepDesign.of(ARM, texts, seeds=4, batch=5)
    together = np.concatenate([batch.runs for batch in plan.batches])
    assert sorted(together) == list(range(1, plan.runs + 1))
    assert max(batch.runs.size for batch in plan.batches) == 5
    assert len(plan.structures) == 4
    again = SweepDesign.of(ARM, texts, seeds=4, batch=5)
    assert {int(runs[0]) for runs in plan.structures} <= set(again.examples(1))
    assert "structures" not in vars(again)  # which is slow for millions of runs
    for batch in plan.batches:
        cases = [plan.case(run) for run in batch.runs.tolist()]
        assert len({(case.arm.nodes, case.simulation.integrator) for case in cases}) == 1
    # numbers make no other structure, but for those of the program itself
    assert len(SweepDesign.of(ARM, ["simulation.duration=0.1,0.2"]).structures) == 2
    assert len(SweepDesign.of(ARM, ["target.tip=[0.4, 0.1],[0.4, 0.2]"]).structures) == 1
    # of many runs a hundred at most
    for count, size, batches in ((150, 1, 150), (2000, 10, 200), (100_000, 100, 1000)):
        plan = SweepDesign.of(ARM, [f"arm.length=0.3:0.6:{count}"])
        assert (plan.batch, len(plan.batches)) == (size, batches)


def test_the_runs_that_are_tried_cover_all_values():
    plan = SweepDesign.of(ARM, ["arm.nodes=5,7,9", "arm.length=0.4:0.6:5"], seeds=3)
    tried = [plan.values(run) for run in plan.examples(1000)]
    assert {values["arm.nodes"] for values in tried} == {5, 7, 9}
    assert {values["arm.length"] for values in tried} == set(column(plan, "arm.length"))
    assert len(tried) < plan.runs / 3
    sampled = SweepDesign.of(ARM, ["arm.length=0.4:0.6"], sampling="lhs", count=50)
    tried = {sampled.values(run)["arm.length"] for run in sampled.examples(1000)}
    every = column(sampled, "arm.length")
    assert {min(every), max(every)} <= tried


def test_a_plan_comes_back_from_its_file():
    integrators = "simulation.integrator=newmark,implicit-euler"
    texts = ["arm.length=0.4:0.6:3", integrators, "target.tip=[0.4, 0.1]"]
    plan = SweepDesign.of(ARM, texts, seeds=2, batch=3)
    again = SweepDesign.from_toml(plan.to_toml())
    assert again.to_dict() == plan.to_dict()
    assert [again.case(run) for run in (1, 7)] == [plan.case(run) for run in (1, 7)]
    assert replace(again, seeds=3).to_dict() != plan.to_dict()
    with pytest.raises(ScenarioError, match=r'version: got "0.0.1"'):
        SweepDesign.from_toml(plan.to_toml().replace('version = "', 'version = "0.0.1" # '))


def test_files_that_vary_are_found_again_and_known_by_their_content(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(f"time,x,z\n0,0.4,0\n1,0.4,{len(name)}\n")
    scenario = Scenario(target={"path": "file", "file": "a.csv"})
    plan = SweepDesign.of(scenario, ["target.file=a.csv,b.csv"])
    assert column(plan, "target.file") == [str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]
    assert sorted(plan.files) == column(plan, "target.file")
    (tmp_path / "b.csv").write_text("time,x,z\n0,0.4,0\n1,0.4,1\n")
    assert SweepDesign.of(scenario, ["target.file=a.csv,b.csv"]).files != plan.files


def test_the_rows_of_a_table_are_the_cases(tmp_path):
    file, keys = tmp_path / "scatter.csv", ("flow.0.amplitude.1", "flow.0.frequency_hz")
    file.write_text(f"{','.join(keys)},share of time\n0.1,0.2,0.7\n1,0.3,0\n0.2,1,0.3\n")
    scenario = Scenario(flow=[{"kind": "sine", "amplitude": [0.0, 0.1], "frequency_hz": 0.1}])
    rows, shares = read_weights(file)
    assert shares.tolist() == [0.7, 0.3]  # without a share there is no case
    plan = SweepDesign.of(scenario, [], rows=rows, seeds=2)
    assert (plan.sampling, plan.option) == ("rows", "--weights")
    columns = [column(plan, key) for key in (*keys, "seed")]
    assert columns == [[0.1, 0.1, 0.2, 0.2], [0.2, 0.2, 1.0, 1.0], [0, 1, 0, 1]]
    assert plan.case(3).flow[0].amplitude == (0.0, 0.2)
    spans = [f"{keys[0]}=0.1:0.3:3", f"{keys[1]}=0.2,0.5,1"]
    assert SweepDesign.of(scenario, spans, rows=rows, seeds=2).to_dict() == plan.to_dict()
    assert len(plan.structures) == 1
    assert {1, 3} <= set(plan.examples(2))  # both rows
    again = SweepDesign.from_toml(plan.to_toml())
    assert [again.values(run) for run in range(1, 5)] == [plan.values(run) for run in range(1, 5)]


def test_statistics_over_all_time_are_those_by_hand():
    scenario = ARM.with_values({"simulation.duration": 100.0, "target.judged_from": 40.0})
    plan = SweepDesign.of(scenario, ["arm.length=0.3,0.4"], seeds=3)
    shares = np.repeat([0.8, 0.2], 3) / 3
    known = {
        "within_tolerance": [1.0, 0.9, 0.8, 0.5, np.nan, 0.1],  # the fifth run failed
        "life": [10.0] * 3 + [2.0] * 3,
        "max_error": [1.0, 1.2, 1.7, 2.0, 2.5, 4.0],
        "max_base_force": [1.0, 1.2, 1.7, 2.0, np.nan, 4.0],
        "max_error_time": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
    }
    about = {"units": "m", "long_name": "largest"}
    data = xr.Dataset({name: ("run", each, about) for name, each in known.items()})
    found = over_all_time(data, plan, shares)
    assert float(found["combined_within_tolerance"]) == pytest.approx(0.8 * 0.9 + 0.2 * 0.2)
    assert float(found["combined_life"]) == pytest.approx(1 / (0.8 / 10 + 0.2 / 2))
    extremes = extremes_of(found)
    assert list(extremes) == ["max_error"]  # too few runs have a force
    rows = np.reshape(known["max_error"], (2, 3))
    level = Gumbel(*rows, shares=np.array([0.8, 0.2])).return_level(10 * 365.25 * 86400 / 60)
    np.testing.assert_allclose(extremes["max_error"].sel(return_period=10.0), level)
    assert not extremes_of(over_all_time(data, replace(plan, seeds=1), shares))


def test_the_table_has_the_mean_of_time_and_the_time_that_ends_well():
    names = ("max_error", "steady_error", "rms_error_uncontrolled", "rms_angle_error")
    unknown = {name: ("run", [np.nan] * 3, {"units": "m"}) for name in names}
    unknown |= {name: ("run", [np.nan] * 3, {"units": "s"}) for name in ("settling_time", "work")}
    known = {"rms_error": ("run", [1.0, 2.0, np.nan], {"units": "m"})}
    status = {"status": ("run", ["ok", "ok", "failed: it broke"])}
    data = xr.Dataset(known | unknown | status, {"run": [1, 2, 3]}, {"title": "a sway"})
    table = sweep_table(data, np.array([0.6, 0.3, 0.1]))
    last = list(table.columns[-1].cells)
    assert next(iter(table.columns[0].cells)) == "RMS tip error (m)"
    assert last[0] == "1.33"  # (0.6 + 0.6) / 0.9
    assert last[-1] == "90.00%"
    data = data.assign(combined_within_tolerance=0.932, combined_life=4.0)
    table = sweep_table(data, np.array([0.6, 0.3, 0.1]))
    assert list(table.columns[0].cells)[-2] == "time within tolerance over all of it"
    assert list(table.columns[-1].cells)[-2:] == ["93.20%", "4 year"]
    assert len(sweep_table(data).columns) == len(table.columns) - 1
