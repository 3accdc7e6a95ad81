"""An arm in a steady current, with and without the vortices that it sheds, side by side as a GIF.

    python examples/lock_in.py [lock-in.gif]

The arm of `station-keeping-3d` without control in 0.2 m/s across it. Vortices lock in to its
first mode and shake it up and down, across arm and current. Prints the RMS motion of the tip.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import crinoid

SPEED = 0.2
"""Speed of the current (m/s)."""
NAMES = {"without vortices": None, "with vortices": {"model": "synchronisation"}}


def filmed(title: str, vortices: dict[str, str] | None, folder: Path) -> Image.Image:
    """Run the arm, film it, and return the film."""
    scenario = crinoid.load("station-keeping-3d").with_values(
        {
            "title": title,
            "flow": [{"kind": "uniform", "velocity": [0.0, SPEED, 0.0], "ramp_time": 2.0}],
            "control.kind": "none",
            "water.vortices": vortices,
            "simulation.duration": 20.0,
        }
    )
    result = crinoid.simulate(scenario)
    late = result.dataset["tip_position"].sel(time=slice(10.0, None))
    sideways, up = (1e3 * float(late.sel(axis=axis).std()) for axis in "yz")
    print(f"RMS motion of the tip: {sideways:.1f} mm along the current, {up:.1f} mm across")
    result.save(folder)
    command = ["crinoid", "film", str(folder), "--to", str(folder / "film.gif")]
    view = ["--from", "12", "--until", "18", "--azimuth", "-70", "--elevation", "10"]
    subprocess.run([*command, *view, "--size", "400x300"], check=True, stdout=subprocess.DEVNULL)
    return Image.open(folder / "film.gif")


def main(path: str = "lock-in.gif") -> None:
    """Film both arms and write them into one GIF."""
    with tempfile.TemporaryDirectory() as folder:
        films = [
            filmed(name, table, Path(folder) / str(number))
            for number, (name, table) in enumerate(NAMES.items())
        ]
        frames = []
        for number in range(min(film.n_frames for film in films)):
            for film in films:
                film.seek(number)
            both = np.hstack([np.asarray(film.convert("RGB")) for film in films])
            frames.append(Image.fromarray(both).quantize(128))
        frames[0].save(path, save_all=True, append_images=frames[1:], duration=1000 / 15, loop=0)
    print(f"wrote {path}")


if __name__ == "__main__":
    main(*sys.argv[1:])
