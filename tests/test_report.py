"""The figures: they are written, they show something, and they refuse what is no result."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from PIL import Image, ImageChops

from crinoid.elements import WORKS
from crinoid.report import ReportError, write_report
from crinoid.report.arm import hull
from crinoid.report.charts.drive import drawn_in, drive_chart
from crinoid.report.page.file import PAGE
from crinoid.report.paper import draw_chart
from crinoid.report.run import Run
from crinoid.report.style import STYLE
from crinoid.variables import large_names, quantity
from made_results import of_values

FIGURES = [
    *("shape.png", "tip_error.png", "tip_path.png"),
    *("commands.png", "energy.png", "bending.png"),
]


def swaying_arm(
    *,
    records=201,
    duration=20.0,
    nodes=21,
    length=0.5,
    tilt_deg=0.0,
    sway=0.05,
    flow=0.2,
    gust=0.06,
    driven=True,
    moving_target=False,
    seed=0,
    status="ok",
):
    """Make a result that looks like an arm swaying in its first bending mode in a current."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, duration, records) if records > 1 else np.zeros(1)
    arc = np.linspace(0.0, length, nodes)
    edge = length / (nodes - 1)
    phases = rng.uniform(0, 2 * np.pi, 6)
    frequencies = np.array([0.11, 0.23, 0.41, 0.63, 0.9, 1.3])
    unsteady = sum(
        np.sin(2 * np.pi * f * time + p) / (1 + 2 * f)
        for f, p in zip(frequencies, phases, strict=True)
    )
    amplitude = sway * (0.4 + 0.6 * unsteady)
    slide = 0.3 * amplitude if driven else np.zeros_like(time)
    tilt = -0.8 * amplitude / length if driven else np.zeros_like(time)

    # Edge angles grow like those of a cantilever, so the arm keeps its length exactly.
    middle = (np.arange(nodes - 1) + 0.5) / (nodes - 1)
    mode = 3 * middle - 3 * middle**2 + middle**3
    angle = np.deg2rad(tilt_deg) + tilt[:, None] + 1.4 * amplitude[:, None] / length * mode
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    base = np.stack([slide, np.full_like(time, -10.0)], axis=-1)
    position = np.concatenate(
        [base[:, None], base[:, None] + edge * np.cumsum(tangent, axis=1)], axis=1
    )
    curvature = np.zeros((records, nodes))
    curvature[:, 1:-1] = np.diff(angle, axis=1) / edge

    def rate(values):
        return np.gradient(values, time, axis=0) if records > 1 else np.zeros_like(values)

    velocity = rate(position)
    tip = position[:, -1]
    target = np.broadcast_to(tip[0], tip.shape).copy()
    if moving_target:
        target += 0.04 * np.stack([np.sin(0.6 * time), np.cos(0.6 * time) - 1], axis=-1)
    current = np.zeros((records, nodes, 2))
    if flow:
        profile = 1 + 0.3 * arc / length
        current[..., 0] = flow * profile + gust * unsteady[:, None]
        current[..., 1] = 0.5 * gust * np.roll(unsteady, 7)[:, None]

    kinetic = 0.5 * 1.3 * edge * (velocity**2).sum(axis=(1, 2))
    elastic = 0.5 * 0.0126 * edge * (curvature**2).sum(axis=1)
    potential = 0.6 * edge * (position[..., 1] + 10.0).sum(axis=1)
    total = kinetic + elastic + potential
    works = np.zeros((records, len(WORKS)))
    works[:, 1] = -1e-4 * time
    works[:, 2] = 2e-3 * slide
    works[:, 4] = 1e-4 * unsteady - 1e-4 * unsteady[0]
    works[:, 0] = total - total[0] - works.sum(axis=1) - 1e-6 * time
    energy = np.concatenate([np.stack([kinetic, elastic, potential], axis=-1), works], axis=-1)
    pose = np.stack([slide, np.zeros_like(time), tilt], axis=-1)
    force = np.stack([0.2 + amplitude, -0.3 + 0.5 * amplitude], axis=-1)

    return of_values(
        2,
        time,
        arc,
        np.linspace(0.04, 0.03, nodes),
        position=position,
        velocity=velocity,
        acceleration=rate(velocity),
        tangent=tangent,
        curvature=curvature,
        tension=np.zeros((records, nodes - 1)),
        tip_position=tip,
        tip_target=target,
        tip_angle=angle[:, -1],
        tip_angle_target=np.full(records, angle[0, -1]),
        tip_error=np.linalg.norm(tip - target, axis=-1),
        base_command=np.roll(pose, -2, axis=0),
        base_pose=pose,
        base_force=force,
        base_moment=0.05 * amplitude,
        flow_velocity=current,
        energy=energy,
        newton_iterations=np.full(records, 2),
        steps=np.arange(records),
        residual=np.full(records, 1e-10),
    ).assign_attrs(
        title="Station keeping in a turbulent current",
        scenario=f"[base]\ntilt_deg = {tilt_deg:.1f}\n",
        crinoid_version="0.1.0",
        seed=seed,
        status=status,
        wall_time=1.0,
    )


