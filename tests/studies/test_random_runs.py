"""The scenarios that `benchmarks/random_runs.py` draws."""

import itertools
from types import SimpleNamespace

import jax
import numpy as np
import pytest

import crinoid
from helpers.paths import ROOT
from helpers.scripts import load_script

drawing = load_script(ROOT / "benchmarks" / "random_runs.py")


@pytest.mark.parametrize("kind", ["drifting", "swinging"])
def test_runs_of_one_structure_share_their_programs_in_any_current(kind, tmp_path):
    records = drawing.write_records(tmp_path)
    structures = (
        drawing.draw_structure(np.random.default_rng([1, number]), records)
        for number in itertools.count()
    )
    structure = next(each for each in structures if each["record"] == records[kind])
    shapes = set()
    for number in range(4):
        draw = np.random.default_rng([2, number])
        scenario = crinoid.Scenario.from_dict(drawing.draw_numbers(draw, structure))
        flows = crinoid.system(scenario).forces.water.flows
        shapes.add(tuple(leaf.shape for leaf in jax.tree.leaves(flows)))
    assert len(shapes) == 1


def test_an_arm_without_energy_does_not_pass_in_silence(monkeypatch):
    data = SimpleNamespace(data_vars=())
    still = SimpleNamespace(dataset=data, notes=[], failure="", status="ok")
    monkeypatch.setattr(drawing, "draw_numbers", lambda *_: {})
    monkeypatch.setattr(drawing, "play", lambda *_, **__: still)
    monkeypatch.setattr(drawing, "moves", lambda data: True)
    ends = []
    for scale in (1e-16, 1e-14):
        monkeypatch.setattr(drawing, "ledger", lambda data, scale=scale: (1.0, scale))
        ends.append(drawing.run(0, 1, {"name": "still"}, [])[0])
    assert ends == ["ok, without energy", "SILENT"]
