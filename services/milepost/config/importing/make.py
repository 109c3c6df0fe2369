"""From logs to the files of a train."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from milepost.recordings.importing.columns import ASSUMED, LogColumns
from milepost.recordings.importing.figures import course_off_deg, courses, good_solutions, jerk_psd, withheld_span
from milepost.recordings.importing.log_file import LogFile
from milepost.recordings.importing.position_source import FIELDS, position_recording
from milepost.recordings.importing.rows import (
    Array,
    Rows,
    gap_told,
    left_out_told,
    no_numbers_told,
    period_s,
    placed,
    possible,
    read_rows,
    thinned,
)
from milepost.recordings.importing.solutions import BEST_FIRST
from milepost.recordings.importing.source import Copy, Recording
from milepost.track.from_fixes import NoWayError

from .devices import Devices, device_units
from .files import GEOMETRY, LINE, SCENARIO, TRAIN, Imported, Withheld, geometry_text, line_text, scenario_text, train_text
from .units import UnitEntry, file_of, gnss_options, relative
from .way import Way, way_of

LEAST_FIXES = 10
# a course over ground is nearer to the way from fix to fix, in the median
MOST_COURSE_OFF_DEG = 30.0
FIRST_S, FEW = 5.0, 5
# noise about standstill is no speed
LEAST_BACKWARDS_MPS, BACKWARDS_PART = 0.5, 0.02
ALONE = "the receiver is all there is, so it is trusted (fault_probability: 0): nothing could contradict it"


@dataclass(frozen=True)
class Made:
    """What an import makes: texts by file name, copies, sentences for a reader, and figures for a program."""

    texts: dict[str, str]
    copies: list[Copy]
    told: list[str]
    figures: dict[str, object]


def make(
    logs: Sequence[LogColumns], line: Path | None, folder: Path, remarks: Sequence[str], show: Callable[[float], None]
) -> Made:
    """The files of the train whose logs these are; the first one has its places. Raises ValueError and ConfigError."""
    fixes, told = _fixes(logs[0], show)
    first, fixes, wrong = _with_a_course(logs[0], fixes)
    told += wrong
    told += remarks
    good_words = good_solutions(fixes.solution)
    if not good_words:
        raise ValueError(f"solution: no fix counts: they are {', '.join(sorted(set(fixes.solution)))}")
    good = fixes.chosen(np.array([each in good_words for each in fixes.solution]), "of a poorer solution")
    way = _way(first, fixes, good, line)
    devices = device_units(logs, way, _speeds(fixes, way, good_words), folder, show)
    gnss = _gnss(first, fixes, way, folder, alone=not devices.units)
    told += [*way.told, *devices.told, *([] if devices.units else [ALONE])]
    train = _train(first.log, fixes, good_words, way, devices, gnss, line, folder, told)
    texts = {TRAIN: train_text(train), SCENARIO: scenario_text(train)}
    if way.points is not None:
        about = [f"Root mean square of the good fixes' distance from it: {way.off_m:.2f} m.", *way.told]
        texts |= {LINE: line_text(train.name, first.log.path, about), GEOMETRY: geometry_text(train.name, way.points)}
    copies = [unit.recording.copy for unit in train.units if unit.recording.copy is not None]
    figures: dict[str, object] = {
        "train": train.name,
        "duration_s": train.duration_s,
        "fixes": len(fixes.t_s),
        "solutions": dict(Counter(fixes.solution)),
        "left_out": fixes.left_out,
        "line_length_m": way.length_m,
        "line_rms_m": way.off_m,
        "units": [unit.name for unit in train.units],
        "withheld_s": None if train.withheld is None else [train.withheld.from_s, train.withheld.to_s],
    }
    return Made(texts, copies, told, figures)


def _way(first: LogColumns, fixes: Rows, good: Rows, line: Path | None) -> Way:
    try:
        return way_of(fixes, good, line)
    except NoWayError as error:
        assumed = next(column for column in first.columns if column.field == "time").why.endswith(ASSUMED)
        raise ValueError(f"{error}{'; is its time in another unit? --unit time=ms' if assumed else ''}") from error


def _fixes(first: LogColumns, show: Callable[[float], None]) -> tuple[Rows, list[str]]:
    """The fixes of a receiver, and what was left out."""
    raw = read_rows(first.log, first.of(*FIELDS), ("latitude", "longitude"), show)
    rows, every = thinned(possible(placed(raw)))
    if len(rows.t_s) < LEAST_FIXES:
        raise ValueError(f"only {len(rows.t_s)} fixes; left out: {left_out_told(rows) or 'nothing'}")
    told = [f"{len(rows.t_s)} fixes in {rows.t_s[-1] - rows.t_s[0]:.0f} s: {_counted(rows.solution)}"]
    told += [f"left out: {left_out_told(rows)}"] if rows.left_out else []
    told += no_numbers_told(rows)
    told += gap_told(rows.t_s, "the receiver")
    _refuse_backwards(first, rows)
    told += [f"the log is faster than the receiver: a fix stands in {every} rows, of which one is used"] if every > 1 else []
    unknown = [word for word, meant in rows.words.items() if word and meant == "none"]
    told += [f"not taken for a solution: {', '.join(unknown)}"] if unknown else []
    return rows, told


def _with_a_course(first: LogColumns, rows: Rows) -> tuple[LogColumns, Rows, list[str]]:
    """The log and its fixes with the course between them, where it has none or one that they contradict; what was left out."""
    off_deg, told = course_off_deg(rows), list[str]()
    if off_deg is not None and off_deg > MOST_COURSE_OFF_DEG:
        (column,) = (each for each in first.columns if each.field == "course")
        told.append(
            f"the column {column.name} is not used: it is {off_deg:.0f} degrees off the way from fix to fix, which is used"
        )
        first = LogColumns(first.log, [each for each in first.columns if each is not column])
        rows = replace(rows, values={name: value for name, value in rows.values.items() if name != "course"})
    if rows.has("speed") and not rows.has("course"):
        rows = replace(rows, values=rows.values | {"course": courses(rows)})
    return first, rows, told


def _refuse_backwards(first: LogColumns, rows: Rows) -> None:
    """Raises ValueError where a receiver's speeds are negative, which are along its course: the train would go backwards."""
    if not rows.has("speed"):
        return
    speeds = rows.values["speed"][np.isfinite(rows.values["speed"])]
    negative = int(np.count_nonzero(speeds < -LEAST_BACKWARDS_MPS))
    if negative > BACKWARDS_PART * len(speeds):
        (column,) = (each for each in first.columns if each.field == "speed")
        told = f"speed: the column {column.name} is negative in {negative} of {len(speeds)} rows"
        raise ValueError(f"{told}: a receiver's speed is along its way; leave it out with --column speed=")


