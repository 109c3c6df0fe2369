"""UBX, the protocol of u-blox receivers: NAV-PVT and NAV-COV of one time of week are one fix."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from .epochs import Epochs, Fix, Skips

SYNC = b"\xb5\x62"
HEADER, CHECKSUM = 6, 2
# the longest message of a receiver that is not being configured is a few hundred bytes
LONGEST_PAYLOAD = 4096
# the messages that are read, and how long their payloads are at least (later receivers append to them)
NAV_PVT, NAV_COV = b"\x01\x07", b"\x01\x36"
SHORTEST = {NAV_PVT: 84, NAV_COV: 64}
NO_FIX, DEAD_RECKONING, TIME_ONLY = 0, 1, 5


class UbxDecoder:
    """A frame counts only with its checksum; after one that fails the search goes on inside it, so nothing after it is lost.

    Skipped, by reason: `garbage` (bytes between frames, NMEA sentences among them), `checksum` (a broken frame), `truncated`
    (at the end), `malformed` (a length that its message cannot have), `late`, `no_date` (the receiver does not know it yet),
    `no_position`. Messages that say nothing of the fix are passed over.
    """

    def __init__(self) -> None:
        # only trains with a receiver need it
        import pyubx2

        self._parse = pyubx2.UBXReader.parse
        self._errors = (pyubx2.UBXParseError, pyubx2.UBXMessageError, pyubx2.UBXTypeError)
        self._skips = Skips()
        self.skipped = self._skips.counts
        self._epochs = Epochs(self._skips)
        self._held = b""
        self._in_garbage = False

    def feed(self, data: bytes) -> list[Fix]:
        """The fixes that these bytes complete."""
        self._held += data
        out: list[Fix] = []
        while (frame := self._next_frame(waiting=True)) is not None:
            out += self._take(frame)
        return out

    def finish(self) -> list[Fix]:
        """The last fix; frames behind half a frame are found too."""
        out: list[Fix] = []
        while (frame := self._next_frame(waiting=False)) is not None:
            out += self._take(frame)
        return out + self._fixes(self._epochs.end())

    def _next_frame(self, waiting: bool) -> bytes | None:
        while self._held:
            start = self._held.find(SYNC)
            if start:
                # the last byte may be the first half of the next sync
                keep = 1 if start < 0 and self._held.endswith(SYNC[:1]) else 0
                rest = len(self._held) - keep if start < 0 else start
                self._pass_over(rest)
                self._held = self._held[rest:]
                if start < 0:
                    return None
                continue
            length = int.from_bytes(self._held[4:HEADER], "little")
            end = HEADER + length + CHECKSUM
            too_long = len(self._held) >= HEADER and length > LONGEST_PAYLOAD
            if not too_long and len(self._held) < max(end, HEADER):
                if waiting:
                    return None
            elif not too_long and _checksum(self._held[2 : end - CHECKSUM]) == self._held[end - CHECKSUM : end]:
                frame, self._held, self._in_garbage = self._held[:end], self._held[end:], False
                return frame
            self._skips.add("checksum" if waiting or len(self._held) >= end else "truncated")
            self._in_garbage = True  # what was inside the broken frame is counted with it
            self._held = self._held[len(SYNC) :]
        return None

    def _pass_over(self, count: int) -> None:
        if count and not self._in_garbage:
            self._in_garbage = True
            self._skips.add("garbage")

    def _take(self, frame: bytes) -> list[Fix]:
        kind = frame[2:4]
        if kind not in SHORTEST:
            return []
        try:
            message: Any = self._parse(frame) if len(frame) >= HEADER + SHORTEST[kind] + CHECKSUM else None
        except self._errors:
            message = None
        if message is None:
            self._skips.add("malformed")
            return []
        return self._fixes(self._epochs.add(message.iTOW, "COV" if kind == NAV_COV else "PVT", message))

    def _fixes(self, epochs: list[Mapping[str, Any]]) -> list[Fix]:
        return [fix for parts in epochs if "PVT" in parts and (fix := self._fix(parts["PVT"], parts.get("COV"))) is not None]

    def _fix(self, pvt: Any, cov: Any) -> Fix | None:
        if pvt.fixType in (NO_FIX, TIME_ONLY) or getattr(pvt, "invalidLlh", False):  # from protocol 18 on
            self._skips.add("no_position")
            return None
        if not (pvt.validDate and pvt.validTime):
            self._skips.add("no_date")
            return None
        try:
            # in a leap second the receiver counts to 60
            whole = datetime(pvt.year, pvt.month, pvt.day, pvt.hour, pvt.min, min(pvt.second, 59), tzinfo=UTC).timestamp()
        except ValueError:
            self._skips.add("malformed")
            return None
        fields = {
            "latitude_deg": pvt.lat,
            "longitude_deg": pvt.lon,
            "solution": _solution(pvt),
            "altitude_m": pvt.hMSL * 1e-3,
            "satellites": pvt.numSV,
            "speed_mps": max(pvt.gSpeed, 0) * 1e-3,
            "course_deg": pvt.headMot % 360.0,
        }
        position_std, speed_std = _horizontal_std(pvt, cov), pvt.sAcc * 1e-3
        fields |= {"horizontal_std_m": position_std} if position_std > 0.0 else {}
        fields |= {"speed_std_mps": speed_std} if speed_std > 0.0 else {}
        return Fix(whole + pvt.nano * 1e-9, fields)


def _checksum(content: bytes) -> bytes:
    """Fletcher's, over class, identity, length and payload."""
    a = b = 0
    for byte in content:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return bytes((a, b))


def _solution(pvt: Any) -> str:
    if not pvt.gnssFixOk:
        return "none"
    if pvt.fixType == DEAD_RECKONING:
        return "propagated"
    if pvt.carrSoln:
        return "rtk_fixed" if pvt.carrSoln == 2 else "rtk_float"
    return "differential" if pvt.diffSoln else "single"


def _horizontal_std(pvt: Any, cov: Any) -> float:
    """Of one axis: the rms of north's and east's where the covariance is known, else hAcc/√2, hAcc being the radial figure."""
    if cov is not None and cov.posCovValid:
        return math.sqrt(0.5 * (max(cov.posCovNN, 0.0) + max(cov.posCovEE, 0.0)))
    return float(pvt.hAcc) * 1e-3 / math.sqrt(2.0)
