"""The commands on a result: report, export and film."""

from pathlib import Path
from typing import Annotated

import typer

from crinoid.cli.command import Force, Settings, one_line_errors, option, out_option, stop
from crinoid.cli.interruption import Interrupted, Interruption, Loading


@one_line_errors("interrupted")
def report(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="A folder that `crinoid run` wrote.")
    ],
    file_format: Annotated[
        str, option("Format of the figures: png, pdf or svg.", "FORMAT", name="--format")
    ] = "png",
    out: Annotated[Path | None, out_option("next to the result")] = None,
) -> None:
    """Draw the figures of a result, and write its page."""
    from crinoid.view.refusals import require_figures, require_path

    require_figures(file_format)
    require_path(result)
    with Loading():
        from crinoid.cli.display import say_written
        from crinoid.view.figures import write_report

    say_written(write_report(result, out, file_format=file_format))


@one_line_errors("interrupted")
def export(
    result: Annotated[
        str,
        typer.Argument(
            metavar="RESULT",
            help="A folder that `crinoid run` wrote, or a result in it; with fmu a scenario.",
        ),
    ],
    to: Annotated[
        str,
        option(
            "vtkhdf, csv, xlsx, gltf, mcap or usd; of a policy, onnx; of a scenario, fmu.",
            "FORMAT",
            default=False,
        ),
    ],
    settings: Settings = None,
    variables: Annotated[
        str | None,
        option(
            "Of a table: variables, such as tip_position,tip_error.",
            "NAME,NAME",
            default="all that are not along the arm",
        ),
    ] = None,
    nodes: Annotated[
        str | None,
        option(
            "Of a table: nodes or edges of variables along the arm; -1 is the last.",
            "N,N",
            default="all",
        ),
    ] = None,
    instants: Annotated[
        int | None,
        option(
            "Largest number of instants, evenly chosen.", "N", default="1501, in a table 1000000"
        ),
    ] = None,
    out: Annotated[Path | None, out_option("next to the result")] = None,
    force: Force = False,
) -> None:
    """Write a result for ParaView (vtkhdf), spreadsheets (csv, xlsx), Blender (gltf), ROS 2 (mcap).

    Isaac Sim and Newton read usd. A policy that `crinoid train` wrote is written for a
    vehicle (onnx), a scenario for programs of co-simulation (fmu).
    """
    from crinoid.cli.export import export_result, export_scenario

    if to == "fmu":
        unused = {"--variables": variables, "--nodes": nodes, "--instants": instants}
        export_scenario(result, settings, out, unused, force=force)
        return
    if settings:
        stop(f"--set: needs --to fmu. Leave it out with --to {to}.")
    path = Path(result)
    export_result(path, to, out, variables=variables, nodes=nodes, instants=instants, force=force)


@one_line_errors("interrupted: no film is written")
def film(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="A folder that `crinoid run` wrote.")
    ],
    to: Annotated[
        Path | None,
        option(
            "What to write: an MP4 or a GIF, by its ending.",
            "FILE",
            default="film.mp4 next to the result, without PyAV film.gif",
        ),
    ] = None,
    speed: Annotated[
        float | None,
        option(
            "Simulated seconds in a second of film.", default="1, unless it would be long or short"
        ),
    ] = None,
    begin: Annotated[
        float | None, option("Where it begins.", "SECONDS", name="--from", default="all")
    ] = None,
    until: Annotated[float | None, option("Where it ends.", "SECONDS", default="all")] = None,
    view: Annotated[
        str | None,
        option("From where: side, above, ahead or angle.", default="side, in space angle"),
    ] = None,
    azimuth: Annotated[
        float | None, option("From anywhere: 0 ahead, -90 starboard.", "DEGREES", default=False)
    ] = None,
    elevation: Annotated[
        float | None, option("From how far above.", "DEGREES", default=False)
    ] = None,
    zoom: Annotated[float, option("How much larger than all that moves.")] = 1.0,
    follow: Annotated[
        str | None,
        option(
            "What stays in place: none, tip or base.", default="none, unless the base travels far"
        ),
    ] = None,
    uncontrolled: Annotated[
        str | None,
        option("The run without control: ghost, beside or none.", default="ghost, if any"),
    ] = None,
    colour: Annotated[
        str | None,
        option(
            "By what the arm is coloured: curvature, tension, speed, distance or none.",
            default="curvature; none with a ghost",
        ),
    ] = None,
    size: Annotated[
        str | None, option("In pixels.", "WxH", default="1280x720, a GIF 480x360")
    ] = None,
    fps: Annotated[float | None, option("Frames in a second.", default="30, a GIF 15")] = None,
    force: Annotated[
        bool, option("Replace a file that is not a film of crinoid's.", name="--force")
    ] = False,
) -> None:
    """Film a result: the arm moving, as an MP4 or a GIF."""
    from crinoid.view.film.settings import CameraSettings, ending_of, size_of
    from crinoid.view.refusals import require_path

    camera = CameraSettings(
        fps=fps,
        speed=speed,
        begin=begin,
        until=until,
        size=None if size is None else size_of(size),
        view=view,
        azimuth=azimuth,
        elevation=elevation,
        zoom=zoom,
        follow=follow,
        uncontrolled=uncontrolled,
        colour=colour,
    )
    require_path(result)
    if to is not None:
        ending_of(to)
    with Loading():
        from crinoid.cli.display import progress_bar, say_notes, say_written
        from crinoid.view.film.encode import NO_ENCODER, has_encoder
        from crinoid.view.film.write import film_run

    if to is None and not has_encoder():
        say_notes([f"writes a GIF: {NO_ENCODER}"])
    with Interruption() as interruption, progress_bar() as bar:
        task = bar.task_ids[0]
        bar.reset(task, total=None, description="reading", reached="")

        def progress(done: int, count: int) -> None:
            if interruption.asked:  # a destructor or the like has lost the exception
                raise Interrupted
            text = f"{done} of {count} frames"
            bar.update(task, completed=done, total=count, description="drawing", reached=text)

        path, notes = film_run(result, to, camera, progress, force=force)
    say_notes(notes)
    say_written([path])
