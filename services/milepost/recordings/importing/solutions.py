"""What a receiver's words and numbers for the quality of its solution mean."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..gnss_log import SOLUTIONS
from ..nmea import MODES, QUALITIES

NMEA = {str(number): solution for number, solution in QUALITIES.items()} | {"0": "none", "7": "none", "8": "none"}
DIMENSIONS = {"0": "none", "1": "none", "2": "single", "3": "single", "4": "single", "5": "none"}
RTKLIB = {
    "1": "rtk_fixed",
    "2": "rtk_float",
    "3": "differential",
    "4": "differential",
    "5": "single",
    "6": "single",
    "0": "none",
}
WORDS = {
    "fixed": "rtk_fixed", "fix": "rtk_fixed", "rtk": "rtk_fixed", "rtkfixed": "rtk_fixed", "rtkfix": "rtk_fixed",
    "integer": "rtk_fixed", "float": "rtk_float", "rtkfloat": "rtk_float", "dgps": "differential", "dgnss": "differential",
    "differential": "differential", "sbas": "differential", "waas": "differential", "egnos": "differential",
    "single": "single", "autonomous": "single", "spp": "single", "gps": "single", "gnss": "single", "standalone": "single",
    "standard": "single", "3d": "single", "2d": "single", "3dfix": "single", "2dfix": "single", "gpsfix": "single",
    "none": "none", "nofix": "none", "invalid": "none", "void": "none", "insufficientobs": "none",
    "dr": "propagated", "deadreckoning": "propagated", "estimated": "propagated", "propagated": "propagated",
}  # fmt: skip
BEST_FIRST = ("rtk_fixed", "rtk_float", "differential", "single", "propagated", "none")
# the part of the rows whose words must be known
KNOWN_PART = 0.8


@dataclass(frozen=True)
class Meaning:
    """What the words of a column mean, by a table of this name."""

    name: str
    table: Mapping[str, str]

    def known(self, text: str) -> str | None:
        """The solution that a word stands for; None for one that is not known."""
        for word, solution in SOLUTIONS.items():
            if text.upper().startswith(word):
                return solution
        number = re.fullmatch(r"(\d)\.0+", text)
        return self.table.get(number[1] if number else re.sub(r"[^a-z0-9]", "", text.lower()))

    def of(self, text: str) -> str:
        """The solution that a word stands for, `none` for one that is not known."""
        return self.known(text) or "none"


def meaning_of(column: str, header: Sequence[str], texts: Sequence[str]) -> Meaning | None:
    """What a column says of the solution; None where it says nothing of it."""
    distinct = sorted(set(texts))
    numbers = all(re.fullmatch(r"\d(\.0+)?", text) for text in distinct)
    for meaning in _number_tables(column, header, distinct) if numbers else WORD_TABLES:
        meant = [meaning.known(text) for text in texts]
        if sum(each is not None for each in meant) >= KNOWN_PART * len(texts) and {*meant} - {None, "none"}:
            return meaning
    return None


def _number_tables(column: str, header: Sequence[str], distinct: Sequence[str]) -> list[Meaning]:
    others = " ".join(header).lower()
    if "ratio" in others or "sdn" in others:
        return [Meaning("RTKLIB", RTKLIB)]
    dimension = re.search(r"fix.?type|mode|dim", column, re.IGNORECASE) or any(text.startswith("3") for text in distinct)
    return [Meaning("2-D and 3-D", DIMENSIONS) if dimension else Meaning("NMEA 0183", NMEA)]


WORD_TABLES = (
    Meaning("words", WORDS),
    Meaning("NMEA 0183 modes", {key.lower(): solution for key, solution in MODES.items()} | {"n": "none"}),
)
