import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from crinoid.cli.command import folder_for
from crinoid.cli.commands import COMMANDS, GROUPS
from crinoid.cli.display import words_of
from crinoid.cli.export import export_result
from crinoid.cli.optimise import optimise_numbers
from crinoid.learning.settings import TrainingSettings
from crinoid.results.result import Result
from crinoid.scenario import ScenarioError
from crinoid.scenario.document import parse
from crinoid.studies.sweep.plan import SweepDesign
from crinoid.view.export.formats import FORMATS
from crinoid.view.film.settings import CameraSettings
from helpers.command import SMALL, call, one_line, refused, succeeded


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL.to_toml())
    return tmp_path


def noted(output: str) -> list[str]:
    return [line for line in output.splitlines() if line.startswith("note: ")]


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        (("run", "nowhere.toml"), "nowhere.toml"),
        (("run", "broken.toml"), "line 1"),
        (("equilibrium", "small.toml", "--set", "arm.lenght=1"), "arm.lenght"),
        (("run", "small.toml", "--set", "arm.radius=-1"), "arm.radius"),
        (("run", "small.toml", "--set", 'flow=[{file="C:\\x"}]'), r"Write \\ or / for a backslash"),
        (("run", "small.toml", "--set", "flow.0.velocity=[0.1"), "Close each quote and bracket."),
        (("run", "small.toml", "--out", "small.toml"), "small.toml"),
        (("run", "small.toml", "--out", ""), "--out: got an empty name; must be a folder"),
        (("report", "nowhere"), "nowhere"),
    ],
)
def test_a_mistake_gets_one_line_exit_2_and_nothing_written(here, arguments, answer):
    (here / "broken.toml").write_text("[arm\nlength = 1.0")
    ended = call(*arguments)
    assert answer in one_line(ended)
    assert ended.stdout == ""
    assert sorted(path.name for path in here.iterdir()) == ["broken.toml", "small.toml"]


