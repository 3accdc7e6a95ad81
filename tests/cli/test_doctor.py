"""What `crinoid doctor` and `crinoid --version` say of the installation."""

import shutil

import pytest

import crinoid
from crinoid.cli import doctor
from crinoid.foundation import version
from helpers.command import call, succeeded


@pytest.mark.slow
def test_a_sound_installation_names_its_versions_and_solves_the_known_case():
    own, _ = succeeded("--version").splitlines()
    assert own == f"crinoid {crinoid.__version__}"
    assert all(version.versions().values())
    assert "m from its known place" in succeeded("doctor")


def test_what_is_wrong_is_said_with_its_remedy(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    lacks = {"websockets"}
    installed = version.version_of
    monkeypatch.setattr(doctor, "version_of", lambda name: "" if name in lacks else installed(name))
    full = shutil.disk_usage(tmp_path)._replace(free=3_000_000)
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda folder: full)
    monkeypatch.setattr(doctor, "_TIP", (0.4, -10.2))
    ended = call("doctor")
    assert ended.exit_code == 1
    assert ended.stderr.startswith(
        "crinoid: this installation computes another motion: tip at [0.4"
    )
    assert 'pip install "crinoid[live]"' in ended.stdout
    assert "note: only 3 MB are free where results are written" in ended.stdout
