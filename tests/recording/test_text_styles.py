"""Measured currents in text, as services, instruments, loggers and spreadsheets write them."""

import numpy as np
import pytest

from helpers.styles import (
    DEPTHS,
    EAST_NORTH,
    Played,
    Refused,
    Z,
    dates,
    lines,
    over,
    since,
    speed_and_direction,
    turning,
)

BLANK = dates("%Y-%m-%d %H:%M:%S")
BLANKS = "%Y %m %d %H %M"
UNITS = "time,u (m/s),v (m/s)"
CM, MM = (100.0, 100.0), (1000.0, 1000.0)


# --- NDBC and Nortek: many cells in a row --------------------------------------------------------


def wind(index, z):
    """Return a speed ten times as high, and the direction from which it comes."""
    speed, direction = speed_and_direction(index, z)
    return direction + 180.0, 10.0 * speed


def ten_times(index, z):
    return tuple(10.0 * part for part in turning(index, z))


def ndbc(depths, past=False):
    """Return what writes currents by a profiler.

    Realtime: newest first, a row may end early. Past years: oldest first, 999 for a missing value.
    """

    def write(folder):
        names = " ".join(f"DEP{i:02d} DIR{i:02d} SPD{i:02d}" for i, _ in enumerate(depths, 1))
        units = " ".join(["    m  degT  cm/s"] * len(depths))
        speed, direction = over(speed_and_direction, -np.asarray(depths))
        rows = []
        for k, time in enumerate(dates(BLANKS)):
            cells = [
                f"{depth:6.1f} {direction[k, i]:5.0f} {100 * speed[k, i]:5.1f}"
                for i, depth in enumerate(depths)
            ]
            if k == 1:
                cells[2:] = [f"{DEPTHS[2]:6.1f}   999 999.0"] if past else []
            rows.append(" ".join((time, *cells)))
        head = [f"#YY  MM DD hh mm {names}", f"#yr  mo dy hr mn {units}"]
        path = folder / "42001a2024.txt"
        path.write_text("\n".join([*head, *(rows if past else rows[::-1]), ""]))
        return path

    return write


NORTEK_Z = (-19.4, -18.9, -18.4)


def nortek(decimal):
    """Return what writes cells of Nortek, whose numbers may have a decimal comma."""

    def write(folder):
        cells = "0.6m", "1.1m", "1.6m"
        pairs = ";".join(f"Speed#{i}({cell});Dir#{i}({cell})" for i, cell in enumerate(cells, 1))
        text = f"DateTime;Battery;Heading;Pressure;Temperature;AnalogIn1;{pairs}\r\n"
        speed, direction = over(speed_and_direction, NORTEK_Z)
        for k, time in enumerate(BLANK):
            parts = (f"{s:.3f};{d:.1f}" for s, d in zip(speed[k], direction[k], strict=True))
            text += f"{time};11.9;271.3;19.870;9.63;0;{';'.join(parts)}\r\n"
        (folder / "Aquadopp_avgd.csv").write_bytes(text.replace(".", decimal).encode())
        return folder / "Aquadopp_avgd.csv"

    return write


def grib(folder):
    path = folder / "ocean.grb2"
    path.write_bytes(b"GRIB\0\0\x0a\x02" + (200).to_bytes(8, "big") + bytes(180) + b"7777")
    return path


# --- the table -----------------------------------------------------------------------------------


def bare_time(unit, digits=0, shift=0.0):
    """Return what writes times since 1970, or MATLAB's days since 0, without a unit."""
    times = [f"{shift + time:.{digits}f}" for time in since("1970-01-01", unit)]
    return lines(UNITS, times=times)


def german(change=("", "")):
    return lines(
        "Datum;u [m/s];v [m/s];Temperatur [\N{DEGREE SIGN}C]",
        row="{t};{u};{v};11,2",
        times=dates("%d.%m.%Y %H:%M:%S", step=86400.0),
        decimal=",",
        change=change,
        end="\r\n",
        encoding="cp1252",
        name="Strömung.csv",
    )


def flagged(name):
    row, spike = "{t},{u},{v},1", ("0.420,-0.090,1", "1.9,-0.09,4")
    return lines(f"{UNITS},{name}", row=row, change=spike)


