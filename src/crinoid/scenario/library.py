"""Scenarios from files, and the built-in ones."""

import os
from collections.abc import Mapping, Sequence
from copy import deepcopy
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any

from crinoid.scenario.document import anchor, assign, named_files, override, parse
from crinoid.scenario.errors import Mistake, ScenarioError, got, refusal
from crinoid.scenario.scenario import Scenario

Source = Scenario | str | os.PathLike[str]
"""A scenario, the name of a built-in one, or the path of a TOML file."""

_LIBRARY = files("crinoid.scenario") / "library"
_FOLDER = Path(str(_LIBRARY))


def load(
    name_or_path: str | os.PathLike[str], overrides: Sequence[str] | Mapping[str, Any] = ()
) -> Scenario:
    """Load a scenario.

    A relative path in the file starts from its folder, one in an override from the working
    directory; the scenario has it absolute.

    Parameters
    ----------
    name_or_path : str or path
        Name of a built-in scenario, or path to a TOML file. A built-in one goes first; write
        ``./name`` for a file of the same name.
    overrides : list of str, or dict
        Changes ``key=value``, as in ``--set`` of the command line: the key is dotted, with indexes
        into lists (``load.0.magnitude``), the value is TOML; words need no quotes. Or values by
        such keys: ``{"arm.length": 0.6}``.

    Returns
    -------
    Scenario

    Raises
    ------
    ScenarioError
        If there is no such scenario or anything in it is wrong, with one line per mistake.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> scenario.arm.nodes, scenario.simulation.duration
    (5, 0.2)
    """
    return ScenarioText(name_or_path, overrides).scenario


class ScenarioText:
    """Text of a scenario file or of a built-in scenario, in which numbers can change.

    The arguments are those of `load`.
    """

    def __init__(
        self,
        name_or_path: str | os.PathLike[str],
        overrides: Sequence[str] | Mapping[str, Any] = (),
    ) -> None:
        name = os.fspath(name_or_path)
        built_in = name in builtin_names()
        self._text = builtin_text(name) if built_in else _read(Path(name))
        try:
            document = parse(self._text)
        except ScenarioError as error:
            raise ScenarioError(mistake.under(name) for mistake in error.mistakes) from None
        anchor(document, _FOLDER if built_in else Path(name).absolute().parent)
        if isinstance(overrides, str):
            raise refusal("overrides", got(overrides, "be a list of key=value, or a table"))
        if isinstance(overrides, Mapping):
            for key, value in overrides.items():
                assign(document, key, value)
        else:
            for setting in overrides:
                override(document, setting)
        self._document = document
        self.scenario = Scenario.from_dict(document)  # the scenario, with the overrides

    def with_values(self, values: Mapping[str, Any], comment: str) -> str:
        """Return the text with the overrides and other values, by dotted key.

        The file's comments stay, and another one is the first line. The text reads back as the
        scenario with these values. Names of files in it are absolute, as it may move elsewhere.
        """
        import tomlkit  # slow to load, and few need it

        wanted, meant = deepcopy(self._document), self.scenario.with_values(values)
        for key, value in values.items():
            assign(wanted, key, value)
        written = tomlkit.parse(self._text)
        _change(written, wanted)
        text = tomlkit.dumps(written)
        try:
            same = Scenario.from_toml(text) == meant
        except ScenarioError:
            same = False
        # better without comments than another scenario
        return f"# {comment}\n\n{text if same else meant.to_toml()}"


def _change(old: Any, new: Any) -> None:
    """Change a table or list of a document, in place, to one of plain values."""
    keys = range(len(old)) if isinstance(old, list) else list(old)
    for key in keys:
        if isinstance(old, dict) and key not in new:
            del old[key]
        elif _alike(old[key], new[key]):
            _change(old[key], new[key])
        elif old[key] != new[key]:
            old[key] = new[key]
    if isinstance(old, dict):
        for key in [key for key in new if key not in old]:
            old[key] = new[key]


def _alike(old: Any, new: Any) -> bool:
    """Return whether both are tables, or lists of one length."""
    if isinstance(old, list) and isinstance(new, list):
        return len(old) == len(new)
    return isinstance(old, dict) and isinstance(new, dict)


def scenario_of(source: object) -> Scenario:
    """Return a scenario, or load the one with a name or a path."""
    if isinstance(source, Scenario):
        return source
    if isinstance(source, (str, os.PathLike)):
        return load(source)
    must = "be a Scenario, the name of a built-in one, or the path of a TOML file"
    raise refusal("scenario", got(source, must))


def builtin_names() -> list[str]:
    """Return the names of the built-in scenarios, sorted."""
    names = (entry.name for entry in _LIBRARY.iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def builtin_text(name: str) -> str:
    """Return the TOML text of a built-in scenario, with its comments."""
    if name not in builtin_names():
        raise ScenarioError([_not_found(name, "no such built-in scenario")])
    return (_LIBRARY / f"{name}.toml").read_text(encoding="utf-8")


def builtin_files(name: str) -> list[Path]:
    """Return the files that a built-in scenario names."""
    return [_FOLDER / file for file in named_files(parse(builtin_text(name)))]


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        mistake = _not_found(str(path), "no such file or built-in scenario")
    except IsADirectoryError:
        mistake = Mistake(str(path), "is a folder; must be a TOML file")
    except UnicodeDecodeError as error:
        mistake = Mistake(str(path), f"not valid TOML: byte {error.start} is not UTF-8")
    except OSError as error:
        mistake = Mistake(str(path), f"cannot be read: {error.strerror}")
    raise ScenarioError([mistake])


def _not_found(name: str, text: str) -> Mistake:
    near = get_close_matches(name.removesuffix(".toml"), builtin_names(), n=3)
    if near:
        return Mistake(name, text, " or ".join(near))
    return Mistake(name, f"{text}. `crinoid scenarios` lists the built-in ones.")
