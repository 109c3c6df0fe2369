"""UBX, the protocol of u-blox receivers: NAV-PVT and NAV-COV of one time of week are one fix."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np

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
        return self._read(data, waiting=True)

    def finish(self) -> list[Fix]:
        """The last fix; frames behind half a frame are found too."""
        return self._read(b"", waiting=False) + self._fixes(self._epochs.end())

    def _read(self, data: bytes, waiting: bool) -> list[Fix]:
        """The fixes of all frames; `waiting`: the rest of the last one may still come."""
        content = self._held + data
        sums, at = _Sums(content), 0
        out: list[Fix] = []
        while at < len(content):
            start = content.find(SYNC, at)
            if start != at:
                # the last byte may be the first half of the next sync
                kept = len(content) - 1 if content.endswith(SYNC[:1]) else len(content)
                self._pass_over((kept if start < 0 else start) - at)
                at = kept if start < 0 else start
                if start < 0:
                    break
            end = self._end(content, at)
            if waiting and (end is None or end > len(content)):
                break
            if end is not None and end <= len(content) and sums.fit(content, at, end):
                self._in_garbage = False
                out += self._take(content[at:end])
                at = end
                continue
            self._skips.add("truncated" if end is None or end > len(content) else "checksum")
            self._in_garbage = True  # what was inside the broken frame is counted with it
            at += len(SYNC)
        self._held = content[at:]
        return out

    def _end(self, content: bytes, start: int) -> int | None:
        """Where the frame at `start` ends as it says, if it says so already; 0 where it says more than a frame can hold."""
        if len(content) < start + HEADER:
            return None
        length = int.from_bytes(content[start + 4 : start + HEADER], "little")
        return start + HEADER + length + CHECKSUM if length <= LONGEST_PAYLOAD else 0

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


class _Sums:
    """Fletcher's checksum of any piece of the content, from sums that are made once: broken frames inside each other are many.

    Of bytes c_k from i to j it is a = Σ c_k and b = Σ (j - k) c_k, both modulo 256.
    """

    def __init__(self, content: bytes) -> None:
        values = np.frombuffer(content, np.uint8).astype(np.int64)
        self._sums = np.concatenate([[0], np.cumsum(values)]).tolist()
        self._weighted = np.concatenate([[0], np.cumsum(values * np.arange(len(values)))]).tolist()

    def fit(self, content: bytes, start: int, end: int) -> bool:
        """Whether a frame has the checksum of its class, identity, length and payload."""
        i, j = start + len(SYNC), end - CHECKSUM
        if j < i:
            return False
        a = self._sums[j] - self._sums[i]
        b = j * a - (self._weighted[j] - self._weighted[i])
        return content[j:end] == bytes((a & 0xFF, b & 0xFF))


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
