"""Make the pictures and films of the site, and the gallery of them.

    python docs/make_pictures.py [NAME ...]    # all, or some; in half an hour on two cores
    python docs/make_pictures.py --page        # docs/gallery.md only

Pictures go to `docs/images`, in 256 colours. Not made here: `training.png`, `live.png`, `study.png`
and `environment.png`, whose pages say how, and those of `validation.page` and
`benchmarks.page`. `tests/project/test_docs.py` compares the gallery.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from PIL import Image

DOCS = Path(__file__).parent
PAGE = DOCS / "gallery.md"
IMAGES = DOCS / "images"
BEGIN, END = "<!-- pictures: begin -->", "<!-- pictures: end -->"


CARD = """:::::{{grid-item-card}}
:class-card: picture

```{{image}} images/{0.name}
:alt: {0.shows}
```

{0.shows}

::::{{dropdown}} Commands
```
{1}
```
::::
:::::

"""


class Picture(NamedTuple):
    """A picture: its file, the sentence under it, the commands, and the file that they write."""

    name: str
    shows: str
    commands: tuple[str, ...]
    made: str
    shown: bool = True
    """Whether it is in the gallery."""


def _report(name: str, scenario: str, shows: str, made: str = "shape.png") -> Picture:
    return Picture(
        name, shows, (f"crinoid run {scenario} --out x", "crinoid report x"), f"x/{made}"
    )


def _film(name: str, scenario: str, shows: str, options: str) -> Picture:
    film = f"crinoid film x --to {name} --uncontrolled beside {options}"
    return Picture(name, shows, (f"crinoid run {scenario} --out x", film), name)


def _blocks(page: str, title: str) -> str:
    """Return the scenario of a page of `docs/how-to` by its title."""
    text = (DOCS / "how-to" / page).read_text("utf-8")
    found = re.findall(r"^```toml\n(.*?)^```", text, re.M | re.S)
    return next(each for each in found if f'"{title}"' in each)


FILES = {
    "tendon.toml": ("equilibrium.md", "A tendon with friction"),
    "column.toml": ("equilibrium.md", "A column beyond its buckling load"),
}
"""Scenarios that commands name, by page and title."""

NOISE = "--set sensor.noise_position=0.001 --set sensor.noise_angle_deg=0.1"
WRONG = (
    "--set arm.youngs_modulus=2.5e5 --set arm.damping_time=0.1 --set water.drag_normal=0.7 "
    "--set chamber.0.area=1.6e-4"
)

PICTURES = (
    _film(
        "station-keeping.gif",
        "station-keeping",
        "An upright arm holds its tip in a swell; without control it sways.",
        "--from 6 --until 18 --size 640x400",
    ),
    _film(
        "floating-3d.gif",
        "floating-3d",
        "A BlueROV2 rides in the swell; its arm holds the tip.",
        "--from 6 --until 18 --size 448x280 --fps 5",
    ),
    _film(
        "reach-under-load.gif",
        "reach-under-load",
        "A neural policy brings a load to a target.",
        "--until 4 --size 640x400",
    ),
    Picture(
        "lock-in.gif",
        "An arm in a steady current, without and with shed vortices.",
        ("python examples/lock_in.py lock-in.gif",),
        "lock-in.gif",
    ),
    _report("octopus.png", "octopus", "A bend travels down the arm, chamber by chamber."),
    _report("trace.png", "trace", "Base and chambers trace a circle in a cross current."),
    _report("swing-up.png", "swing-up", "An arm too heavy to stand is swung up and balanced."),
    _report("wave-zone.png", "wave-zone", "The arm below waves, with and without control."),
    _report("debris-strike.png", "debris-strike", "Balls drift into the arm."),
    Picture(
        "ship-wake.png",
        "A launch passes an arm: its wake, and the surface at the arm.",
        ("python examples/ship_wake.py ship-wake.png",),
        "ship-wake.png",
    ),
    _report("ship-motion.png", "ship-motion", "The arm below a ship, with and without control."),
    Picture(
        "buoy-sea.png",
        "The surface at a buoy, as measured and as computed.",
        ("crinoid flow buoy-sea --out x",),
        "x/waves.png",
    ),
    _report("ship-rao.png", "ship-rao", "The arm below the bow of a ship that waves move."),
    _report("station-keeping-3d.png", "station-keeping-3d", "In space, across a swell."),
    _report("reef.png", "reef", "An arm rests on a rock, and holds its tip in a swell."),
    _report("spiral.png", "spiral", "A coil that was pulled straight winds up.", "bending.png"),
    Picture(
        "compare.png",
        "Ten draws of the turbulence under four controllers.",
        ("crinoid compare station-keeping --controllers none,pid,lqg,mpc --seeds 10 --out x",),
        "x/compare.png",
    ),
    Picture(
        "means.png",
        "Error over stiffness and swell, means over ten seeds.",
        (
            "crinoid sweep station-keeping --vary arm.youngs_modulus=3e5,1e6 "
            "--vary flow.0.amplitude.0=0.15:0.35:3 --seeds 10 --set simulation.duration=4 --out x",
        ),
        "x/means.png",
    ),
    Picture(
        "nyquist.png",
        "Eigenvalues of a loop, with the circle that none enters.",
        ("crinoid margins station-keeping --out x",),
        "x/nyquist.png",
    ),
    Picture(
        "bode.png",
        "Size and phase of the eigenvalues of a loop.",
        ("crinoid margins station-keeping --out x",),
        "x/bode.png",
        shown=False,
    ),
    Picture(
        "curl-curve.png",
        "Bend over the pressure of a chamber.",
        ("crinoid equilibrium curl --vary chamber.0.pressure=0:5e4:21 --out x",),
        "x/curve.png",
    ),
    Picture(
        "tendon-hysteresis.png",
        "Bend over the tension of a tendon with friction, and back.",
        ("crinoid equilibrium tendon.toml --vary tendon.0.tension=0:5:21 --out x",),
        "x/curve.png",
    ),
    Picture(
        "snap-through.png",
        "A buckled column snaps, at another load on the way back.",
        ("crinoid equilibrium column.toml --vary load.0.force.1=0.05:-0.05:41 --out x",),
        "x/curve.png",
    ),
    Picture(
        "identify.png",
        "A tip as measured, with wrong and with identified parameters.",
        (
            "crinoid run bend-test --out measured",
            "crinoid identify bend-test measured --of arm.youngs_modulus,arm.damping_time,"
            f"water.drag_normal,chamber.0.area {WRONG} --out x",
        ),
        "x/identify.png",
    ),
    Picture(
        "estimate.png",
        "Tip and current: true, estimated, and the band of two standard deviations.",
        (
            "crinoid run station-keeping --set control.kind=lqg --set simulation.duration=15 "
            f"{NOISE} --set output.interval=0.01 --out x",
            "crinoid report x",
        ),
        "x/estimate.png",
    ),
    Picture(
        "optimise.png",
        "Trials of a search over taper, chamber and pressure.",
        (
            "crinoid optimise reach-pressure --at-rest --for max_pressure --keep 'max_error<0.002' "
            "--over arm.radius.1=0.008:0.02 --over chamber.0.offset.0=0.004:0.012 "
            "--over chamber.0.offset.1=0.003:0.008 --over chamber.0.area=5e-5:1.5e-4 "
            "--over chamber.0.max_pressure=2e4:3e5 --out x",
        ),
        "x/optimise.png",
    ),
    Picture(
        "response.png",
        "Response of a tip to commands and current.",
        ("crinoid linearise station-keeping --out x",),
        "x/response.png",
    ),
)


def gallery() -> str:
    """Return a card for each picture, with the commands that make it."""
    cards = (CARD.format(each, "\n".join(each.commands)) for each in PICTURES if each.shown)
    return f"::::::{{grid}} 1 1 2 2\n:gutter: 3\n\n{''.join(cards)}::::::"


def updated(text: str) -> str:
    """Return a page with its pictures renewed."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{gallery()}\n\n{END}{after}"


