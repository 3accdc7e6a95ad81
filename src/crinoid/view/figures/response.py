"""Figure of a linear model: the response of the tip to each input over the frequency."""

import math

import xarray as xr
from matplotlib.figure import Figure

from crinoid.view.figures import style

_COLUMNS = 2
_FAINT = 1e-4
"""Size over the largest for an input below which a response is not drawn."""


def draw_response(data: xr.Dataset) -> Figure:
    """Draw the size of the response of the tip's coordinates to commands and current."""
    response = (data["response_real"] ** 2 + data["response_imaginary"] ** 2) ** 0.5
    names = [str(name) for name in data["input"].values if "acceleration" not in str(name)]
    rows = math.ceil(len(names) / _COLUMNS)
    figure = Figure(figsize=(style.WIDTH, 0.6 + 2.3 * rows), layout="constrained")
    style.head(figure, str(data.attrs.get("title", "")), "ok")
    grid = list(figure.subplots(rows, _COLUMNS, sharex=True, squeeze=False).flat)
    frequency = data["frequency"].values
    for axes, name in zip(grid, names, strict=False):
        sizes = response.sel(input=name)
        most = float(sizes.max())
        for output in data["output"].values:
            size = sizes.sel(output=output).values
            if size.max() > _FAINT * most:
                colour = style.AXIS_COLOURS[str(output).removeprefix("tip_")]
                axes.plot(frequency, size, color=colour, label=str(output))
        unit = str(sizes["input_unit"].values).replace(" s-1", "/s")
        per = "m" if unit == "1" else f"m per {unit}"
        axes.set(xscale="log", yscale="log", xlim=frequency[[0, -1]], ylabel=f"{name}\n({per})")
        if most > 0:
            axes.set_ylim(_FAINT * most, 2 * most)
        style.key(axes)
    for axes in grid[len(names) :]:
        axes.set_axis_off()
    figure.supxlabel("frequency (Hz)")
    return figure