LEVELS = {"row": "{t},{depth},{u},{v}", "heights": Z}
KNOTS = {"current": speed_and_direction, "scale": (3600 / 1852, 1.0), "digits": 9}
STATION = "station,time,latitude,longitude,depth,u,v,temperature,salinity,qc"
IOOS = "eastward_sea_water_velocity", "northward_sea_water_velocity"
IOOS_FLAGS = ",".join(("time,z", *IOOS, *(f"{name}_qc_agg" for name in IOOS)))
WEATHER = {"speed": "WSPD", "direction": "WDIR", "direction_is": "from", "heading_deg": 90.0}
CO_OPS = {"time": "Date Time", "speed": "Speed", "direction": "Direction", "heading_deg": 90.0}
# not proposed: a heading may be that of the instrument
MAROTTE = {"time": "datetime", "speed": "speed", "direction": "heading", "heading_deg": 90.0}
TOA5 = (
    '"TOA5","CR1000","CR1000","1234","CR1000.Std.32","CPU:current.CR1","5555","Table1"',
    '"TIMESTAMP","RECORD","u","v"',
    '"TS","RN","m/s","m/s"',
    '"","","Avg","Avg"',
)
HOBO = '"Plot Title: 20123456"', '"#","Date Time, GMT-07:00","u, m/s (LGR S/N: 20123456)"'
GAP = {"gaps": ((1, 0),)}

