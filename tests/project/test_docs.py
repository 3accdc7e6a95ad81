"""The documentation: it is up to date, its links lead somewhere, its examples run."""

import ast
import re
from pathlib import Path
from types import ModuleType

import pytest

import crinoid
from crinoid import tables
from crinoid.inverse.experiments_file import Experiments
from crinoid.scenario.document import parse
from helpers.paths import ROOT
from helpers.scripts import load_script

DOCS = ROOT / "docs"


def source_pages() -> list[Path]:
    """Return the pages of the site, without what is built there."""
    return sorted(
        page
        for page in DOCS.rglob("*")
        if page.suffix in (".md", ".rst") and "_build" not in page.parts
    )


PAGES = sorted([*ROOT.glob("*.md"), *(page for page in source_pages() if page.suffix == ".md")])

pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)


def slugs(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    prose = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.M | re.S)
    headings = re.findall(r"^#+ (.*)$", prose, re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize(
    "name",
    [
        "make_notes_page",
        "make_result_reference",
        "make_command_reference",
        "make_pictures",
    ],
)
def test_tables_that_are_made_are_up_to_date(name):
    script = load_script(DOCS / f"{name}.py")
    text = script.PAGE.read_text("utf-8")
    assert script.updated(text) == text, f"run python docs/{name}.py"


def test_the_pages_of_scenario_keys_are_up_to_date():
    script = load_script(DOCS / "make_scenario_reference.py")
    for path, text in script.pages().items():
        assert path.read_text("utf-8") == text, "run python docs/make_scenario_reference.py"


@pages
def test_scenarios_links_and_tests_of_a_page_exist(page):
    for text in blocks(page, "toml"):
        if "[[experiment]]" in text:
            assert Experiments(**parse(text)).experiment
            continue
        assert len(crinoid.Scenario.from_toml(text).cases()) >= 1
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text("utf-8")):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        to = (page.parent / path).resolve() if path else page
        assert to.exists(), target
        assert not anchor or anchor in slugs(to), target
    for file, name in re.findall(r"(tests/[\w/]+\.py)::(\w+)", page.read_text("utf-8")):
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
    written = {page.relative_to(DOCS).with_suffix("") for page in source_pages()}
    listed = {Path("index")}
    for page in source_pages():
        text = page.read_text("utf-8")
        for names in re.findall(r"^```\{toctree\}\n(?::[^\n]*\n)*\n?(.*?)^```", text, re.M | re.S):
            for name in names.split():
                listed.add((page.parent / name).resolve().relative_to(DOCS))
    assert sorted(listed) == sorted(written)


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [
        "README.md",
        *(
            pytest.param(f"docs/how-to/{name}.md", marks=pytest.mark.release)
            for name in ("actuators", "extending", "linearise", "parameters")
        ),
    ],
)
def test_examples_run(page):
    # under a name of their own: the shapes of their classes are not checked, as a user's are not
    names = {"__name__": "example"}
    for text in blocks(ROOT / page, "python"):
        exec(compile(text, page, "exec"), names)


def test_the_map_of_folders_is_up_to_date():
    script = load_script(DOCS / "make_folder_map.py")
    assert script.page() == (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    for path, text in script.inits().items():
        assert path.read_text("utf-8") == text, "run python docs/make_folder_map.py"


def test_the_way_of_a_number_leads_through_what_is_there():
    lines = "".join(blocks(DOCS / "develop" / "architecture.md", "")).splitlines()
    assert len(lines) > 10
    for path, name, *_ in map(str.split, lines):
        source = (ROOT / "src" / "crinoid" / path).read_text("utf-8")
        assert re.search(rf"^(class|def) {name}\b", source, re.M), (path, name)
