"""Measured currents in text, as services, instruments and spreadsheets write them."""

import numpy as np
import pytest

from helpers.styles import (
    DEPTHS,
    EAST_NORTH,
    PROFILE,
    Played,
    Refused,
    Z,
    by_keys,
    by_proposal,
    check_keys,
    check_proposal,
    dates,
    over,
    since,
    speed_and_direction,
    straight,
    turning,
)

ISO = "%Y-%m-%dT%H:%M:%SZ"
WITH_SPEED = {"speed": "spd", "direction": "dir", "heading_deg": 90.0}


def text(path, head, rows, separator=",", end="\n", encoding="utf-8"):
    """Write a head and rows of cells."""
    lines = [*head, *(separator.join(map(str, row)) for row in rows)]
    path.write_bytes((end.join(lines) + end).encode(encoding))
    return path


def levels(times):
    """Return rows of a time, a depth, and the current toward east and north."""
    east, north = over(straight, Z)
    return [
        (time, depth, f"{east[k, i]:.3f}", f"{north[k, i]:.3f}")
        for k, time in enumerate(times)
        for i, depth in enumerate(DEPTHS)
    ]


def points(times, decimal="."):
    """Return rows of a time and the current toward east and north."""
    east, north = (each[:, 0] for each in over(straight, count=len(times)))
    values = [(f"{u:.3f}".replace(".", decimal), f"{v:.3f}".replace(".", decimal))
              for u, v in zip(east, north, strict=True)]  # fmt: skip
    return [(time, *value) for time, value in zip(times, values, strict=True)]


# --- ERDDAP --------------------------------------------------------------------------------------


def erddap_csv(folder):
    """Tabledap `.csv`: names, units, rows; a text column has no unit."""
    head = [
        "station,time,latitude,longitude,depth,u,v,temperature,salinity,qc",
        ",UTC,degrees_north,degrees_east,m,m s-1,m s-1,degree_C,PSU,1",
    ]
    rows = [
        ("M1", time, 36.75, -122.03, *rest, 11.2, 33.5, 1) for time, *rest in levels(dates(ISO))
    ]
    return text(folder / "mooring_a1b2_c3d4.csv", head, rows)


def erddap_knots(folder):
    head = ["time,spd,dir,water_temperature", "UTC,knots,degrees_true,degree_C"]
    speed, direction = (each[:, 0] for each in over(speed_and_direction))
    knots = speed / (1852 / 3600)
    rows = [
        (t, f"{s:.9f}", f"{d:g}", 11.25)
        for t, s, d in zip(dates(ISO), knots, direction, strict=True)
    ]
    return text(folder / "ports_cb0102.csv", head, rows)


def erddap_csvp(folder):
    """Tabledap `.csvp`: one line of names with units."""
    head = ["time (UTC),depth (m),u (m s-1),v (m s-1)"]
    return text(folder / "mooring_5e6f.csv", head, levels(dates(ISO)))


def erddap_csv0(folder):
    """Tabledap `.csv0`: rows without names."""
    return text(folder / "mooring_7a8b.csv", [], levels(dates(ISO)))


def erddap_tsv(folder):
    head = ["time\tdepth\tu\tv", "UTC\tm\tm s-1\tm s-1"]
    return text(folder / "mooring_9c0d.tsv", head, levels(dates(ISO)), "\t")


def ioos_csv(folder):
    """Sensors of IOOS: standard names, with the aggregate of the QARTOD tests."""
    names = "eastward_sea_water_velocity", "northward_sea_water_velocity"
    head = [
        ",".join(("time", "z", *names, *(f"{name}_qc_agg" for name in names))),
        "UTC,m,m.s-1,m.s-1,,",
    ]
    rows = [[time, -depth, *rest, 1, 1] for time, depth, *rest in levels(dates(ISO))]
    rows[4][2], rows[4][4] = "1.75", 4
    return text(folder / "edu_humboldt_tdp.csv", head, rows)