def save(dataset, path: Path):
    path.parent.mkdir(parents=True, exist_ok=True)
    dataset.to_netcdf(path, engine="netcdf4")
    return path


def write_study(folder: Path, rows):
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "cases.csv").open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, fieldnames=list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def study_row(number, **changes):
    return {
        "case": f"case-{number:02d}",
        "arm.youngs_modulus": 1e5 * number,
        "flow.0.velocity": "[0.2, 0.0]",
        "deflection": 0.12 / number,
        "steady_error": 0.002 * number,
        "rms_error": 0.006 * number,
        "rms_error_uncontrolled": 0.03 + 0.01 * number,
        "settling_time": 2.0 + number,
        "status": "ok",
        "directory": f"case-{number:02d}",
    } | changes


def assert_is_a_page(path: Path):
    text = path.read_text("utf-8")
    assert text.endswith("</html>\n")
    assert len(text) < 3e6
    for part in ("table", "document"):
        begun = text.index(f'<script type="application/json" id="{part}">')
        json.loads(text[text.index(">", begun) + 1 : text.index("</script>", begun)])


def assert_shows_something(path: Path):
    if path.suffix == ".html":
        assert_is_a_page(path)
        return
    with Image.open(path) as opened:
        wide, high = np.divide(opened.size, opened.info["dpi"])
        pixels = opened.convert("RGB")
    assert 2.5 < wide < 20, path  # inches
    assert 1.5 < high < 30, path
    assert pixels.getcolors(50) is None, f"{path} holds no more than 50 colours"
    # of each pixel the darkest of red, green and blue
    darkest = ImageChops.darker(ImageChops.darker(*pixels.split()[:2]), pixels.split()[2])
    ink = sum(darkest.histogram()[:230]) / (pixels.width * pixels.height)
    assert 0.003 < ink < 0.6, f"{path}: {ink:.1%} of the paper is covered"


@pytest.fixture(autouse=True, scope="module")
def _coarse():
    """Draw with fewer dots: what is asserted does not depend on them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(STYLE, "savefig.dpi", 80)
        yield


def assert_report(folder: Path, **kwargs):
    written = write_report(folder, **kwargs)
    assert [path.name for path in written] == [*FIGURES, PAGE]
    for path in written:
        assert_shows_something(path)
    return written


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Folder and figures of a run without a comparison, drawn from its file into a folder."""
    path = save(swaying_arm(), tmp_path_factory.mktemp("alone") / "result.nc")
    return path, assert_report(path, out=path.parent / "b" / "c")


def test_figures_are_written_beside_the_result_and_show_the_uncontrolled_run(alone, tmp_path):
    save(swaying_arm(), tmp_path / "result.nc")
    save(swaying_arm(driven=False, sway=0.12), tmp_path / "uncontrolled.nc")
    compared = assert_report(tmp_path)
    assert {path.parent for path in compared} == {tmp_path}
    same = [a.read_bytes() == b.read_bytes() for a, b in zip(alone[1], compared, strict=True)]
    assert same == [False, False, False, True, True, False, False]


def test_figures_go_where_they_are_told_from_the_file_itself(alone):
    path, written = alone
    assert {figure.parent for figure in written} == {path.parent / "b" / "c"}
    assert [p.name for p in path.parent.iterdir() if p.is_file()] == ["result.nc"]


ODD = {
    "straight down": {"tilt_deg": -90.0},
    "straight up, nothing moves": {"tilt_deg": 90.0, "sway": 0.0, "flow": 0.0, "driven": False},
    "stopped after two records": {
        "records": 2,
        "duration": 0.02,
        "status": "stopped at 0.03 s: Newton did not converge in 20 iterations (residual 3.1e+04)",
    },
    "one record": {"records": 1, "duration": 0.0},
    "exactly on target, still water": {"sway": 0.0, "flow": 0.0},
    "nothing driven": {"driven": False},
    "long": {"records": 3000, "duration": 60.0},
    "moving target": {"moving_target": True},
    "two nodes": {"nodes": 2},
    "kilometre": {"length": 1000.0, "sway": 100.0},
    "millimetre": {"length": 1e-3, "sway": 1e-4},
}


