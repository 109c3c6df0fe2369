"""The unit of a column of speeds, as the places beside it show."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import islice

from ..units import UNITS
from .columns import ASSUMED, Column, Said, columns_of
from .legs import north_east_m
from .log_file import LogFile

# what vehicles' speeds are written in
USUAL = ("m/s", "km/h", "mph", "kn", "ft/s", "cm/s", "mm/s")
# the way is taken in legs that are long beside the noise of fixes, over so much of a log at most
LEG_M, WAY_M, MOST_ROWS = 20.0, 1000.0, 50_000
# a knot is 15 % more than a mile an hour
NEAR, FITS = 0.06, 0.02


def known_columns(log: LogFile, told: Said) -> list[Column]:
    """The columns of a log that are known, with the unit of each speed that was assumed as the way between the fixes shows it.

    Raises ValueError for one that was named, or names its unit, and is not as said.
    """
    columns = columns_of(log, told)
    of = {column.field: column for column in columns}
    if not {"time", "latitude", "longitude"} <= of.keys():
        return columns
    return [_shown(log, column, of) if _is_speed(column) and column.field not in told.units else column for column in columns]


def _is_speed(column: Column) -> bool:
    return column.unit in UNITS and UNITS[column.unit].quantity == "speed"


def _shown(log: LogFile, column: Column, of: dict[str, Column]) -> Column:
    """A column whose unit was assumed, with the one that the places show. Raises ValueError where they contradict its name."""
    ratio = _metres_by_number(log, column, of)
    if math.isnan(ratio):
        return column
    unit = _unit_of(ratio)
    if not column.why.endswith(ASSUMED):
        if of["time"].why.endswith(ASSUMED) and _off(1000.0 * ratio, column.unit) <= NEAR:
            name = of["time"].name
            raise ValueError(f"time: by the places and the speeds its column {name} is in ms: say --unit time=ms")
        _check(log, column, of, ratio, unit)
        return column
    if unit is None:
        return replace(column, why=f"{column.why}; the places show {ratio:.2g} m/s for each 1: say --unit {column.field}=UNIT")
    return replace(column, unit=unit, why=f"{column.why.removesuffix(ASSUMED)}, {unit} as the places show")


def _unit_of(ratio: float) -> str | None:
    """The usual unit of so many m/s; None where it is none's, as where places or numbers are not good throughout."""
    unit = min(USUAL, key=lambda each: _off(ratio, each))
    return unit if _off(ratio, unit) <= NEAR else None


def _off(ratio: float, unit: str) -> float:
    return abs(math.log(ratio / UNITS[unit].factor))


def _check(log: LogFile, column: Column, of: dict[str, Column], ratio: float, shown: str | None) -> None:
    """Raises ValueError where the places show another unit than the column's name."""
    if _off(ratio, column.unit) <= NEAR:
        return
    exchanged = {**of, "latitude": of["longitude"], "longitude": of["latitude"]}
    if _off(_metres_by_number(log, column, exchanged), column.unit) <= FITS:
        names = f"--column latitude={of['longitude'].name} --column longitude={of['latitude'].name}"
        raise ValueError(f"latitude, longitude: by the speeds in {column.name} the two are exchanged: say {names}")
    if shown is not None:
        contradiction = f"the column {column.name} is in {column.unit} by its name, but the places show {shown}"
        raise ValueError(f"{column.field}: {contradiction}: say which with --unit {column.field}=UNIT")


def _metres_by_number(log: LogFile, column: Column, of: dict[str, Column]) -> float:
    """The way between fixes in metres, divided by the integral of the numbers over the same time; NaN where there is no way."""
    time = of["time"]
    assert time.time is not None
    names = [*([time.date] if time.date else []), time.name, of["latitude"].name, of["longitude"].name, column.name]
    way_m = number_s = leg_s = 0.0
    anchor, before = None, None
    for _, cells in islice(log.rows(names), MOST_ROWS):
        *when, latitude, longitude, text = cells
        at = log.number(latitude) * of["latitude"].factor, log.number(longitude) * of["longitude"].factor
        speed = log.number(text)
        try:
            t_s = time.time.seconds(" ".join(when))
        except ValueError:
            continue
        if math.isnan(speed) or math.isnan(at[0]) or math.isnan(at[1]):
            continue
        if before is not None and t_s > before[0]:
            leg_s += 0.5 * (abs(speed) + before[1]) * (t_s - before[0])
        before = t_s, abs(speed)
        anchor = at if anchor is None else anchor
        if (leg_m := math.hypot(*north_east_m(*anchor, *at))) >= LEG_M:
            way_m, number_s, leg_s, anchor = way_m + leg_m, number_s + leg_s, 0.0, at
        if way_m >= WAY_M:
            break
    return way_m / number_s if way_m >= 5 * LEG_M and number_s > 0.0 else math.nan
