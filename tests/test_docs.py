"""The documentation: it is up to date, its links lead somewhere, its examples run."""

import ast
import importlib.util
import re
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

import crinoid
from crinoid import tables

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.glob("*.md")])

pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a language, but for files of the example package."""
    text = page.read_text("utf-8")
    own = re.sub(r"`examples/[\w/.-]+`:\n\n^```.*?^```", "", text, flags=re.M | re.S)
    return re.findall(rf"^```{language}\n(.*?)^```", own, re.M | re.S)


def slugs(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    prose = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.M | re.S)
    headings = re.findall(r"^#+ (.*)$", prose, re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize(
    "name",
    ["make_scenario_reference", "make_notes_page", "make_extending_page", "make_result_reference"],
)
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


@pytest.mark.parametrize("module", [crinoid, tables], ids=lambda module: module.__name__)
def test_every_public_name_is_in_the_reference(module):
    reference = "\n".join(page.read_text("utf-8") for page in (DOCS / "api").glob("*.rst"))
    listed = set(re.findall(r"^(?: {3}|\.\. auto\w+:: |``)(\w+)(?:``.*)?$", reference, re.M))
    held = {name for name, value in vars(module).items() if not isinstance(value, ModuleType)}
    public = getattr(module, "__all__", {name for name in held if not name.startswith("_")})
    assert set(public) <= listed


def test_every_page_is_in_the_site():
    written = {page.stem for page in DOCS.glob("*.md")} - {"index"}
    written |= {f"api/{page.stem}" for page in (DOCS / "api").glob("*.rst")}
    listed = re.findall(r"^[\w/]+$", (DOCS / "index.md").read_text("utf-8"), re.M)
    assert sorted(listed) == sorted(written)


@pytest.mark.parametrize(
    "page",
    [
        ROOT / "README.md",
        *(DOCS / f"{name}.md" for name in ("actuators", "extending", "parameters")),
    ],
    ids=lambda page: page.stem,
)
def test_examples_run(page):
    # under a name of their own: the shapes of their classes are not checked, as a user's are not
    names = {"__name__": "example"}
    for text in blocks(page, "python"):
        exec(compile(text, str(page), "exec"), names)


def test_every_part_has_its_line_on_its_floor():
    (contract, *_) = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"][
        "importlinter"
    ]["contracts"]
    floors = [
        {name.strip().removeprefix("crinoid.") for name in layer.split("|")}
        for layer in contract["layers"]
    ]
    source = ROOT / "src" / "crinoid"
    there = {path.stem for path in source.iterdir() if path.suffix == ".py"}
    there |= {path.parent.name for path in source.glob("*/__init__.py")}
    assert set().union(*floors) == there - {"__init__", "version"}
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    block = text.partition("## Floors")[2].split("```")[1]
    told: list[set[str]] = []
    for line in block.strip().splitlines():
        words = line.removeprefix("| ")
        if not line.startswith("| "):
            told.append(set())
        told[-1].add(words.split()[0])
        assert len(words.split()) > 1, line
    assert told == floors
