"""The rows of a log as numbers: what cannot be used is left out and counted, repeated fixes are thinned."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .columns import Column
from .log_file import LogFile
from .times import CLOCK, DAY_S

Array = NDArray[np.float64]
TELL_EVERY = 2000
# a run of equal fixes is longer than this where the log is faster than the receiver
LEAST_REPEATS = 1.5
# a gap is told that is longer than both
LONG_GAP_S, LONG_GAP_PERIODS = 10.0, 10.0
# no device is silent for a day and for so many rows; where fixes themselves are hours apart, the unit of time is wrong
SET_PERIODS = 1e4
# no train is as fast: loggers write such numbers where they have none
FASTEST_MPS = 200.0
# what loggers write where they have no value
EMPTY = ("", "nan")


@dataclass(frozen=True)
class Rows:
    """`t_s` (n), increasing; `values`: field → (n), SI units and degrees, NaN where a cell is empty; `solution` (n).

    `left_out`: how many rows, by reason. `words`: what each word of the receiver was taken for. `no_numbers`: by column, the
    cells that are none.
    """

    t_s: Array
    values: dict[str, Array]
    solution: list[str]
    left_out: dict[str, int]
    words: dict[str, str] = field(default_factory=dict)
    no_numbers: dict[str, list[str]] = field(default_factory=dict)

    def chosen(self, keep: NDArray[np.bool_], reason: str) -> Rows:
        """Some of the rows; the others are left out for a reason."""
        count = int(np.count_nonzero(~keep))
        left_out = {**self.left_out, reason: self.left_out.get(reason, 0) + count} if count else self.left_out
        solution = [each for each, kept in zip(self.solution, keep.tolist(), strict=True) if kept]
        values = {name: value[keep] for name, value in self.values.items()}
        return replace(self, t_s=self.t_s[keep], values=values, solution=solution, left_out=left_out)

    def has(self, name: str) -> bool:
        """Whether a field has any value."""
        return name in self.values and bool(np.isfinite(self.values[name]).any())


def read_rows(log: LogFile, columns: Sequence[Column], needed: Sequence[str], show: Callable[[float], None]) -> Rows:
    """The rows of some columns, `time` among them, that have a time and all of the `needed` fields. Raises ValueError."""
    time = next(column for column in columns if column.field == "time")
    assert time.time is not None
    named = [column for column in columns if column.field not in ("time", "solution")]
    quality = next((column for column in columns if column.field == "solution"), None)
    wanted = [time.name, *([time.date] if time.date else []), *(each.name for each in named)]
    wanted += [quality.name] if quality else []
    first = 2 if time.date else 1
    times, table, solution = [], [], []
    left_out: dict[str, int] = {}
    words: dict[str, str] = {}
    no_numbers: dict[str, list[str]] = {}
    for number, (_, cells) in enumerate(log.rows(wanted)):
        if number % TELL_EVERY == 0:
            show(float(number))
        try:
            times.append(time.time.seconds(" ".join(reversed(cells[:first])) if first == 2 else cells[0]))
        except ValueError:
            left_out["no time"] = left_out.get("no time", 0) + 1
            continue
        texts = cells[first : first + len(named)]
        table.append([log.number(text) if text else math.nan for text in texts])
        for column, text, value in zip(named, texts, table[-1], strict=True):
            if value != value and text.strip().lower() not in EMPTY:
                no_numbers.setdefault(column.name, []).append(text)
        word = cells[-1] if quality else ""
        if word not in words:
            words[word] = quality.meaning.of(word) if quality and quality.meaning else "single"
        solution.append(words[word])
    values = np.array(table, dtype=float).reshape(len(times), len(named))
    scaled = {_key(column, named): values[:, at] * column.factor for at, column in enumerate(named)}
    t_s = np.array(times, dtype=float) + time.ahead_s
    if time.time.unit == CLOCK:
        t_s = t_s + DAY_S * np.cumsum(np.concatenate([[0.0], np.diff(t_s)]) < -0.5 * DAY_S)
    rows = Rows(t_s, scaled, solution, left_out, words, no_numbers)
    for name in needed:
        rows = rows.chosen(np.isfinite(rows.values[name]), f"without {name}")
    return _increasing(rows)


def _key(column: Column, named: Sequence[Column]) -> str:
    """A field's name, with its column where there are several."""
    several = sum(each.field == column.field for each in named) > 1 or column.field == "wheel"
    return f"{column.field}:{column.name}" if several else column.field


