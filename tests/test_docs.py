"""The documentation: it is up to date, its links lead somewhere, its examples run."""

import ast
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import crinoid

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.glob("*.md")])

pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)


def slugs(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    prose = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.M | re.S)
    headings = re.findall(r"^#+ (.*)$", prose, re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("name", ["make_scenario_reference", "make_notes_page"])
def test_tables_that_are_made_are_up_to_date(name):
    path = DOCS / f"{name}.py"
    spec = importlib.util.spec_from_file_location(path.stem, path)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    text = script.PAGE.read_text("utf-8")
    assert script.updated(text) == text, f"run python docs/{name}.py"


@pages
def test_scenarios_in_the_text_are_valid(page):
    for text in blocks(page, "toml"):
        scenario = crinoid.Scenario.from_toml(text)
        assert len(scenario.cases()) >= 1


@pages
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text("utf-8")):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        to = (page.parent / path).resolve() if path else page
        assert to.exists(), target
        assert not anchor or anchor in slugs(to), target


@pages
def test_tests_in_the_text_exist(page):
    for file, name in re.findall(r"(tests/\w+\.py)::(\w+)", page.read_text("utf-8")):
        defined = ast.parse((ROOT / file).read_text("utf-8")).body
        assert name in {node.name for node in defined if isinstance(node, ast.FunctionDef)}, name


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", DOCS / "extending.md", DOCS / "parameters.md"],
    ids=lambda page: page.stem,
)
def test_examples_run(page):
    # under a name of their own: the shapes of their classes are not checked, as a user's are not
    names = {"__name__": "example"}
    for text in blocks(page, "python"):
        exec(compile(text, str(page), "exec"), names)


EXTENDED = """
import jax.numpy as jnp
import numpy as np

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.control import Integral
from crinoid.simulation.setup import set_up

scenario = crinoid.Scenario.from_dict({
    "arm": {"nodes": 5, "length": 0.5, "section": {"EI": 0.01, "EA": 1e4}},
    "water": {"density": 0.0, "gravity": 0.0},
    "base": {"channels": {"slide": {}, "heave": {}}},
    "load": [{"kind": "tether", "anchor": [0.5, -9.999], "stiffness": 0.06}],
    "flow": [{"kind": "wash", "velocity": [0.5, 0.0], "centre": -10.0, "width": 0.2}],
    "control": {"kind": "integral", "integral": {"rate": 0.5}},
})
loop, state, outcome, *_ = set_up(Prepared(scenario))
assert outcome.converged
# the spring lifts a cantilever: k h / (k + 3 EI / L^3)
rise = float(state.position[-1, 1])
np.testing.assert_allclose(rise, 0.06e-3 / (0.06 + 0.03 / 0.5**3), rtol=5e-3)
np.testing.assert_allclose(state.flow_velocity[1], [0.5, 0.0], rtol=1e-12)
assert isinstance(loop.controller, Integral)
"""


def test_a_contributor_who_follows_the_page_ends_with_a_scenario_that_runs(tmp_path):
    page = (DOCS / "extending.md").read_text("utf-8")
    package = tmp_path / "crinoid"
    shutil.copytree(ROOT / "src" / "crinoid", package, ignore=shutil.ignore_patterns("__pycache__"))
    common = ""
    for name, code in re.findall(r"`(\w+/\w+\.py)`:\n\n```python\n(.*?)^```", page, re.M | re.S):
        # what the page imports for one class it does not import again for the next
        imports = "".join(re.findall(r"^(?:from|import) .*\n", code, re.M))
        common += imports
        (package / name).write_text(common + code)
    for name, hunk in re.findall(r"^```diff\n--- (\S+)\n(.*?)^```", page, re.M | re.S):
        lines = hunk.splitlines(keepends=True)
        before, after = ("".join(x[1:] for x in lines if x[0] in kept) for kept in (" -", " +"))
        if not before.strip():
            raise AssertionError(f"{name}: a hunk without a line that says where it goes")
        text = (package / name).read_text("utf-8")
        assert text.count(before) == 1, f"{name}: {text.count(before)} places for\n{before}"
        (package / name).write_text(text.replace(before, after), "utf-8")
    subprocess.run(
        [sys.executable, "-c", EXTENDED],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        check=True,
        timeout=300,
    )
