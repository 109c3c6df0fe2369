"""How the times of a log are written."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from ..table import utc_seconds
from ..units import UNITS

ISO = "iso8601"
CLOCK = "hh:mm:ss"
DAY_S = 86_400.0
# what part of the first cells of a column must be what it is taken for
FITTING_PART = 0.9
TIME_OF_DAY = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d+)?)$")
# a day first is told from a month first by its dots
PATTERNS = ("%d.%m.%Y %H:%M:%S", "%Y/%m/%d %H:%M:%S", "%d.%m.%Y", "%Y/%m/%d", "%Y%m%d")
# numbers as large as these count from 1970
SINCE_1970 = (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8))


@dataclass(frozen=True)
class TimeFormat:
    """`unit`: a unit of time for numbers, `iso8601`, `hh:mm:ss`, or a pattern of `strptime`, whose seconds may have a fraction.

    `direct`: a column map reads it as it is. `assumed`: nothing tells that its numbers are seconds.
    """

    unit: str
    assumed: bool = False

    @property
    def direct(self) -> bool:
        """Whether it is a number or ISO 8601."""
        return self.unit == ISO or self.unit in UNITS

    def seconds(self, text: str) -> float:
        """A time in seconds, since 1970 or since midnight where it says so, as UTC. Raises ValueError."""
        if self.unit == ISO:
            return utc_seconds(text)
        if self.unit in UNITS:
            return float(text.replace(",", ".")) * UNITS[self.unit].factor
        if self.unit == CLOCK:
            found = TIME_OF_DAY.match(text.strip())
            if found is None:
                raise ValueError(f"{text} is no time of day")
            return int(found[1]) * 3600.0 + int(found[2]) * 60.0 + float(found[3].replace(",", "."))
        whole, fraction = _parts(text)
        return datetime.strptime(whole, self.unit).replace(tzinfo=UTC).timestamp() + fraction


def time_format(texts: Sequence[str], named: str | None) -> TimeFormat | None:
    """The format of some times, `named` by the column's name where that has a unit; None where they are no times."""
    if not texts:
        return None
    if numbers := _enough([_number(text) for text in texts]):
        unit = next((unit for unit, least in SINCE_1970 if max(numbers) > least), named)
        return TimeFormat(unit or "s", assumed=unit is None)
    for each in (TimeFormat(ISO), TimeFormat(CLOCK), *map(TimeFormat, PATTERNS)):
        if _enough([_read(each, text) for text in texts]):
            return each
    return None


def _enough(times: Sequence[float | None]) -> list[float]:
    """Those that could be read, if they are nearly all: a cell may be damaged, and its row is left out."""
    found = [each for each in times if each is not None]
    return found if len(found) >= FITTING_PART * len(times) else []


def _number(text: str) -> float | None:
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _read(each: TimeFormat, text: str) -> float | None:
    try:
        return each.seconds(text)
    except ValueError:
        return None


def _parts(text: str) -> tuple[str, float]:
    """A time without and its fraction of a second."""
    found = re.match(r"(.*:\d{2})[.,](\d+)\s*$", text)
    return (text.strip(), 0.0) if found is None else (found[1].strip(), float(f"0.{found[2]}"))