# --- NDBC ----------------------------------------------------------------------------------------


def ndbc_meteorological(folder):
    """Realtime standard meteorological data: newest first, MM for a missing value."""
    head = [
        "#YY  MM DD hh mm WDIR WSPD GST  WVHT   DPD   APD MWD   PRES  ATMP  WTMP  DEWP  VIS PTDY  "
        "TIDE",
        "#yr  mo dy hr mn degT m/s  m/s     m   sec   sec degT   hPa  degC  degC  degC  nmi  hPa  "
        "  ft",
    ]
    speed, direction = (each[:, 0] for each in over(speed_and_direction, count=5))
    rows = [
        f"{time} {(d + 180) % 360:.0f} {10 * s:4.1f}  6.0   1.1     7   5.2 290 1013.5  11.0  11.4"
        "   9.0   MM   MM    MM"
        for time, s, d in zip(dates("%Y %m %d %H %M", count=5), speed, direction, strict=True)
    ]
    rows[2] = rows[2][:17] + "MM  " + "  MM" + rows[2][25:]
    return text(folder / "46042.txt", head, ([row] for row in rows[::-1]))


def ndbc_adcp(past):
    """Return what writes currents by a profiler.

    Realtime: newest first, a row may end early. Past years: oldest first, 999 for a missing value.
    """

    def write(folder):
        head = [
            "#YY  MM DD hh mm " + " ".join(f"DEP{i:02d} DIR{i:02d} SPD{i:02d}" for i in (1, 2, 3)),
            "#yr  mo dy hr mn " + " ".join(["    m  degT  cm/s"] * 3),
        ]
        speed, direction = over(speed_and_direction, Z)
        rows = []
        for k, time in enumerate(dates("%Y %m %d %H %M")):
            cells = [
                f"{depth:6.1f} {direction[k, i]:5.0f} {100 * speed[k, i]:5.1f}"
                for i, depth in enumerate(DEPTHS)
            ]
            if k == 1:
                cells[2:] = [f"{DEPTHS[2]:6.1f}   999 999.0"] if past else []
            rows.append([" ".join((time, *cells))])
        return text(folder / "42001a2024.txt", head, rows if past else rows[::-1])

    return write


def co_ops(folder):
    """Currents of CO-OPS: in cm/s, or in knots on request, which the file does not say."""
    head = ["Date Time, Speed, Direction, Bin"]
    rows = [(time, 38.1, 60, 14) for time in dates("%Y-%m-%d %H:%M")]
    return text(folder / "CO-OPS_cb0102.csv", head, rows)


# --- instruments and spreadsheets ---------------------------------------------------------------


def nortek_csv(folder):
    cells = "0.6m", "1.1m", "1.6m"
    pairs = ";".join(f"Speed#{i}({cell});Dir#{i}({cell})" for i, cell in enumerate(cells, 1))
    head = [f"DateTime;Battery;Heading;Pitch;Roll;Pressure;Temperature;AnalogIn1;AnalogIn2;{pairs}"]
    speed, direction = over(speed_and_direction, (-19.4, -18.9, -18.4))
    rows = []
    for k, time in enumerate(dates("%Y-%m-%d %H:%M:%S")):
        parts = (f"{s:.3f};{d:.1f}" for s, d in zip(speed[k], direction[k], strict=True))
        rows.append((time, 11.9, 271.3, -0.4, 1.1, 19.870, 9.63, 0, 0, *parts))
    return text(folder / "Aquadopp_avgd.csv", head, rows, ";", "\r\n")


def lowell(folder):
    """Tilt current meter MAT-1 of Lowell Instruments."""
    head = ["ISO 8601 Time,Speed (cm/s),Heading (degrees),Velocity-N (cm/s),Velocity-E (cm/s)"]
    rows = [
        (time, f"{100 * np.hypot(float(u), float(v)):.2f}", 95.0, f"{100 * float(v):.1f}",
         f"{100 * float(u):.1f}")
        for time, u, v in points(dates("%Y-%m-%dT%H:%M:%S.000"))
    ]  # fmt: skip
    return text(folder / "2102403_TCM_C.txt", head, rows)