def make(picture: Picture, folder: Path) -> None:
    """Run the commands of a picture, and put it into `docs/images`."""
    for name, (page, title) in FILES.items():
        (folder / name).write_text(_blocks(page, title), "utf-8")
    for command in picture.commands:
        program, *rest = shlex.split(command)
        if program == "crinoid":
            line = [sys.executable, "-m", "crinoid", *rest]
        else:
            script, *rest = rest
            line = [sys.executable, str(DOCS.parent / script), *rest]
        env = os.environ | {
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        }
        subprocess.run(line, cwd=folder, env=env, check=True, stdout=subprocess.DEVNULL)
    made = folder / picture.made
    if made.suffix == ".png":
        with Image.open(made) as image:
            image.convert("RGB").quantize(256).save(IMAGES / picture.name, optimize=True)
    else:
        (IMAGES / picture.name).write_bytes(made.read_bytes())


def main(names: list[str]) -> None:
    """Make pictures, all without names, and the gallery."""
    PAGE.write_text(updated(PAGE.read_text("utf-8")), "utf-8")
    if names == ["--page"]:
        return
    if unknown := set(names) - {each.name for each in PICTURES}:
        raise SystemExit(f"no picture {', '.join(sorted(unknown))}")
    failed = []
    for picture in PICTURES:
        if names and picture.name not in names:
            continue
        start = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            try:
                make(picture, Path(folder))
            except (OSError, subprocess.CalledProcessError) as error:
                failed.append(f"{picture.name}: {error}")
        print(f"{picture.name:24} {time.perf_counter() - start:5.0f} s", flush=True)
    if failed:
        raise SystemExit("\n".join(failed))


if __name__ == "__main__":
    main(sys.argv[1:])
