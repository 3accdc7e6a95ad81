"""Formats of export: a row for each, read before anything slow is loaded."""

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple

from crinoid.results.report_error import ReportError
from crinoid.scenario.errors import Mistake, ScenarioError, got, one_of, refusal


class Format(NamedTuple):
    """A format of export: its files, the sources that it accepts, its writer, and its limits.

    A writer receives its source (`crinoid.view.export.source`), the files to write and a report of
    progress, and returns notes. That of a scenario receives it, a folder and a name.
    """

    endings: tuple[str, ...]  # of its files, after the name of the source
    accepts: Literal["table", "shapes", "policy", "scenario"]
    writer: str  # "module:function" of this folder
    needs: tuple[str, ...] = ()  # its title, and the extra and modules of its library
    instants: int = 1501  # most by default: 30 s at 50 a second
    nodes: int | None = 201  # most of shapes, each of which becomes a bone; none: all


_ROWS = 1_000_000  # about the limit of spreadsheets
_LIBRARIES = {"mcap_ros2": "mcap-ros2-support", "pxr": "usd-core"}  # of other names than modules
FORMATS = {
    "vtkhdf": Format(
        (".vtkhdf", "-surroundings.vtkhdf"), "shapes", "vtkhdf:write_vtkhdf", nodes=None
    ),
    "csv": Format((".csv",), "table", "table:write_csv", instants=_ROWS),
    "xlsx": Format(
        (".xlsx",), "table", "workbook:write_xlsx", ("XLSX", "export", "xlsxwriter"), _ROWS
    ),
    "gltf": Format((".glb",), "shapes", "gltf:write_gltf", ("glTF", "export", "pygltflib")),
    "mcap": Format((".mcap",), "shapes", "ros:write_mcap", ("MCAP", "ros", "mcap_ros2", "rosbags")),
    "usd": Format((".usda",), "shapes", "usd:write_usd", ("USD", "usd", "pxr")),
    "onnx": Format((".onnx",), "policy", "network:write_onnx", ("ONNX", "export", "onnx")),
    "fmu": Format((".fmu",), "scenario", "fmu:write_fmu"),
}


def format_for(name: str, options: Mapping[str, object]) -> Format:
    """Return the format of a name, which must have a use for the given options."""
    if name not in FORMATS:
        near = get_close_matches(name.lower(), FORMATS, n=1)
        raise ScenarioError([Mistake("--to", got(name, f"be {one_of(FORMATS)}"), *near)])
    form = FORMATS[name]
    tables = " or ".join(each for each, row in FORMATS.items() if row.accepts == "table")
    for option, value in options.items():
        if isinstance(value, int) and value < 1:
            raise refusal(option, got(value, "be at least 1"))
        of_shapes = option == "--instants"
        if value is None or form.accepts == "table" or (of_shapes and form.accepts == "shapes"):
            continue
        need = "a result" if of_shapes or form.accepts == "scenario" else f"--to {tables}"
        raise refusal(option, f"needs {need}. Leave it out with --to {name}.")
    return form


def place_of(out: Path, form: Format, stem: str) -> tuple[Path, str]:
    """Return folder and stem of the files: ``out`` is a folder, or ends like the first file."""
    ending = form.endings[0]
    if not out.is_dir() and out.suffix in (ending, *(each.endings[0] for each in FORMATS.values())):
        if out.suffix != ending:
            raise refusal("--out", got(out.name, f"be a folder, or a name that ends in {ending}"))
        return out.parent, out.stem
    return out, stem


def writer_of(form: Format) -> Callable[..., Any]:
    """Load the writer of a format; a library that lacks is a `ReportError`."""
    module, _, function = form.writer.partition(":")
    try:
        found: Callable[..., Any] = getattr(import_module(f"{__package__}.{module}"), function)
    except ModuleNotFoundError as error:
        title, extra, *modules = form.needs or ("", "")
        if str(error.name).partition(".")[0] not in modules:
            raise
        library = " and ".join(_LIBRARIES.get(each, each) for each in modules)
        text = f'{title} is written by {library}: pip install "crinoid[{extra}]"'
        raise ReportError(text) from error
    return found


def exports_of(file: str) -> list[str]:
    """Return the names that the exports of a result or policy have."""
    forms = [form for form in FORMATS.values() if form.accepts != "scenario"]
    return [f"{Path(file).stem}{ending}" for form in forms for ending in form.endings]