@pytest.mark.parametrize(("length", "high"), [(0.5, 0.072), (100.0, 1.8)])
def test_the_bow_of_a_cable_is_that_of_a_submarine(length, high):
    bow = hull(swaying_arm(records=1, duration=0.0, length=length))
    assert np.ptp(bow.reshape(-1, 3), axis=0).max() == pytest.approx(high, rel=0.15)


@pytest.mark.parametrize("name", ODD)
def test_odd_runs_are_drawn(name, tmp_path):
    save(swaying_arm(**ODD[name]), tmp_path / "result.nc")
    assert_report(tmp_path)


OBSTACLES = """
[[obstacle]]
kind = "sphere"
position = [0.3, -9.9]
radius = 0.03
mass = 0.1
[[obstacle]]
kind = "cylinder"
position = [0.2, -10.1]
radius = 0.02
[[obstacle]]
kind = "cylinder"
position = [0.6, -10.0]
radius = 0.02
axis = [0.1, 0.0, 1.0]
[[obstacle]]
kind = "capsule"
position = [0.4, -10.2]
radius = 0.02
length = 0.1
axis = [1.0, 0.0, 1.0]
velocity = "flow"
[[obstacle]]
kind = "plane"
position = [0.0, -10.3]
normal = [0.1, 1.0]
"""


def among_obstacles(*, drift=0.01, touching=True, **changes):
    """Put one obstacle of each kind beside a swaying arm; all drift, the first two touch it."""
    dataset = swaying_arm(**changes)
    time = dataset["time"].values
    start = np.array([[0.3, -9.9], [0.2, -10.1], [0.6, -10.0], [0.4, -10.2], [0.0, -10.3]])
    place = start + drift * time[:, None, None] * np.array([0.3, 1.0])
    count, force = len(start), np.zeros((time.size, len(start), 2))
    if touching:
        force[time.size // 3 : time.size // 2, 0] = [0.5, 2.0]
        force[time.size // 2 :, 1, 1] = -1.0
    held = np.any(force != 0, axis=2)
    step = time[1] - time[0] if time.size > 1 else 0.0
    gap = np.where(held, 5e-4, 0.1) * np.ones(count)
    found = {
        "obstacle_position": place,
        "obstacle_velocity": np.full_like(place, drift),
        "contact_force": force,
        "contact_impulse": step * np.cumsum(force, axis=0),
        "contact_time": step * np.cumsum(held, axis=0),
        "contact_gap": gap,
        "contact_closest": np.minimum.accumulate(gap, axis=0),
    }
    found = {name: quantity(name, values, 2) for name, values in found.items()}
    return dataset.assign(found).assign_attrs(scenario=OBSTACLES)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"drift": 0.0},
        {"touching": False},
        {"records": 1, "duration": 0.0},
        {"tilt_deg": -80.0},
    ],
    ids=["drifting", "standing", "never touched", "one record", "hanging"],
)
def test_obstacles_are_drawn_and_so_are_their_contacts(changes, tmp_path):
    save(among_obstacles(**changes), tmp_path / "result.nc")
    written = write_report(tmp_path)
    assert [path.name for path in written] == [*FIGURES, "contact.png", PAGE]
    for path in written:
        assert_shows_something(path)


def test_obstacles_change_the_shapes_and_nothing_else_but_add_contacts(tmp_path):
    save(among_obstacles(), tmp_path / "result.nc")
    save(swaying_arm(driven=False), tmp_path / "uncontrolled.nc")  # of a run that had none
    among = [path.read_bytes() for path in write_report(tmp_path)]
    bare = among_obstacles().drop_dims("obstacle").assign_attrs(scenario=OBSTACLES)
    save(bare, tmp_path / "result.nc")
    without = [path.read_bytes() for path in write_report(tmp_path)]
    assert len(among) == len(without) + 1
    same = [a == b for a, b in zip(among, without, strict=False)]
    assert same == [False, True, True, True, True, True, False]


def test_a_title_is_text_and_no_formula(tmp_path):
    save(swaying_arm(records=5).assign_attrs(title="costs $x^$ and \\foo$"), tmp_path / "result.nc")
    assert_report(tmp_path)


def lines_of(axes):
    return {line.get_label(): line for line in axes.get_lines() if line.get_label()[:1] != "_"}


