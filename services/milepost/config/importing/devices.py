"""The wheels and the inertial unit of an imported train."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from milepost.recordings.importing.columns import Column, LogColumns
from milepost.recordings.importing.figures import white_std
from milepost.recordings.importing.inertial import AXES, inertial_parts
from milepost.recordings.importing.names import unit_in, words_of
from milepost.recordings.importing.rows import (
    FASTEST_MPS,
    Array,
    Rows,
    gap_told,
    left_out_told,
    no_numbers_told,
    period_s,
    read_rows,
)
from milepost.recordings.importing.value_source import Part, value_recording

from .units import UnitEntry, file_of, imu_options, wheel_options
from .way import Way

# a filter needs no more readings than this a second: faster logs are averaged
FASTEST_HZ, AVERAGE_S = 25.0, 0.05
LEAST_STD_MPS = 0.07
LEAST_ROWS = 10
INERTIAL = [f"{quantity}_{axis}" for quantity in ("accel", "gyro") for axis in AXES]


@dataclass(frozen=True)
class Devices:
    """Units besides the receiver, the speeds of the first wheel from the span's beginning, and what a reader should know."""

    units: list[UnitEntry]
    speeds: tuple[Array, Array] | None
    told: list[str]


def device_units(
    logs: Sequence[LogColumns], way: Way, speeds: tuple[Array, Array] | None, folder: Path, show: Callable[[float], None]
) -> Devices:
    """All wheels and one inertial unit of the logs; `speeds`: as the receiver shows them."""
    wheels = [(each, column) for each in logs for column in each.columns if column.field == "wheel"]
    units, told = [], list[str]()
    first: tuple[Array, Array] | None = None
    for each, column in wheels:
        rows = _overlapping(each, [column], (f"wheel:{column.name}",), way, show)
        possible = np.abs(rows.values[f"wheel:{column.name}"]) <= FASTEST_MPS
        rows = rows.chosen(possible, f"beyond {FASTEST_MPS:g} m/s")
        if len(rows.t_s) < LEAST_ROWS:
            few = f"only {len(rows.t_s)} rows are no faster than {FASTEST_MPS:g} m/s in {column.unit}"
            raise ValueError(f"{each.log.path.name}: {column.name}: {few}: say --unit wheel=UNIT")
        told += _remarks(column.name, rows)
        units.append(_wheel(each, column, rows, way, folder, len(wheels)))
        first = first or (rows.t_s - way.span.from_s, rows.values[f"wheel:{column.name}"])
    for each in logs:
        columns = [column for column in each.columns if column.field in INERTIAL]
        if not columns:
            continue
        rows = _overlapping(each, columns, tuple(column.field for column in columns), way, show)
        told += _remarks(columns[0].name, rows)
        try:
            if first is None and speeds is None:
                raise ValueError("nothing tells the train's speed, to find its forward axis")
            t_s, speed_mps = first or speeds or (np.zeros(0), np.zeros(0))
            parts = inertial_parts(columns, rows, t_s + way.span.from_s, speed_mps)
        except ValueError as error:
            told.append(f"the inertial unit of {each.log.path.name} is left out: {error}")
            continue
        told += _turned(each, parts["specific_force_mps2"])
        units.append(_imu(each, columns, rows, parts, way, folder))
        break
    return Devices(units, first, told)


def _remarks(name: str, rows: Rows) -> list[str]:
    """What to say of the rows of a device, whose first column has this name."""
    left_out = [f"left out of {name}: {left_out_told(rows)}"] if rows.left_out else []
    return [*left_out, *no_numbers_told(rows), *gap_told(rows.t_s, "the device", f" of {name}")]


def _turned(each: LogColumns, parts: Sequence[Part]) -> list[str]:
    """What to say of an inertial unit whose axes are not as its columns name them."""
    if all(part.sign > 0.0 and part.key == f"accel_{axis}" for part, axis in zip(parts, AXES, strict=True)):
        return []
    axes = [f"{axis} is {'' if part.sign > 0.0 else '-'}{part.column.name}" for part, axis in zip(parts, AXES, strict=True)]
    return [f"the inertial unit of {each.log.path.name} is turned: {', '.join(axes)}"]


def _overlapping(
    each: LogColumns, columns: Sequence[Column], needed: Sequence[str], way: Way, show: Callable[[float], None]
) -> Rows:
    """The rows of some columns. Raises ValueError where they are of another time than the fixes."""
    time = [column for column in each.columns if column.field == "time"]
    rows = read_rows(each.log, [*time, *columns], needed, show)
    inside = np.count_nonzero((rows.t_s >= way.span.from_s) & (rows.t_s <= way.span.to_s))
    if inside < LEAST_ROWS:
        there = f"{rows.t_s[0]:.1f} to {rows.t_s[-1]:.1f} s" if len(rows.t_s) else "none"
        raise ValueError(
            f"{each.log.path.name}: {columns[0].name}: only {inside} rows at the time of the fixes: its times are {there}, "
            f"those of the fixes {way.span.from_s:.1f} to {way.span.to_s:.1f} s"
        )
    return rows


def _pace(rows: Rows) -> tuple[float, float | None]:
    """Readings a second, and over what they are averaged."""
    rate_hz = 1.0 / period_s(rows.t_s)
    return (1.0 / AVERAGE_S, AVERAGE_S) if rate_hz > FASTEST_HZ else (float(f"{rate_hz:.3g}"), None)


def _wheel(each: LogColumns, column: Column, rows: Rows, way: Way, folder: Path, wheels: int) -> UnitEntry:
    words = words_of(column.name)
    own = "-".join(word for word in words[: len(words) - unit_in(words, "speed")[1]] if word not in ("speed", "velocity"))
    name = "odometer" if wheels == 1 else f"wheel-{own.removeprefix('wheel-')}"
    rate_hz, average_s = _pace(rows)
    averaged = max(1.0, (average_s or 0.0) / period_s(rows.t_s))
    std_mps = max(LEAST_STD_MPS, white_std(rows.values[f"wheel:{column.name}"]) / averaged**0.5)
    constants = {"speed_variance_m2ps2": float(f"{std_mps**2 * averaged * wheels:.3g}")}
    fields: dict[str, Part | list[Part]] = {"speed_mps": Part(f"wheel:{column.name}", column)}
    unit = re.sub(r"[^a-z0-9-]", "", name)
    columns = [*each.of(), column]
    recording = value_recording(each.log, columns, rows, way.span, unit, fields, constants)
    return UnitEntry(
        unit, "odometer", recording, file_of(recording, folder), wheel_options(rate_hz, std_mps, wheels), average_s
    )


def _imu(
    each: LogColumns, columns: Sequence[Column], rows: Rows, parts: dict[str, list[Part]], way: Way, folder: Path
) -> UnitEntry:
    rate_hz, average_s = _pace(rows)
    constants: dict[str, object] = {} if "turn_rate_radps" in parts else {"turn_rate_radps": [0.0, 0.0, 0.0]}
    if average_s is None:
        constants["mean_over_s"] = round(1.0 / rate_hz, 6)
    recording = value_recording(each.log, [*each.of(), *columns], rows, way.span, "imu", {**parts}, constants)
    return UnitEntry("imu", "imu", recording, file_of(recording, folder), imu_options(rate_hz), average_s)