def _counted(solution: Sequence[str]) -> str:
    counts = Counter(solution)
    return ", ".join(f"{counts[each]} {each}" for each in BEST_FIRST if counts[each])


def _speeds(fixes: Rows, way: Way, good: Sequence[str]) -> tuple[Array, Array] | None:
    """Times from the span's beginning and speeds, as the receiver or its fixes say; None where neither is good enough."""
    if fixes.has("speed"):
        known = np.isfinite(fixes.values["speed"])
        return fixes.t_s[known] - way.span.from_s, fixes.values["speed"][known]
    if good[0] != "rtk_fixed" or len(way.t_s) < LEAST_FIXES:
        return None
    return way.t_s, np.gradient(way.position_m, way.t_s)


def _gnss(first: LogColumns, fixes: Rows, way: Way, folder: Path, alone: bool) -> UnitEntry:
    columns = first.of(*FIELDS)
    recording: Recording = position_recording(first.log, columns, fixes, way.span)
    known = [each for each in BEST_FIRST if each in fixes.solution]
    rate_hz = float(f"{1.0 / period_s(fixes.t_s):.3g}")
    options = gnss_options(known, way.noise_m, rate_hz, fixes.has("accuracy"), fixes.has("speed"), alone)
    return UnitEntry("gnss", "gnss", recording, file_of(recording, folder), options)


def _beginning(way: Way) -> tuple[float, float]:
    """Position and speed at the span's beginning: a parabola through the first seconds of fixes, a line through few."""
    count = max(3, int(np.count_nonzero(way.t_s <= way.t_s[0] + FIRST_S)))
    fitted = np.polyfit(way.t_s[:count], way.position_m[:count], 2 if count > FEW else 1)
    return float(fitted[-1]), float(fitted[-2])


def _train(
    log: LogFile, fixes: Rows, good: Sequence[str], way: Way, devices: Devices, gnss: UnitEntry, line: Path | None,
    folder: Path, told: Sequence[str],
) -> Imported:  # fmt: skip
    speeds = devices.speeds or _speeds(fixes, way, good)
    position_m, speed_mps = _beginning(way)
    span = withheld_span(way.t_s, way.position_m, period_s(fixes.t_s), alone=not devices.units)
    best = good[0]
    return Imported(
        name=re.sub(r"[^a-z0-9]+", "-", log.path.stem.lower()).strip("-")[:40] or "imported",
        log=log.path,
        line=LINE if line is None else relative(line, folder),
        duration_s=way.span.to_s - way.span.from_s,
        position_m=position_m,
        position_std_m=(1.0 if line is None else 5.0) if best == "rtk_fixed" else (2.0 if line is None else 10.0),
        speed_mps=speed_mps,
        speed_std_mps=2.0 if speeds is not None else 5.0,
        jerk_psd=jerk_psd(*speeds) if speeds is not None else 0.01,
        jerk_known=speeds is not None,
        units=[gnss, *devices.units],
        withheld=None if span is None else Withheld(*span, best),
        remarks=[f"{each[0].upper()}{each[1:]}." for each in told],
    )