def test_prescribed_motion_does_not_look_like_a_servo_that_fails():
    made = swaying_arm()
    pose = made["base_pose"].copy()
    pose[:, 1] = 0.1 * np.sin(made["time"])  # heave is prescribed, slide both, tilt driven
    pose[:, 0] += 0.2
    run = Run(made.assign(base_servo=made["base_pose"], base_pose=pose))
    shifts, heaves, turns = (lines_of(axes) for axes in draw_chart(drive_chart(run), run).axes[:3])
    assert list(shifts) == ["slide", "slide as prescribed and driven", "commands"]
    np.testing.assert_allclose(shifts["slide"].get_ydata(), 1e3 * made["base_pose"][:, 0])
    assert list(heaves) == ["heave as prescribed"]
    assert list(turns) == ["tilt", "commands"]


def test_a_run_that_ends_in_nan_is_drawn_up_to_there(tmp_path):
    broken = swaying_arm(status="diverged at 18 s")
    for name in ("position", "tip_position", "tip_error", "energy", "base_force"):
        broken[name][180:] = np.nan
    save(broken, tmp_path / "result.nc")
    assert_report(tmp_path)


def test_a_result_of_shapes_alone_is_drawn(tmp_path):
    few = swaying_arm()[["position", "tip_position", "tip_target", "tip_error"]]
    save(few.drop_vars(["diameter", "arc_length"]), tmp_path / "result.nc")
    assert_report(tmp_path)


def test_a_study_is_drawn_with_each_of_its_cases(tmp_path):
    rows = [study_row(1), study_row(2, settling_time=""), study_row(3, status="diverged at 3 s")]
    write_study(tmp_path, rows)
    # the second meets obstacles
    for number, made in ((1, swaying_arm(sway=0.1)), (2, among_obstacles(sway=0.05))):
        save(made, tmp_path / f"case-{number:02d}" / "result.nc")
    written = write_report(tmp_path)
    names = [Path("case-01") / name for name in [*FIGURES, PAGE]]
    names += [Path("case-02") / name for name in [*FIGURES, "contact.png", PAGE]]
    drawn = [Path("cases.png"), *names, Path(PAGE)]
    assert [p.relative_to(tmp_path) for p in written] == drawn
    for path in written[:-1]:
        assert_shows_something(path)


def test_a_study_of_many_cases_has_a_page_and_no_figure(tmp_path):
    write_study(tmp_path, [study_row(n) for n in range(1, 101)])
    assert write_report(tmp_path) == [tmp_path / PAGE]


def test_a_study_of_which_nothing_is_left_is_drawn(tmp_path):
    empty = dict.fromkeys(
        ["deflection", "steady_error", "rms_error", "rms_error_uncontrolled", "settling_time"], ""
    )
    write_study(tmp_path, [study_row(1, status="diverged at 3 s", **empty)])
    assert write_report(tmp_path) == [tmp_path / "cases.png", tmp_path / PAGE]
    assert_shows_something(tmp_path / "cases.png")


def spoil_missing(path):
    path.unlink()


def test_variables_along_the_arm_may_be_left_out(tmp_path):
    names = [name for name in large_names(2) if name != "position"]
    bare = swaying_arm(records=21).drop_vars(names, errors="ignore")
    save(bare, tmp_path / "result.nc")
    assert_report(tmp_path)
    save(bare.drop_vars("position"), tmp_path / "none" / "result.nc")
    with pytest.raises(ReportError, match=r"output\.variables left out position") as caught:
        write_report(tmp_path / "none")
    assert "\n" not in str(caught.value)


def spoil_empty(path):
    path.write_bytes(b"")


def spoil_text(path):
    path.write_text("this is no netCDF")


def spoil_cut(path):
    path.write_bytes(path.read_bytes()[:5000])


def spoil_foreign(path):
    path.unlink()
    save(xr.Dataset({"temperature": ("time", [1.0])}, coords={"time": [0.0]}), path)


def spoil_no_records(path):
    path.unlink()
    save(swaying_arm().isel(time=slice(0, 0)), path)


def spoil_all_nan(path):
    path.unlink()
    dataset = swaying_arm()
    dataset["position"][:] = np.nan
    save(dataset, path)


def spoil_axes(path):
    path.unlink()
    save(swaying_arm().assign_coords(axis=["u", "v"]), path)


def spoil_dimensions(path):
    path.unlink()
    save(swaying_arm().rename(node="point"), path)


def spoil_obstacles(path):
    path.unlink()
    fewer = OBSTACLES.split("[[obstacle]]")
    save(among_obstacles(records=5).assign_attrs(scenario="[[obstacle]]".join(fewer[:-1])), path)


def spoil_order(path):
    path.unlink()
    save(swaying_arm(records=5).isel(time=slice(None, None, -1)), path)


