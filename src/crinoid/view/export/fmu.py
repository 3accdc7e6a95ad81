"""FMU of a scenario: an arm that programs of FMI 3.0 simulate together with others."""

import hashlib
import re
import shutil
import tempfile
from html import escape
from pathlib import Path
from typing import Any

import tomli_w

from crinoid.foundation.atomic_file import FilePath, atomic_write
from crinoid.foundation.version import __version__
from crinoid.results.report_error import ReportError
from crinoid.scenario import Scenario
from crinoid.scenario.document import digests, rename_files
from crinoid.scenario.library import Source, scenario_of
from crinoid.simulation.co_simulation import CoSimulation

_SCRIPT = Path(__file__).with_name("fmu_script.py")


def write_fmu(source: Source, folder: FilePath, name: str) -> Path:
    """Write an FMU of FMI 3.0 for co-simulation, and return its path.

    It contains the scenario and its files, but neither Python nor crinoid.

    Parameters
    ----------
    source
        One case, the name of a built-in scenario, or a file. Its controller is left out, as the
        host controls the arm.
    folder
        Folder to write into.
    name
        Name of the file, without its ending, and of the model.

    Raises
    ------
    ScenarioError
        If anything is wrong with the scenario.
    ReportError
        If pythonfmu3 is not installed.
    """
    try:
        from pythonfmu3 import FmuBuilder
    except ModuleNotFoundError as error:
        if error.name != "pythonfmu3":
            raise
        text = 'an FMU is built by pythonfmu3: pip install "crinoid[fmu]"'
        raise ReportError(text) from error
    scenario = scenario_of(source)
    arm = CoSimulation(scenario)
    model = re.sub(r"^(?=\d)|\W", "_", name, flags=re.ASCII)
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        (work / "files").mkdir()
        (work / "documentation").mkdir()
        document = _without_controller(scenario)
        found = digests(document)
        files = {file: f"files/{n}-{Path(file).name}" for n, file in enumerate(found)}
        for file, copy in files.items():
            shutil.copyfile(file, work / copy)
        rename_files(document, files)
        text = tomli_w.dumps(document)
        (work / "scenario.toml").write_text(text, encoding="utf-8")
        content = "\n".join((__version__, text, *found.values()))
        token = hashlib.sha256(content.encode()).hexdigest()[:32]
        (work / "requirements.txt").write_text(f"crinoid=={__version__}\n")
        (work / "identity.txt").write_text(f"{model} {token}\n")
        (work / "documentation" / "index.html").write_text(
            _documentation(scenario.title or name, arm), encoding="utf-8"
        )
        # modules of two FMUs in one process must differ
        script = work / f"{model}_{token}.py"
        shutil.copyfile(_SCRIPT, script)
        inside = ("scenario.toml", "requirements.txt", "identity.txt", "files")
        built = FmuBuilder.build_FMU(
            script,
            dest=work / "built",
            project_files=[work / each for each in inside],
            documentation_folder=work / "documentation",
        )
        path = Path(folder) / f"{name}.fmu"
        with atomic_write(path) as temporary:
            shutil.copyfile(built, temporary)
    return path


def _without_controller(scenario: Scenario) -> dict[str, Any]:
    """Return the tables of a scenario without those of its controller, whose files may be large."""
    document = scenario.to_dict()
    kept = {key: each for key, each in document["control"].items() if not isinstance(each, dict)}
    if "target" in document:  # nothing feeds its motion forward
        document["target"].pop("feed_forward", None)
    return document | {"control": kept | {"kind": "none", "start": 0.0}}


def _documentation(title: str, arm: CoSimulation) -> str:
    """Return a page on the model: what it needs, its time, and its variables."""
    rows = [
        f"<tr><td>{kind}<td><code>{escape(each.name)}</code><td>{escape(each.unit)}"
        f"<td>{escape(each.meaning)}"
        for kind in ("input", "output", "parameter")
        for each in getattr(arm, f"{kind}s")
    ]
    return f"""<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>{escape(title)}</title>
<h1>{escape(title)}</h1>
<p>An arm of crinoid {__version__} for co-simulation by FMI 3.0.
<p>The Python that the host runs, 3.11 or newer, needs <code>crinoid=={__version__}</code>, and
packages that the scenario names. Python and crinoid are not in this archive.
<p>The communication step is a multiple of the control period, {arm.period:g} s, from 0 on.
Commands hold over it. In its first control period <code>current_*</code> reach their values
linearly, and <code>base_*</code> by a cubic. The host sets parameters before the start. It cannot
save or restore the state.
<table><tr><th>Kind<th>Name<th>Unit<th>Meaning
{chr(10).join(rows)}
</table></html>
"""
