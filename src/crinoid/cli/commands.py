"""All commands: options, defaults and help. Nothing here loads JAX, or the body of a command."""

import re
from dataclasses import replace
from pathlib import Path

from crinoid.cli.command import complete_name
from crinoid.cli.declaration import FILES, Command, Option, must, out, resume

DEFAULT = "station-keeping"  # scenario of `crinoid run` without one
_NAME = "A TOML file, or the name of a built-in scenario."
_SCENARIO = replace(Option("SCENARIO", str, _NAME, complete=complete_name), read_as="scenario")
_TEXT = replace(_SCENARIO, read_as="text")  # with its text, in which a command changes numbers
_SET = Option(
    "--set KEY=VALUE",
    list[str],
    "Change a key, such as arm.length=0.6; the default folder is named after it.",
    name="settings",
)
_FORCE = Option(
    "--force",
    False,
    "Replace the finished result of another scenario, or files of others.",
    group=FILES,
)
_RESULT = Option("RESULT", Path, "A folder that `crinoid run` wrote.")
_POSITIVE = must("be at least 1", lambda value: value >= 1)


def _measured(text: str) -> Option:
    def missing(path: Path) -> str:
        if not path.exists():
            return f"{path}: no such file"
        tables = r"^\[\[?(arm|base|water|flow|control|target|simulation)\b"
        if path.suffix != ".toml" or not re.search(tables, path.read_text("utf-8"), re.M):
            return ""
        return f"got {path}, a scenario; must be a record of measurements"

    return Option("RECORD", Path, f"What was measured: {text}", False, check=missing)


def _no_format(form: str) -> str:
    from crinoid.analysis.model_files import FORMATS
    from crinoid.scenario.errors import got, one_of

    return "" if form in FORMATS else got(form, f"be {one_of(FORMATS)}")


def _wrong_kinds(text: str) -> str:
    from crinoid.scenario.control import KINDS
    from crinoid.scenario.errors import got, one_of, shown
    from crinoid.scenario.kinds import installed

    kinds = [kind.strip() for kind in text.split(",")]
    known = [kind for kind in (*KINDS, *installed("controllers")) if kind != "custom"]
    for kind in kinds:
        if kind not in known:
            return got(kind, f"be {one_of(known)}, separated by commas")
        if kinds.count(kind) > 1:
            return f"got {shown(kind)} twice; must name each controller once"
    return ""