def marotte(folder):
    """Drag-tilt meter Marotte HS: the unit of a direction is a sentence."""
    head = [
        "datetime,speed (m/s),heading (degrees CW from North),tilt (radians),batt (volts),"
        "temp (Celsius)"
    ]
    speed, direction = (each[:, 0] for each in over(speed_and_direction))
    times = dates("%Y-%m-%d %H:%M:%S.000")
    rows = [
        (t, f"{s:.3f}", f"{d:.1f}", 0.21, 3.3, 11.2)
        for t, s, d in zip(times, speed, direction, strict=True)
    ]
    return text(folder / "marotte.csv", head, rows)


def aanderaa(folder):
    """SeaGuard of Aanderaa as its studio exports it: tabs, dates with dots."""
    head = ["Record Number\tTime tag (Gmt)\tBattery Voltage [V]\tNorth [cm/s]\tEast [cm/s]"]
    rows = [
        (k, time, 7.1, f"{100 * float(v):.3f}", f"{100 * float(u):.3f}")
        for k, (time, u, v) in enumerate(points(dates("%d.%m.%Y %H:%M:%S")), 1)
    ]
    return text(folder / "DCPS.txt", head, rows, "\t", "\r\n")


def year_first(folder):
    times = dates("%Y/%m/%d %H:%M")
    return text(folder / "currents.csv", ["DateTime,u (m/s),v (m/s)"], points(times))


def two_columns_of_time(folder):
    rows = [(*time.split(), u, v) for time, u, v in points(dates("%Y-%m-%d %H:%M:%S"))]
    return text(folder / "currents.csv", ["Date,Time,u (m/s),v (m/s)"], rows)


DAYS = dates("%d.%m.%Y %H:%M:%S", step=86400.0)
GERMAN = ["Datum;u [m/s];v [m/s];Temperatur [\N{DEGREE SIGN}C]"]


def european(folder):
    rows = [(*row, "11,2") for row in points(DAYS, ",")]
    return text(folder / "Strömung.csv", GERMAN, rows, ";", "\r\n", "cp1252")


def european_with_a_dot(folder):
    rows = [(*row, "11,2") for row in points(DAYS, ",")]
    rows[2] = (rows[2][0], "0.440", *rows[2][2:])
    return text(folder / "Strömung.csv", GERMAN, rows, ";", "\r\n", "cp1252")


def american(folder):
    times = dates("%m/%d/%Y %H:%M", step=86400.0)
    return text(folder / "currents.csv", ["time,u (m/s),v (m/s)"], points(times))


def comma_in_seconds(folder):
    times = [f"{date[:-3]}" for date in dates("%Y-%m-%d %H:%M:%S,%f", step=0.5)]
    return text(folder / "logger.csv", ["time;u [m/s];v [m/s]"], points(times, ","), ";")


def bare_columns(folder):
    return text(folder / "bare.csv", ["time,depth,u,v"], levels([0, 600, 1200, 1800]))


def bare_time(unit, digits=0, shift=0.0):
    """Return what writes times since 1970, or MATLAB's days since 0, without a unit."""

    def write(folder):
        times = [f"{shift + time:.{digits}f}" for time in since("1970-01-01", unit)]
        return text(folder / "bare.csv", ["time,u (m/s),v (m/s)"], points(times))

    return write


def grib(folder):
    path = folder / "ocean.grb2"
    path.write_bytes(b"GRIB\0\0\x0a\x02" + (200).to_bytes(8, "big") + bytes(180) + b"7777")
    return path


def hdf4(folder):
    path = folder / "MOD28.hdf"
    path.write_bytes(b"\x0e\x03\x13\x01" + np.arange(100, dtype=">i4").tobytes())
    return path