QUICK = {
    "still-water": "still-water: no such command. Write crinoid run still-water.",
    "reprot x": "reprot: no such command. Did you mean 'report'",
    "sweep": "SCENARIO: missing. See crinoid sweep --help.",
    "identify small.toml small.toml": "--of: missing. ",
    "run --seed 3": "--seed: no such option. Write --set seed=3.",
    "run --arm.length=3": "--arm.length: no such option. Write --set arm.length=3.",
    "run --duration 3": "--duration: no such option. Write --set simulation.duration=3.",
    "report small.toml --duration 3": "--duration: no such option. See crinoid report --help.",
    "run small.toml arm.length=3": "arm.length=3: unexpected word. Write --set arm.length=3.",
    "run small.toml again": "again: unexpected word. See crinoid run --help.",
    "run --set arm.length 0.5": "--set: got .* must be KEY=VALUE. Write --set arm.length=0.5.",
    "run small.toml --set": "--set: requires an argument. ",
    "run small.toml --resume empty": "empty: unexpected word. Write --out empty.",
    "run --resume full": "full: is the folder of a result; must be a scenario. Name ",
    "run --keep max_curvature>3": "--keep: no such option. It is an option of crinoid optimise.",
    "report . --set seed=3": "--set: no such option. It is an option of crinoid run.",
    "report . --out small.toml": "--out: small.toml is a file; must be a folder",
    "run --force=3": "--force: does not take a value. ",
    "run --case 3": "--case: requires 2 arguments. ",
    "run unit.toml": "unit.toml: not valid TOML: .* length = 40 cm. Write the number only, in the ",
    "modes small.toml --count abc": '--count: got "abc"; must be a whole number. ',
    "film . --speed fast": '--speed: got "fast"; must be a number. ',
    "report small.toml": "small.toml: is a scenario; must be a folder of crinoid run. ",
    "export . --to csv --out a.xlsx": '--out: got "a.xlsx"; must be a folder, or ',
    "report empty": "empty: no result here; ",
    "export empty --to csv": "empty: no result here; ",
    "estimate small.toml small.toml": "RECORD: got small.toml, a scenario; must be a record of ",
    "sweep small.toml --vary arm.length 0.4:0.6:3": '--vary: got "arm.length"; must be KEY=VALUE. ',
    "sweep small.toml --vary arm.length=0.4-0.6": "--vary: .*. Write arm.length=0.4:0.6:3.",
    "run small.toml --set control.pid={}": "control.pid: missing; .* or control.pid.NAME.kp with ",
    "run nowhere.toml": "nowhere.toml: no such file or built-in scenario",
    "run small.toml --set control.kind=xyz": 'control.kind: got "xyz"; must be ',
    "run --case nowhere 3": "nowhere/plan.toml: does not exist",
    "report nowhere": "nowhere: no such file or directory",
    "report . --format xyz": '--format: got "xyz"; must be "png", "pdf" or "svg"',
    "export nowhere --to csv": "nowhere: no such file or directory",
    "export . --to xyz": '--to: got "xyz"; must be "vtkhdf", "csv", ',
    "film nowhere": "nowhere: no such file or directory",
    "film . --to a.xyz": "--to: got a.xyz; must be ",
    "film . --view inside": '--view: got "inside"; must be "side", ',
    "film . --size big": '--size: got "big"; must be WIDTHxHEIGHT',
    "modes small.toml --count 0": "--count: got 0; must be at least 1",
    "linearise small.toml --to xyz": '--to: got "xyz"; must be "npz", "mat" or "json"',
    "live small.toml --port 70000": "--port: got 70000; must be 0 ",
    "compare small.toml --controllers xyz": '--controllers: got "xyz"; must be "none", ',
    "tune small.toml --margin 2": "--margin: got 2.0; must be at least 0 ",
    "identify small.toml nowhere.csv --of arm.length": "RECORD: nowhere.csv: no such file",
    "identify small.toml log.csv --of arm.lenght": "arm.lenght: unknown key",
    "estimate small.toml nowhere.csv": "RECORD: nowhere.csv: no such file",
    "equilibrium small.toml --vary arm.length=1,1": '--vary: got "arm.length=1,1"; must have 2 ',
    "equilibrium small.toml --vary arm.lenght=1,2": "arm.lenght: unknown key",
    "optimise small.toml --over arm.length --for rms_error": '--over: got "arm.length"; must be ',
    "optimise small.toml --over arm.length=0.2:0.6 --for xyz": '--for: got "xyz"; must be a ',
    "sweep small.toml --vary seed=1,2 --sample xyz": '--sample: got "xyz"; must be "grid", ',
    "sweep small.toml --vary arm.lenght=1,2": "--vary: case arm.lenght = 1: arm.lenght: unknown ",
    "sweep small.toml --vary seed=1,2 --workers 0": "--workers: got 0; must be at least 1",
    "train small.toml --teacher xyz": '--teacher: got "xyz"; must be "lqg", ',
}
"""Commands with a mistake that is answered before JAX is loaded, and the begin of each answer."""
ALONE = """
import sys
from crinoid.cli.app import app
from helpers.command import call

for line in sys.stdin.read().splitlines():
    found = call(*line.split(), of=app)
    print(found.exit_code, "jax" in sys.modules, found.stderr.strip())
"""