def spoil_time(path):
    path.unlink()
    data = swaying_arm(records=5)
    save(data.assign_coords(time=np.where(data["time"] > 12.0, np.nan, data["time"])), path)


def spoil_axis(path):
    path.unlink()
    text = OBSTACLES.replace("[0.1, 0.0, 1.0]", "[0.1, 1.0]")
    save(among_obstacles(records=5).assign_attrs(scenario=text), path)


def spoil_normal(path):
    path.unlink()
    text = OBSTACLES.replace("[0.1, 1.0]", "[0.0, 0.0]")
    save(among_obstacles(records=5).assign_attrs(scenario=text), path)


def spoil_solid(path):
    path.unlink()
    save(
        among_obstacles(records=5).assign_attrs(scenario=OBSTACLES.replace("radius", "size")), path
    )


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (spoil_missing, "no result here"),
        (spoil_empty, "the file is empty"),
        (spoil_text, "not a readable netCDF file"),
        (spoil_cut, "not a readable netCDF file"),
        (spoil_foreign, "no variable 'position'"),
        (spoil_no_records, "holds no records"),
        (spoil_all_nan, "no record with a shape to draw"),
        (spoil_axes, "not labelled x and z"),
        (spoil_dimensions, "has dimensions"),
        (spoil_obstacles, "does not describe its obstacles"),
        (spoil_order, "its times do not rise"),
        (spoil_time, "its times do not rise"),
        (spoil_axis, r"does not describe its obstacles .*axis \[0.1, 1.0\]"),
        (spoil_normal, r"does not describe its obstacles .*normal \[0.0, 0.0\]"),
        (spoil_solid, "does not describe its obstacles .*radius"),
    ],
)
def test_what_is_no_result_is_refused_in_one_line(spoil, words, tmp_path):
    path = save(swaying_arm(records=5), tmp_path / "result.nc")
    spoil(path)
    with pytest.raises(ReportError, match=words) as caught:
        write_report(tmp_path)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)
    assert not list(tmp_path.glob("*.png"))


def test_a_path_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ReportError, match="no such file or directory"):
        write_report(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"case": "one"}, "lacks the column 'deflection'"),
        (study_row(1, rms_error="much"), "rms_error of case-01 is 'much', not a number"),
        (study_row(1, directory="../elsewhere"), "not a folder inside the study"),
    ],
)
def test_a_broken_table_of_cases_is_refused(row, words, tmp_path):
    write_study(tmp_path, [row])
    with pytest.raises(ReportError, match=words):
        write_report(tmp_path)


def test_a_table_of_others_does_not_hide_a_result(tmp_path):
    (tmp_path / "cases.csv").write_text("case,age\n1,34\n", encoding="utf-8")
    text = "cases.csv: not the table of a study of crinoid's, it lacks the column 'deflection'"
    for path in (tmp_path, tmp_path / "cases.csv"):
        with pytest.raises(ReportError, match=text):
            write_report(path)
    save(swaying_arm(), tmp_path / "result.nc")
    assert_report(tmp_path)


def test_an_empty_table_of_cases_is_refused(tmp_path):
    (tmp_path / "cases.csv").write_text(",".join(study_row(1)) + "\n", encoding="utf-8")
    with pytest.raises(ReportError, match="holds no case"):
        write_report(tmp_path)


def test_importing_the_report_loads_no_plotting():
    code = (
        "import sys, crinoid.report; sys.exit(any(m.startswith('matplotlib') for m in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_drawing_leaves_the_settings_of_the_caller_alone(tmp_path):
    save(swaying_arm(records=5), tmp_path / "result.nc")
    # in a process of its own, as other tests may have loaded pyplot
    code = """
import sys
from pathlib import Path
import matplotlib as mpl
from crinoid.report import write_report

def settings():  # asking for the backend would load one
    return {name: mpl.rcParams[name] for name in mpl.rcParams if name != "backend"}

before = settings()
write_report(Path(sys.argv[1]))
assert settings() == before
assert "matplotlib.pyplot" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True)


@pytest.mark.parametrize(
    ("unit", "most", "name", "drawn"),
    [
        ("1", 0.4, "share", 0.4),
        ("1", 7.2e-5, "10⁻⁵ of share", 7.2),
        ("1", 0.0, "share", 0.0),
        ("N", 7.2e-5, "µN", 72.0),
    ],
)
def test_small_drives_are_drawn_in_a_unit_that_the_label_names(unit, most, name, drawn):
    found = drawn_in(unit, most)
    assert found.name == name
    assert found.factor * most == pytest.approx(drawn)
