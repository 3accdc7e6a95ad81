"""The example package: it installs, scenarios name its kinds, and its own tests pass."""

import os
import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest

import crinoid
from crinoid.scenario import kinds
from helpers.paths import ROOT
from helpers.refusals import mistake

PACKAGE = ROOT / "examples" / "reef"


@pytest.mark.slow
def test_it_installs_and_its_tests_pass(tmp_path):
    site, pip = tmp_path / "site", [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    install = ["install", "--quiet", "--no-deps", "--no-build-isolation", "--target", str(site)]
    subprocess.run([*pip, *install, str(PACKAGE)], check=True, timeout=300)
    known = os.environ.get("PYTHONPATH", "")
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "tests"],
        cwd=PACKAGE,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, [str(site), known]))},
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("nowhere.to:Be", "ModuleNotFoundError: No module named 'nowhere'"),
        ("pathlib:Path", "pathlib:Path is not derived from LoadTable"),
        ("crinoid.tables:LoadTable", "crinoid.tables:LoadTable has no own method build"),
    ],
)
def test_a_package_that_is_broken_is_named(monkeypatch, value, reason):
    entry = EntryPoint("rope", value, "crinoid.loads")
    monkeypatch.setattr(kinds, "installed", lambda group: {"rope": entry})
    line = mistake(crinoid.Scenario, load=[{"kind": "rope"}])
    assert line.startswith('load.0.kind: got "rope"; must be a kind that can be loaded. ')
    assert line.endswith(f" fails: {reason}")
