"""NMEA 0183: the sentences GGA, RMC and GST of one time are one fix."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, date, datetime, time, timedelta
from typing import Any

from .epochs import Epochs, Fix, Skips

KNOT_MPS = 1852.0 / 3600.0
# the standard allows 82; receivers that print more digits need a little more
LONGEST_SENTENCE = 256
HALF_A_DAY_S = 43_200.0
QUALITIES = {1: "single", 2: "differential", 3: "single", 4: "rtk_fixed", 5: "rtk_float", 6: "propagated"}
MODES = {"A": "single", "D": "differential", "P": "single", "R": "rtk_fixed", "F": "rtk_float", "E": "propagated"}
# the sentences that are read, and what each must have; later versions of the standard append to them
USED = {
    "GGA": ("lat", "lon", "quality", "numSV", "HDOP", "alt"),
    "RMC": ("status", "lat", "lon", "spd", "cog", "date"),
    "GST": ("stdLat", "stdLong"),
}


class NmeaDecoder:
    """A sentence runs from `$` to the line's end and counts only with its checksum.

    Skipped, by reason: `garbage` (bytes between sentences), `truncated` (no end, or no checksum), `checksum`,
    `malformed` (a field that is none, or is not there), `foreign` (a sentence that the standard does not have), `late`,
    `no_date` (no RMC has come yet), `no_position`. Sentences of the standard that say nothing of the fix are passed over.
    """

    def __init__(self) -> None:
        # only trains with a receiver need it
        import pynmeagps
        import pynmeagps.nmeatypes_get

        self._parse = pynmeagps.NMEAReader.parse
        self._errors = (pynmeagps.NMEAParseError, pynmeagps.NMEATypeError, pynmeagps.NMEAMessageError)
        self._known = pynmeagps.nmeatypes_get.NMEA_PAYLOADS_GET
        self._skips = Skips()
        self.skipped = self._skips.counts
        self._epochs = Epochs(self._skips)
        self._held = b""
        self._in_garbage = False
        self._day: tuple[date, float] | None = None

    def feed(self, data: bytes) -> list[Fix]:
        """The fixes that these bytes complete."""
        self._held += data
        out: list[Fix] = []
        while (sentence := self._next_sentence()) is not None:
            out += self._take(sentence)
        return out

    def finish(self) -> list[Fix]:
        """The last fix; a last line without its end counts if it has its checksum."""
        held, self._held = self._held, b""
        return (self._take(held) if held else []) + self._fixes(self._epochs.end())

    def _next_sentence(self) -> bytes | None:
        while self._held:
            start = self._held.find(b"$")
            if start:
                self._pass_over(self._held if start < 0 else self._held[:start])
                self._held = b"" if start < 0 else self._held[start:]
                continue
            self._in_garbage = False
            end, again = self._held.find(b"\n"), self._held.find(b"$", 1)
            stops = [place for place in (end, again) if place > 0]
            stop = min(stops, default=len(self._held))
            if stop > LONGEST_SENTENCE:
                cut = 1
            elif not stops:
                return None
            elif stop == end:
                sentence, self._held = self._held[: end + 1], self._held[end + 1 :]
                return sentence
            else:
                cut = again
            self._skips.add("truncated")
            self._held = self._held[cut:]
        return None

    def _pass_over(self, data: bytes) -> None:
        if not self._in_garbage and data.strip():
            self._in_garbage = True
            self._skips.add("garbage")

    def _take(self, sentence: bytes) -> list[Fix]:
        line = sentence.rstrip(b"\r\n")
        if line[-3:-2] != b"*":
            self._skips.add("truncated")
            return []
        if f"{_checksum(line[1:-3]):02X}".encode() != line[-2:].upper():
            self._skips.add("checksum")
            return []
        kind = line[3:6].decode("ascii", "replace")
        if kind not in USED:
            if kind not in self._known:
                self._skips.add("foreign")
            return []
        try:
            message = self._parse(sentence)
        except self._errors:
            message = None
        at = getattr(message, "time", None)
        if not isinstance(at, time):
            # a receiver that has seen no satellite yet leaves the time empty
            self._skips.add("malformed" if line.split(b",")[1:2] != [b""] else "no_position")
            return []
        if not all(hasattr(message, name) for name in USED[kind]):
            self._skips.add("malformed")
            return []
        return self._fixes(self._epochs.add(at, kind, message))

    def _fixes(self, epochs: list[Mapping[str, Any]]) -> list[Fix]:
        return [fix for parts in epochs if (fix := self._fix(parts)) is not None]

    def _fix(self, parts: Mapping[str, Any]) -> Fix | None:
        rmc, gga = parts.get("RMC"), parts.get("GGA")
        at = next(iter(parts.values())).time
        utc_s = self._utc_s(at, rmc.date if rmc is not None else None)
        placed = gga if gga is not None else rmc
        if placed is None or not (_is_number(placed.lat) and _is_number(placed.lon)):
            self._skips.add("no_position")
            return None
        if utc_s is None:
            self._skips.add("no_date")
            return None
        fields = {"latitude_deg": placed.lat, "longitude_deg": placed.lon, "solution": _solution(gga, rmc)}
        if gga is not None:
            fields |= {"altitude_m": gga.alt, "satellites": gga.numSV, "hdop": gga.HDOP}
        if rmc is not None and rmc.status == "A" and _is_number(rmc.spd):
            fields |= {"speed_mps": rmc.spd * KNOT_MPS, "course_deg": rmc.cog}
        fields["horizontal_std_m"] = _horizontal_std(parts.get("GST"))
        return Fix(utc_s, {name: value for name, value in fields.items() if value not in (None, "")})

    def _utc_s(self, at: time, day: Any) -> float | None:
        second = at.hour * 3600 + at.minute * 60 + at.second + at.microsecond * 1e-6
        if not isinstance(day, date):
            if self._day is None:
                return None
            day, before = self._day
            # only RMC carries the date: between two of them midnight shows as a step back by nearly a day
            if second < before - HALF_A_DAY_S:
                day += timedelta(days=1)
        self._day = (day, second)
        return datetime(day.year, day.month, day.day, tzinfo=UTC).timestamp() + second


def _checksum(content: bytes) -> int:
    total = 0
    for byte in content:
        total ^= byte
    return total


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _solution(gga: Any, rmc: Any) -> str:
    if gga is not None:
        return QUALITIES.get(gga.quality, "none")
    return MODES.get(getattr(rmc, "posMode", "A"), "none") if rmc.status == "A" else "none"


def _horizontal_std(gst: Any) -> float | None:
    """The rms of the two axes' standard deviations."""
    if gst is None or not (_is_number(gst.stdLat) and _is_number(gst.stdLong)):
        return None
    return math.sqrt(0.5 * (gst.stdLat**2 + gst.stdLong**2)) or None
