"""A release: equal versions, files of the packages, and files of the host of the repository."""

import datetime
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest
import yaml

from crinoid import __version__
from helpers.paths import ROOT

HOST = ROOT / ".github"
WORKFLOWS = sorted((HOST / "workflows").glob("*.yml"))


def read_yaml(path):
    return yaml.safe_load(path.read_text("utf-8"))


def test_the_citation_has_the_version_and_the_date_of_the_changelog():
    cited = read_yaml(ROOT / "CITATION.cff")
    assert cited["version"] == __version__
    assert isinstance(cited["date-released"], datetime.date)
    heading = rf"^## \[{re.escape(__version__)}\] - (\S+)$"
    (date,) = re.findall(heading, (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M)
    assert date in ("unreleased", str(cited["date-released"]))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert cited["license"] == project["license"]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_runs_scripts_that_exist_and_has_few_rights(path):
    flow = read_yaml(path)
    assert flow["permissions"] == {"contents": "read"}
    assert "secrets." not in path.read_text("utf-8")
    steps = [step for job in flow["jobs"].values() for step in job.get("steps", [])]
    commands = [step["run"].split()[0] for step in steps if "run" in step]
    assert all(
        "${{" not in step.get("run", "") for step in steps
    )  # a branch may be named as a command
    called = [job["uses"] for job in flow["jobs"].values() if "uses" in job]
    assert all((ROOT / name).exists() for name in called)
    for command in commands:
        assert os.access(ROOT / command, os.X_OK), command
    for job in flow["jobs"].values():
        assert set(job.get("permissions", {})) <= {"id-token"}
        needed = job.get("needs", [])
        assert {needed} if isinstance(needed, str) else {*needed} <= {*flow["jobs"]}


def test_the_checks_run_on_the_versions_of_python_that_are_promised():
    text = (ROOT / "pyproject.toml").read_text("utf-8")
    promised = re.findall(r"Python :: (3\.\d+)", text)
    matrix = read_yaml(HOST / "workflows/check.yml")["jobs"]["check"]["strategy"]["matrix"]
    assert matrix["python"] == [promised[0], promised[-1]]
    assert f"for version in {' '.join(promised)};" in (ROOT / ".ci/release").read_text("utf-8")


@pytest.mark.parametrize("script", ["run", "release", "setup"])
def test_a_script_of_the_checks_is_sound_shell(script):
    subprocess.run(["bash", "-n", ROOT / ".ci" / script], check=True)


def test_the_packages_have_all_files_and_no_others(tmp_path):
    build = [sys.executable, "-m", "hatchling", "build", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,), (source,) = tmp_path.glob("*.whl"), tmp_path.glob("*.tar.gz")
    package = {
        path.relative_to(ROOT / "src").as_posix()
        for path in (ROOT / "src/crinoid").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    about = f"crinoid-{__version__}.dist-info"
    with zipfile.ZipFile(wheel) as file:
        held = set(file.namelist())
    assert {"crinoid/py.typed", "crinoid/scenario/library/tidal-channel.nc"} <= held
    assert {name for name in held if not name.startswith(about)} == package
    assert f"{about}/licenses/LICENSE" in held
    with tarfile.open(source) as file:
        held = {name.partition("/")[2] for name in file.getnames()}
    assert {f"src/{name}" for name in package} <= held
    assert {"tests/conftest.py", "docs/conf.py", ".ci/release", "SECURITY.md"} <= held
    tops = {name.partition("/")[0] for name in held}
    described = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    chosen = described["tool"]["hatch"]["build"]["targets"]["sdist"]["only-include"]
    assert tops == {*chosen, ".gitignore", "LICENSE", "PKG-INFO", "README.md", "pyproject.toml"}
    assert not [name for name in held if "__pycache__" in name or name.startswith(".ci/dist")]
