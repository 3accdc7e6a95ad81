"""The command `film`, and its options."""

from pathlib import Path
from typing import Annotated

import typer

from crinoid.cli.command import told
from crinoid.cli.interruption import Loading
from crinoid.cli.options import console, stop


@told("interrupted: no film is written")
def film(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="A folder that `crinoid run` wrote.")
    ],
    to: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="What to write: an MP4 or a GIF, by its ending.",
            show_default="film.mp4 beside the result, without PyAV film.gif",
        ),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(
            help="Simulated seconds in a second of film.",
            show_default="1, unless it would be long or short",
        ),
    ] = None,
    begin: Annotated[
        float | None,
        typer.Option("--from", metavar="SECONDS", help="Where it begins.", show_default="all"),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Where it ends.", show_default="all"),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(
            help="From where: side, above, ahead or angle.", show_default="side, in space angle"
        ),
    ] = None,
    azimuth: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES", help="From anywhere: 0 ahead, -90 starboard.", show_default=False
        ),
    ] = None,
    elevation: Annotated[
        float | None,
        typer.Option(metavar="DEGREES", help="From how far above.", show_default=False),
    ] = None,
    zoom: Annotated[float, typer.Option(help="How much larger than all that moves.")] = 1.0,
    follow: Annotated[
        str | None,
        typer.Option(
            help="What stays in place: none, tip or base.",
            show_default="none, unless the base travels far",
        ),
    ] = None,
    uncontrolled: Annotated[
        str | None,
        typer.Option(
            help="The run without control: ghost, beside or none.", show_default="ghost, if any"
        ),
    ] = None,
    colour: Annotated[
        str | None,
        typer.Option(
            help="By what the arm is coloured: curvature, tension, speed, distance or none.",
            show_default="curvature; none with a ghost",
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="In pixels.", show_default="1280x720, a GIF 480x360"),
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option(help="Frames in a second.", show_default="30, a GIF 15"),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace a file that is not a film of crinoid's.")
    ] = False,
) -> None:
    """Film a result: the arm moving, as an MP4 or a GIF."""
    with Loading():
        from crinoid.cli.filming import film_result
        from crinoid.report import ReportError
        from crinoid.report.film.shot import Shot, size_of

    try:
        shot = Shot(
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
        film_result(result, to, shot, force=force, console=console)
    except ReportError as error:
        stop(str(error))