STYLES = {
    "ERDDAP csv": Played(lines(
        STATION, ",UTC,degrees_north,degrees_east,m,m s-1,m s-1,degree_C,PSU,1", heights=Z,
        row="M1,{t},36.75,-122.03,{depth},{u},{v},11.2,33.5,1"), Z),
    "ERDDAP csv in knots": Played(lines(
        "time,spd,dir,water_temperature", "UTC,knots,degrees_true,degree_C",
        row="{t},{u},{v},11.25", **KNOTS), current=turning),
    "ERDDAP csvp": Played(lines("time (UTC),depth (m),u (m s-1),v (m s-1)", **LEVELS), Z),
    "ERDDAP csv0": Refused(lines(**LEVELS), "csvp"),
    "ERDDAP tsv": Played(lines(
        "time\tdepth\tu\tv", "UTC\tm\tm s-1\tm s-1", row="{t}\t{depth}\t{u}\t{v}", heights=Z), Z),
    "IOOS csv with flags": Played(lines(
        IOOS_FLAGS, "UTC,m,m.s-1,m.s-1,,", row="{t},{z},{u},{v},1,1", heights=Z,
        change=("0.370,-0.070,1", "1.75,-0.070,4")), Z, gaps=((1, 1),)),
    "NDBC meteorological": Played(lines(
        "#YY  MM DD hh mm WDIR WSPD GST  WVHT   DPD   APD MWD   PRES  ATMP  WTMP  TIDE",
        "#yr  mo dy hr mn degT m/s  m/s     m   sec   sec degT   hPa  degC  degC    ft",
        row="{t} {u} {v}  6.0   1.1     7   5.2 290 1013.5  11.0  11.4    MM",
        times=dates(BLANKS, count=5), current=wind, change=("250.000 4.400", "MM   MM"),
        newest_first=True), keys=WEATHER, count=5, gaps=((2, 0),), current=ten_times),
    "NDBC ADCP": Played(ndbc(DEPTHS), Z, current=turning, gaps=((1, 2),)),
    "NDBC ADCP of past years": Played(ndbc(DEPTHS, past=True), Z, current=turning, gaps=((1, 2),)),
    "one cell of NDBC": Played(ndbc([2.5]), (-2.5,), current=turning),
    "CO-OPS": Refused(
        lines("Date Time, Speed, Direction, Bin", row="{t},38.1,60,14"), "unit", CO_OPS),
    "Nortek": Played(nortek("."), NORTEK_Z, current=turning),
    "Nortek with decimal commas": Played(nortek(","), NORTEK_Z, current=turning),
    "Lowell tilt meter": Played(lines(
        "ISO 8601 Time,Speed (cm/s),Heading (degrees),Velocity-N (cm/s),Velocity-E (cm/s)",
        row="{t},45.00,95.0,{v},{u}", times=dates("%Y-%m-%dT%H:%M:%S.000"), scale=CM)),
    "Marotte tilt meter": Played(lines(
        "datetime,speed (m/s),heading (degrees CW from North),tilt (radians),temp (Celsius)",
        row="{t},{u},{v},0.21,11.2", times=dates("%Y-%m-%d %H:%M:%S.000"),
        current=speed_and_direction), keys=MAROTTE, current=turning),
    "Aanderaa": Played(lines(
        "Record Number\tTime tag (Gmt)\tBattery Voltage [V]\tNorth [cm/s]\tEast [cm/s]",
        row="{k}\t{t}\t7.1\t{v}\t{u}", times=dates("%d.%m.%Y %H:%M:%S"), scale=CM, end="\r\n")),
    "Campbell": Played(lines(
        *TOA5, row='"{t}",7,{u},"{v}"', times=BLANK, change=("0.420", '"NAN"')), **GAP),
    "HOBO": Refused(
        lines(*HOBO, row="1,{t},{u}", times=dates("%m/%d/%y %I:%M:%S %p")),
        "03/01/24 06:00:00 AM.*ISO dates",
        {"time": "Date Time, GMT-07:00", "velocity": ["u, m/s", "0"]}),
    "parts of a date": Played(lines(
        "year,month,day,hour,minute,second,u (m/s),v (m/s)", times=dates("%Y,%m,%d,%H,%M,%S"))),
    "a flag of all columns": Played(flagged("flag"), **GAP),
    "a quality of all columns": Played(flagged("Quality"), **GAP),
    "a flag of another variable": Played(lines(f"{UNITS},T,T_flag", row="{t},{u},{v},11,4")),
    "a flag of no variable": Played(
        lines(f"{UNITS},salt_qc", row="{t},{u},{v},4"), remark="salt_qc is a flag of no variable"),
    "a comma that may separate thousands": Played(
        lines("time;u (mm/s);v (mm/s)", row="{t};{u};{v}", scale=MM, decimal=","),
        remark="u: 400,000 is read as 400"),
    "commas between thousands": Refused(lines(
        "time;u (mm/s);v (mm/s)", row="{t};4;5", change=("10:00Z;4", "10:00Z;1,400")),
        "u contains 1,400"),
    "dates with the year first": Played(lines(
        "DateTime,u (m/s),v (m/s)", times=dates("%Y/%m/%d %H:%M"))),
    "date and time in two columns": Refused(
        lines("Date,Time,u (m/s),v (m/s)", times=dates("%Y-%m-%d,%H:%M:%S")), "date|one column",
        EAST_NORTH | {"time": "Time"}),
    "European spreadsheet": Played(german(), keys=EAST_NORTH | {"time": "Datum"}, step=86400.0),
    "European spreadsheet with a dot": Refused(
        german(("0,440", "0.440")), r"0\.44.*(comma|dot|point)", EAST_NORTH | {"time": "Datum"}),
    "American dates": Refused(
        lines(UNITS, times=dates("%m/%d/%Y %H:%M", step=86400.0)), "ISO|2024-03-01|year"),
    "seconds with a decimal comma": Played(lines(
        "time;u [m/s];v [m/s]", row="{t};{u};{v}", decimal=",",
        times=[each[:-3] for each in dates("%Y-%m-%d %H:%M:%S,%f", step=0.5)]), step=0.5),
    "bare columns": Played(
        lines("time,depth,u,v", times=[0, 600, 1200, 1800], **LEVELS), Z, remark="u .*no unit"),
    "epoch seconds": Played(bare_time("s"), remark="time .*assumed.* s"),
    "epoch milliseconds": Refused(bare_time("ms"), r"millisecond|\bms\b"),
    "days of a spreadsheet": Refused(bare_time("D", 8, 25569.0), "days?"),
    "MATLAB days": Refused(bare_time("D", 8, 719529.0), "MATLAB|days"),
    "GRIB": Refused(grib, "GRIB|netCDF"),
}  # fmt: skip


@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES)
def test_a_text_is_played_or_refused(tmp_path, style):
    style.check(tmp_path)