# fmt: off
COMMANDS = (
    Command("run", "crinoid.cli.scenario_commands:run",
        "Run a scenario and save what happened.",
        Option("[SCENARIO]", str, _NAME, DEFAULT, name="scenario", required=False,
            complete=complete_name),
        _SET,
        Option("--case DIR N", tuple[Path, int], "Play run N of the sweep in DIR again."),
        Option("--all", False, "Print all numbers, not the main ones only.", name="full"),
        out("results/SCENARIO"), resume("run"), _FORCE),
    Command("equilibrium", "crinoid.cli.scenario_commands:equilibrium",
        "Find the shape of the arm at rest under the loads of t = 0, and save it.",
        _SCENARIO,
        Option("--vary KEY=FROM:TO:COUNT", list[str],
            "Follow the equilibrium over a number, and back: a bending curve."),
        _SET, out("results/SCENARIO-equilibrium"), _FORCE),
    Command("flow", "crinoid.cli.scenario_commands:flow",
        "Draw and sum up the current of a scenario at its arm, or a record of the sea by itself.",
        Option("SCENARIO|FILE", str,
            "A TOML file, the name of a built-in scenario, or a record of the sea.",
            name="scenario", complete=complete_name),
        _SET, out("results/SCENARIO-flow"), _FORCE, interrupted="interrupted"),
    Command("modes", "crinoid.cli.analyses:show_modes",
        "Find small vibrations about the equilibrium: frequencies, damping ratios and shapes.",
        _SCENARIO, _SET,
        Option("--count N", 6, "How many modes to find.", check=_POSITIVE),
        Option("--in-air", False, "Leave out the water: those in air only."),
        out("results/SCENARIO-modes"), _FORCE, interrupted="interrupted"),
    Command("margins", "crinoid.cli.analyses:show_margins",
        "Find the stability margins of the control loop of a scenario, and draw them.",
        _SCENARIO, _SET, out("results/SCENARIO-margins"), _FORCE, interrupted="interrupted"),
    Command("linearise", "crinoid.cli.linearise:show_linearisation",
        "Linearise arm, actuators and sensors: A, B, C, D over a control period, with names.",
        _SCENARIO, _SET,
        Option("--to FORMAT", "npz", "Format of the model: npz, mat or json.", check=_no_format),
        Option("--order N", int, "Reduce it to so many states.", "all states", check=_POSITIVE),
        out("results/SCENARIO-linearise"), _FORCE, interrupted="interrupted"),
    Command("live", "crinoid.cli.live:run_live",
        "Simulate a scenario in the browser, in real time: turn its numbers, push it, record it.",
        _SCENARIO, _SET,
        Option("--port", 8080, "Where the page is served, on this machine; 0: any.",
            check=must("be 0 (any free port) to 65535", lambda port: 0 <= port <= 65535)),
        Option("--browser/--no-browser", bool, "Whether to open a browser.",
            "where there is a display"),
        out("results/SCENARIO-live"), interrupted="interrupted"),
    Command("doctor", "crinoid.cli.doctor:examine",
        "Examine the installation: versions, devices, optional parts, folders, a known solve.",
        interrupted="interrupted"),
    Command("scenarios", "crinoid.cli.scenario_commands:scenarios",
        "List the built-in scenarios, copy one, or print their schema.",
        Option("--copy NAME", str, "Write a built-in scenario to NAME.toml, to change it.",
            complete=complete_name),
        Option("--schema", False, "Print the JSON schema of a scenario, for editors."),
        interrupted="interrupted"),
    Command("compare", "crinoid.cli.compare:compare_controllers",
        "Run a scenario under several controllers over several seeds, and compare them.",
        _SCENARIO,
        Option("--controllers KINDS", "none,pid",
            "Kinds of controllers, with commas between them.", check=_wrong_kinds),
        Option("--seeds", 10, "Number of seeds.", check=_POSITIVE),
        Option("--first-seed", 0, "The first one of them.",
            check=must("be at least 0", lambda seed: seed >= 0)),
        _SET, out("results/SCENARIO-compare"), _FORCE),
    Command("tune", "crinoid.cli.tune:tune_controller",
        "Tune a PID, LQG or MPC by gradient, over several seeds: each number by up to 1000 times.",
        _TEXT,
        Option("--seeds", 4, "Number of seeds that it is tuned for.", check=_POSITIVE),
        Option("--iterations", 25,
            "Largest number of trials of the best start; each start has half as many.",
            check=_POSITIVE),
        Option("--margin", 0.5, "Modulus margin that the loop is to keep; 0: none.",
            check=must("be at least 0 (no margin) and below 1", lambda margin: 0 <= margin < 1)),
        _SET, out("results/SCENARIO-tune"), _FORCE),
    Command("identify", "crinoid.cli.study_commands:identify",
        "Find stiffness, damping, drag and other numbers from recorded motions and holds.",
        _TEXT,
        _measured("a CSV or netCDF file with times or holds and places of the tip, a log of ROS, "
            "a result, or a TOML file of markers and experiments."),
        Option("--of KEY,KEY", str,
            "Keys of numbers to find, each within a factor of 10000: arm.length,arm.density.",
            required=True),
        _SET, out("results/SCENARIO-identify"), _FORCE),
    Command("estimate", "crinoid.cli.estimate:estimate_states",
        "Estimate tip, shape and current from a log, with their standard deviations.",
        _SCENARIO,
        _measured("a CSV or netCDF file with times, readings of the sensors and commands, a log "
            "of ROS, or a result."),
        _SET, out("results/SCENARIO-estimate"), _FORCE),
    Command("optimise", "crinoid.cli.study_commands:optimise",
        "Find the best numbers of arm, actuators, base or gains for a measure, within limits.",
        _TEXT,
        Option("--over KEY=FROM:TO", list[str],
            "Number to choose, and its range; with :log equal steps are equal ratios.",
            required=True),
        Option("--for MEASURE", str, "Measure to make least.", name="measure", required=True),
        Option("--keep MEASURE<VALUE", list[str], "Limit of a measure, in SI units."),
        Option("--seeds N", 1, "How many seeds each trial is run with.", check=_POSITIVE),
        Option("--trials N", 160, "Largest number of trials.", check=_POSITIVE),
        Option("--at-rest", False, "Judge the equilibrium at t = 0 instead of a run.", name="rest"),
        _SET, out("results/SCENARIO-optimise"), _FORCE),
    Command("report", "crinoid.cli.result_commands:report",
        "Draw the figures of a result, and write its page.",
        _RESULT,
        Option("--format FORMAT", "png",
            "Format of the figures: png, svg or pdf, which without --width is one document.",
            name="file_format"),
        Option("--width WIDTH", str,
            "Width of figures for a paper, without titles: 85mm, 8.5cm or 3.4in.",
            "for the screen"),
        out("next to the result"), interrupted="interrupted"),
    Command("export", "crinoid.cli.result_commands:export",
        "Write a result for ParaView (vtkhdf), spreadsheets (csv, xlsx), Blender (gltf), ROS 2 "
        "(mcap).\n\nIsaac Sim and Newton read usd. A policy that `crinoid train` wrote is written "
        "for a\nvehicle (onnx), a scenario for programs of co-simulation (fmu).",
        Option("RESULT", str,
            "A folder that `crinoid run` wrote, or a result in it; with fmu a scenario."),
        Option("--to FORMAT", str,
            "vtkhdf, csv, xlsx, gltf, mcap or usd; of a policy, onnx; of a scenario, fmu.",
            required=True),
        _SET,
        Option("--variables NAME,NAME", str,
            "Of a table: variables, such as tip_position,tip_error.",
            "all that are not along the arm"),
        Option("--nodes N,N", str,
            "Of a table: nodes or edges of variables along the arm; -1 is the last.", "all"),
        Option("--instants N", int, "Largest number of instants, evenly chosen.",
            "1501, in a table 1000000"),
        out("next to the result"), _FORCE, interrupted="interrupted"),
    Command("film", "crinoid.cli.result_commands:film",
        "Film a result: the arm moving, as an MP4 or a GIF.",
        _RESULT,
        Option("--to FILE", Path, "What to write: an MP4 or a GIF, by its ending.",
            "film.mp4 next to the result, without PyAV film.gif"),
        Option("--speed", float, "Simulated seconds in a second of film.",
            "1, unless it would be long or short"),
        Option("--from SECONDS", float, "Where it begins.", "all", name="begin"),
        Option("--until SECONDS", float, "Where it ends.", "all"),
        Option("--view", str, "From where: side, above, ahead or angle.", "side, in space angle"),
        Option("--azimuth DEGREES", float, "From anywhere: 0 ahead, -90 starboard."),
        Option("--elevation DEGREES", float, "From how far above."),
        Option("--zoom", 1.0, "How much larger than all that moves."),
        Option("--follow", str, "What stays in place: none, tip or base.",
            "none, unless the base travels far"),
        Option("--uncontrolled", str, "The run without control: ghost, beside or none.",
            "ghost, if any"),
        Option("--colour", str,
            "By what the arm is coloured: curvature, tension, speed, distance or none.",
            "curvature; none with a ghost"),
        Option("--size WxH", str, "In pixels.", "1280x720, a GIF 480x360"),
        Option("--fps", float, "Frames in a second.", "30, a GIF 15"),
        Option("--force", False, "Replace a file that is not a film of crinoid's."),
        interrupted="interrupted: no film is written"),
    Command("sweep", "crinoid.cli.study_commands:sweep",
        "Run a scenario with many values and seeds, on all cores or on a cluster.",
        _SCENARIO,
        Option("--vary KEY=VALUES", list[str],
            "What varies: FROM:TO:COUNT, FROM:TO:COUNT:log or A,B,C; with --sample also FROM:TO "
            "and FROM:TO:log. One component of a vector: flow.0.mean.1=0.05:0.3:6."),
        Option("--sample KIND", "grid",
            "How ranges without a count are filled: lhs, sobol or saltelli.", name="sampling"),
        Option("--count N", int,
            "How many points to sample; of saltelli, blocks of as many as keys and two."),
        Option("--seeds N", 1, "How many seeds to run each with, from seed on."),
        Option("--batch N", int, "Runs that are sent and saved together.",
            "up to 100, in 200 batches"),
        Option("--workers N", int, "Workers on this machine.", "one a core", check=_POSITIVE),
        Option("--scheduler ADDRESS", str,
            "Scheduler of dask.distributed whose workers are to run it.", "this machine"),
        Option("--weights FILE", Path,
            "Cases and shares of time, such as scatter.csv or histogram.csv of crinoid flow."),
        Option("--dry-run", False, "Estimate the cost, and write nothing."),
        _SET, out("results/SCENARIO-sweep"), resume("sweep"), _FORCE),
    Command("train", "crinoid.cli.study_commands:train",
        "Train a neural policy in simulation.",
        _SCENARIO,
        Option("--teacher KIND", "lqg", "Teacher of the imitation: lqg, mpc, pid or none.",
            check=must('be "lqg", "mpc", "pid" or "none"',
                lambda kind: kind in ("lqg", "mpc", "pid", "none"))),
        Option("--draw KEY=LOW:HIGH", list[str], "Key that each episode draws.",
            "stiffness, currents, sensor, tool"),
        Option("--arms N", 16, "Arms that are run at a time.", check=_POSITIVE),
        Option("--updates N", 1500, "Largest number of updates.",
            check=must("be at least 0", lambda count: count >= 0)),
        Option("--seed N", 0, "Seed of everything random.",
            check=must("be from 0 to 1000000", lambda seed: 0 <= seed <= 1_000_000)),
        _SET, out("results/SCENARIO-train"), resume("training"), _FORCE),
)
# fmt: on
GROUPS = {
    "Run": ("run", "live", "equilibrium"),
    "Analyse": ("modes", "margins", "linearise"),
    "Study and design": ("compare", "sweep", "tune", "optimise", "train"),
    "Records of the sea and of experiments": ("flow", "identify", "estimate"),
    "Results": ("report", "film", "export"),
    "Scenarios and installation": ("scenarios", "doctor"),
}
"""Names of commands, as help groups them."""
