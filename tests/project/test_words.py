"""The language of the source and its pages, and the names of its classes."""

import ast
import re
from collections import defaultdict

from helpers.paths import ROOT

SOURCE = sorted((ROOT / "src" / "crinoid").rglob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FINE = re.compile(
    r'takes(=| up| over| off|_in)|"(takes|told|begun|beside)"|told\.|of its own (type|kind)'
)
"""Uses of these words that are names, keys of files, or verbs of another meaning."""
TWICE = 5
"""Names that two classes may have, besides a table of a scenario and its object."""


def avoided() -> re.Pattern[str]:
    """Return the words of the table in CONTRIBUTING.md."""
    rows = (ROOT / "CONTRIBUTING.md").read_text("utf-8").partition("| Not | But |\n|---|---|\n")[2]
    left = [row.strip("| ").split(" | ")[0] for row in rows.partition("\n\n")[0].splitlines()]
    return re.compile(rf"\b({'|'.join(', '.join(left).split(', '))})\b", re.I)


def test_words_of_the_list_are_rare():
    pattern = avoided()
    assert pattern.search("got 3, takes 4")
    assert pattern.search("what it is")
    for paths, most in ((SOURCE, 1.0), (PAGES, 10.0)):
        lines = [
            (path.relative_to(ROOT), line)
            for path in paths
            for line in path.read_text("utf-8").splitlines()
        ]
        found = [
            f"{path}: {line.strip()}" for path, line in lines if pattern.search(FINE.sub("", line))
        ]
        assert 1000 * len(found) / len(lines) < most, "\n".join(found)


def test_few_names_are_those_of_two_classes():
    homes = defaultdict(list)
    for path in SOURCE:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes[node.name].append(path.relative_to(ROOT / "src" / "crinoid").parts[0])
    twice = {
        name: folders
        for name, folders in homes.items()
        if len(folders) > 2 or (len(folders) == 2 and "scenario" not in folders)
    }
    assert len(twice) <= TWICE, twice