def _increasing(rows: Rows) -> Rows:
    if not len(rows.t_s):
        return rows
    latest = np.maximum.accumulate(rows.t_s)
    keep = np.concatenate([[True], rows.t_s[1:] > latest[:-1]])
    return rows.chosen(keep, "not after the row before")


def placed(rows: Rows) -> Rows:
    """Fixes that are somewhere on the earth: receivers without a fix write zeros."""
    latitude, longitude = rows.values["latitude"], rows.values["longitude"]
    somewhere = (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0) & ((latitude != 0.0) | (longitude != 0.0))
    return rows.chosen(somewhere, "at no place")


def possible(rows: Rows) -> Rows:
    """Fixes whose speed a train may have: any other would be taken for hard driving."""
    if "speed" not in rows.values:
        return rows
    # where none is told nothing is wrong
    return rows.chosen(~(np.abs(rows.values["speed"]) > FASTEST_MPS), f"faster than {FASTEST_MPS:g} m/s")


def thinned(rows: Rows) -> tuple[Rows, int]:
    """One row of each fix, and how many rows a fix has: 1 where the log is no faster than the receiver.

    While a train moves, rows with equal places are one fix, logged again. Its first row has the time that is nearest to the
    fix. A run that is longer, at a stop, keeps a row for each fix that the receiver made.
    """
    if len(rows.t_s) < 3:
        return rows, 1
    latitude, longitude = rows.values["latitude"], rows.values["longitude"]
    new = np.concatenate([[True], (np.diff(latitude) != 0.0) | (np.diff(longitude) != 0.0)])
    starts = np.flatnonzero(new)
    lengths = np.diff(np.concatenate([starts, [len(new)]]))
    usual = float(np.median(lengths[:-1])) if len(lengths) > 2 else 1.0
    if usual < LEAST_REPEATS:
        return rows, 1
    every = round(usual)
    since = np.arange(len(new)) - np.repeat(starts, lengths)
    left = np.repeat(lengths, lengths) - since
    keep = new | ((since % every == 0) & (left >= every))
    return rows.chosen(keep, "a fix again"), every


def period_s(t_s: Array) -> float:
    """The usual time between rows."""
    return float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0


def gap_told(t_s: Array, who: str, of: str = "") -> list[str]:
    """What to say of the longest gap, where it is long. Raises ValueError for one that no device makes."""
    if len(t_s) < 2:
        return []
    steps = np.diff(t_s)
    at = int(np.argmax(steps))
    gap_s, after_s, usual_s = float(steps[at]), float(t_s[at] - t_s[0]), period_s(t_s)
    if gap_s > max(DAY_S, SET_PERIODS * usual_s):
        raise ValueError(
            f"time{of}: jumps by {gap_s:.0f} s after {after_s:.0f} s: the logger's clock was set there; cut the log there"
        )
    if gap_s <= max(LONG_GAP_S, LONG_GAP_PERIODS * usual_s):
        return []
    return [f"the longest gap{of} is of {gap_s:.0f} s, after {after_s:.0f} s: there {who} was silent, or its clock was set"]


def left_out_told(rows: Rows) -> str:
    """How many rows were left out, by reason, as words."""
    return ", ".join(f"{count} rows {reason}" for reason, count in rows.left_out.items())


def no_numbers_told(rows: Rows) -> list[str]:
    """What to say of cells that are no numbers."""
    return [
        f"no numbers in the column {name}: {len(texts)} cells, the first is {texts[0]!r}"
        for name, texts in rows.no_numbers.items()
    ]


def within(rows: Rows, from_s: float, to_s: float) -> Rows:
    """The rows of a span, [from, to]."""
    return rows.chosen((rows.t_s >= from_s) & (rows.t_s <= to_s), "outside the part that is used")


def shifted(rows: Rows, zero_s: float) -> Rows:
    """The rows with times counted from a moment."""
    return replace(rows, t_s=rows.t_s - zero_s)