def test_mistakes_are_answered_before_jax_is_loaded(here):
    (here / "unit.toml").write_text("[arm]\nlength = 40 cm\n")
    (here / "log.csv").write_text("")
    (here / "empty").mkdir()
    (here / "full").mkdir()
    (here / "full" / "result.nc").write_text("")
    path = os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])
    ended = subprocess.run(
        [sys.executable, "-c", ALONE],
        input="\n".join(QUICK),
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    said = ended.stdout.splitlines()
    for (command, answer), line in zip(QUICK.items(), said, strict=True):
        pattern = ".*".join(map(re.escape, answer.split(".*")))
        assert re.match(f"2 False crinoid: {pattern}", line), command


@pytest.mark.parametrize(
    ("line", "remedy"),
    {
        "length = 0,4": "Write a point in a number, not a comma.",
        "length = .4": "Write 0 before the point.",
        "length: 0.4": "Write = between a key and its value.",
        "kind = pid": "Write text in quotes.",
        "compare = True": "Write true or false in small letters.",
        "position = (0, 0)": "Write a list in [ ].",
        "[chamber]\n[chamber]": "Write [[ ]] around the name of each of several tables.",
    }.items(),
)
def test_a_line_that_is_not_toml_has_a_remedy(line, remedy):
    with pytest.raises(ScenarioError) as caught:
        parse(line)
    assert str(caught.value).endswith(f": {line.splitlines()[-1]}. {remedy}")


def test_help_groups_the_commands_and_shows_a_flag_by_its_name_only():
    assert "<bool>" not in succeeded("run", "--help")
    every = succeeded("--help")
    assert [name for names in GROUPS.values() for name in names] == re.findall(
        r"^│ ([a-z]+) ", every, re.M
    )


OTHERS = {
    "optimise": optimise_numbers,
    "export": export_result,
    "film": CameraSettings,
    "sweep": SweepDesign.of,
    "train": TrainingSettings,
}
"""What receives the values that the body of a command passes on without naming them."""


@pytest.mark.parametrize("command", COMMANDS, ids=lambda each: each.name)
def test_the_body_of_a_command_has_its_values_as_parameters(command):
    given = {each.parameter.name for each in command.options}
    for read_as in {each.read_as for each in command.options} - {""}:
        given = given - {"scenario", "settings", "out"} | {read_as, "folder"}
    expected = inspect.signature(command.load()).parameters
    named = {name for name, each in expected.items() if each.kind is not each.VAR_KEYWORD}
    assert named <= given
    if given != named:
        assert given - named <= {*inspect.signature(OTHERS[command.name]).parameters}


NAMES = {
    ("arm.length=0.6",): "small,arm.length=0.6",
    ("arm.length = 0.60", "seed=3"): "small,arm.length=0.6,seed=3",
    ("seed=3", "arm.length=6e-1"): "small,arm.length=0.6,seed=3",
    ("seed=2", "seed=3"): "small,seed=3",
    ("flow.0.velocity=[0.3, 0.0]", "control.compare=false"): (
        "small,control.compare=false,flow.0.velocity=0.3_0"
    ),
}


@pytest.fixture
def folders(here, monkeypatch):
    """Return the list of folders that runs would write to; nothing is run."""
    found = []
    name = "crinoid.cli.run.run_scenario"
    monkeypatch.setattr(name, lambda _, folder, **__: found.append(folder.as_posix()) or "")
    return found


def run_with(*settings, more=()):
    succeeded("run", "small.toml", *(f"--set={each}" for each in settings), *more)


def test_help_names_the_formats_of_export():
    (command,) = (each for each in COMMANDS if each.name == "export")
    (option,) = (each for each in command.options if each.flag == "--to")
    *some, last = (n for n, each in FORMATS.items() if each.accepts in ("table", "shapes"))
    one = {each.accepts: name for name, each in FORMATS.items()}
    words = f"{', '.join(some)} or {last}; of a policy, {one['policy']}; of a scenario, "
    assert option.text == f"{words}{one['scenario']}."
    assert set(FORMATS) <= set(re.findall(r"\w+", command.text))


def test_the_default_folder_is_named_after_changed_keys(folders):
    run_with()
    run_with("arm.length=0.6", more=("--out", "mine"))
    assert folders == ["results/small", "mine"]
    for settings in NAMES:
        run_with(*settings)
    assert folders[2:] == [f"results/{name}" for name in NAMES.values()]


def test_a_long_or_odd_change_gives_a_short_name_that_needs_no_quotes(folders):
    titles = ["a b", "a  b", "$(rm -r /)", "../up", "x" * 200, "x" * 201]
    for title in titles:
        run_with(f"title='{title}'")
    assert len({*folders}) == len(titles)
    for folder in folders:
        assert re.fullmatch(r"results/small,title=[\w.,=+-]+-[0-9a-f]{8}", folder)
        assert len(folder) <= len("results/small,") + 72


def test_a_run_that_is_prolonged_stays_in_its_folder(folders):
    longer = "simulation.duration=9"
    run_with("seed=1", longer, more=("--resume",))
    Path("results", f"small,seed=1,{longer}").mkdir(parents=True)
    run_with("seed=1", longer, more=("--resume",))
    run_with("seed=1", longer)
    own = f"results/small,seed=1,{longer}"
    assert folders == ["results/small,seed=1", own, own]


@pytest.mark.slow
def test_run_saves_and_report_draws(here):
    shown = succeeded("run", "small.toml", "--set", "simulation.duration=0.3")
    assert "tip error, RMS" in shown
    folder = here / "results" / "small,simulation.duration=0.3"
    assert f"crinoid report {folder.relative_to(here)}" in shown
    result = Result.load(folder)
    assert float(result.dataset["time"][-1]) == pytest.approx(0.3)
    assert result.status == "ok"
    for ending, name in (("png", "shape.png"), ("pdf", "report.pdf")):
        succeeded("report", folder, "--format", ending)
        assert (folder / name).stat().st_size > 10_000


def test_notes_that_differ_in_numbers_only_are_one():
    assert words_of("it lasts 3 s") == words_of("it lasts 3.5e-2 s") != words_of("it was 3 s")


@pytest.mark.slow
def test_notes_come_under_the_table_and_once_for_all_cases(here):
    # a thread in slow water: its drag is outside the range of the default coefficient
    thin = ("--set", "arm.radius=5e-4", "--set", "arm.youngs_modulus=1e9")
    (one,) = noted(succeeded("run", "small.toml", *thin))
    assert one.startswith("note: most of the drag acts at Reynolds numbers near")
    (folder,) = (here / "results").iterdir()
    result = Result.load(folder)
    assert result.notes == [one.removeprefix("note: ")]
    # the run without control has it with other numbers, which is said once
    assert result.uncontrolled.notes[0].startswith("most of the drag acts at Reynolds numbers near")
    assert result.uncontrolled.notes != result.notes
    # oddities of a scenario come before it is run, and only then
    studied = ("--set", "vary.seed=[1, 2]", "--set", "control.compare=false", "--out", "cases")
    odd = ("--set", "base.position=[0.0, 10.0]")
    one, when, other = noted(succeeded("run", "small.toml", *thin, *studied, *odd))
    assert one.startswith("note: case-01, case-02: base.position.1: got 10 m, above the")
    assert when.startswith("note: errors count from")
    assert other.startswith("note: case-01, case-02: most of the drag")
    first, *_ = Result.load(here / "cases" / "case-02").notes
    assert first.startswith("base.position.1: got 10 m")


def test_scenarios_are_listed_copied_and_described(here):
    listed = call("scenarios")
    for name in ("still-water", "constant-load", "station-keeping"):
        assert name in listed.stdout
    assert '"Length at rest. Unit: m."' in succeeded("scenarios", "--schema")
    succeeded("scenarios", "--copy", "station-keeping")
    assert "[control.pid.tilt]" in (here / "station-keeping.toml").read_text()
    assert "already there" in refused("scenarios", "--copy", "station-keeping")
    assert "station-keeping" in refused("scenarios", "--copy", "station-keepin")


def test_scenarios_that_studies_found_do_not_share_a_folder():
    names = [f"results/{study}/optimised.toml" for study in ("taper-optimise", "gains-optimise")]
    folders = [folder_for(None, name).name for name in names]
    assert folders == ["taper-optimise-optimised", "gains-optimise-optimised"]
    assert folder_for(None, "mine/arm.toml").name == "arm"