WEATHER = {"speed": "WSPD", "direction": "WDIR", "direction_is": "from", "heading_deg": 90.0}
FROM = {"current": lambda index, z: tuple(10 * part for part in turning(index, z))}

STYLES = {
    "ERDDAP csv": Played(erddap_csv, PROFILE, Z),
    "ERDDAP csv in knots": Played(erddap_knots, WITH_SPEED, current=turning),
    "ERDDAP csvp": Played(erddap_csvp, PROFILE, Z),
    "ERDDAP csv0": Refused(erddap_csv0, "csvp"),
    "ERDDAP tsv": Played(erddap_tsv, PROFILE, Z),
    "IOOS csv with flags": Played(
        ioos_csv,
        {
            "velocity": ["eastward_sea_water_velocity", "northward_sea_water_velocity", "0"],
            "heading_deg": 90.0,
            "vertical": "z",
        },
        Z,
        gaps=((1, 1),),
    ),
    "NDBC meteorological": Played(
        ndbc_meteorological, WEATHER, count=5, gaps=((2, 0),), proposed=False, **FROM
    ),
    "NDBC ADCP": Played(ndbc_adcp(False), None, Z, current=turning, gaps=((1, 2),)),
    "NDBC ADCP of past years": Played(ndbc_adcp(True), None, Z, current=turning, gaps=((1, 2),)),
    "CO-OPS": Refused(
        co_ops,
        "unit",
        {"time": "Date Time", "speed": "Speed", "direction": "Direction", "heading_deg": 90.0},
    ),
    "Nortek CSV": Played(nortek_csv, None, (-19.4, -18.9, -18.4), current=turning),
    "Lowell tilt meter": Played(
        lowell,
        {"velocity": ["Velocity-E", "Velocity-N", "0"], "heading_deg": 90.0}
        | {"time": "ISO 8601 Time"},
    ),
    "Marotte tilt meter": Played(
        marotte,
        {"time": "datetime", "speed": "speed", "direction": "heading", "heading_deg": 90.0},
        current=turning,
        proposed=False,  # a heading may be that of the instrument
    ),
    "Aanderaa": Played(
        aanderaa,
        {"velocity": ["East", "North", "0"], "time": "Time tag", "heading_deg": 90.0},
    ),
    "dates with the year first": Played(year_first, EAST_NORTH | {"time": "DateTime"}),
    "date and time in two columns": Refused(
        two_columns_of_time, "date|one column", EAST_NORTH | {"time": "Time"}
    ),
    "European spreadsheet": Played(
        european, EAST_NORTH | {"time": "Datum"}, step=86400.0, proposed=False
    ),
    "European spreadsheet with a dot": Refused(
        european_with_a_dot, r"0\.44.*(comma|dot|point)", EAST_NORTH | {"time": "Datum"}
    ),
    "American dates": Refused(american, "ISO|2024-03-01|year"),
    "seconds with a decimal comma": Played(comma_in_seconds, EAST_NORTH, step=0.5),
    "bare columns": Played(bare_columns, PROFILE, Z, remark="u .*no unit.*m/s"),
    "epoch seconds": Played(bare_time("s"), EAST_NORTH, remark="time .*assumed.* s"),
    "epoch milliseconds": Refused(bare_time("ms"), r"millisecond|\bms\b"),
    "days of a spreadsheet": Refused(bare_time("D", 8, 25569.0), "days?"),
    "MATLAB days": Refused(bare_time("D", 8, 719529.0), "MATLAB|days"),
    "GRIB": Refused(grib, "GRIB|netCDF"),
    "HDF4": Refused(hdf4, "HDF|netCDF"),
}


@pytest.mark.parametrize("style", by_keys(STYLES))
def test_a_text_is_played_or_refused(tmp_path, style):
    check_keys(style, tmp_path)


@pytest.mark.parametrize("style", by_proposal(STYLES))
def test_the_keys_of_a_text_are_proposed(tmp_path, style):
    check_proposal(style, tmp_path)
