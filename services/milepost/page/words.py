"""Words and figures for people: statuses, judgements, numbers with few digits, ages."""

from __future__ import annotations

from typing import Literal, NamedTuple

from milepost_schemas import EVENT_CODES, EventCode

UNKNOWN = "unknown"
# keeps a figure and its unit on one line
NBSP = "\u00a0"
KMH_PER_MPS = 3.6
REFUSED = "refused_"
# how much somebody should care: decides colour and shape, which never stand without the word
Level = Literal["ok", "info", "warn", "bad", "idle"]


class StatusWords(NamedTuple):
    """A status of a train as it is shown."""

    word: str
    meaning: str
    level: Level


STATUSES: dict[str, StatusWords] = {
    "initialising": StatusWords("initialising", "In its first second after the start.", "info"),
    "normal": StatusWords("normal", "All sensors are in use.", "ok"),
    "degraded": StatusWords("degraded", "A sensor is excluded, or sensors contradict each other.", "warn"),
    "coasting": StatusWords("coasting", "No sensor counts: the position is carried on from before.", "warn"),
    "lost": StatusWords("lost", "The position is too uncertain to be used.", "bad"),
    # what only a listener can say
    "silent": StatusWords("silent", "No state has come for more than a second. Its position is not known now.", "bad"),
    "ended": StatusWords("ended", "All its processes have ended.", "idle"),
    "unknown": StatusWords("unknown", "No state of this train has been heard.", "idle"),
}
KINDS: dict[str, str] = {"out_of_range": "out of range", "exceeded": "exceeded by the train"}
DIRECTIONS = {
    "forward": "towards higher chainage",
    "backward": "towards lower chainage",
    "standstill": "standing",
    "unknown": "direction unknown",
}
SEVERITIES: dict[str, Level] = {"info": "info", "warning": "warn", "error": "bad"}
_CODES: dict[str, EventCode] = {row.code: row for row in EVENT_CODES}


def figure(value: float | None, decimals: int) -> str:
    """A number with so many decimals, and no zero with a sign."""
    if value is None:
        return UNKNOWN
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def kmh(speed_mps: float | None) -> str:
    """A speed in km/h."""
    return figure(None if speed_mps is None else speed_mps * KMH_PER_MPS, 1)


def age(seconds: float | None) -> str:
    """How long ago, in one unit."""
    if seconds is None:
        return UNKNOWN
    if seconds < 1.0:
        return "< 1 s"
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.0f} h"


def kind_word(kind: str | None) -> str:
    """Why a unit is excluded, in a word or two."""
    return KINDS.get(kind, kind) if kind else "excluded"


def meaning_of(code: str) -> EventCode | None:
    """An event's row in the table of events."""
    return _CODES.get("refused_REASON" if code.startswith(REFUSED) else code)
