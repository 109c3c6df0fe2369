"""The published state: the fused mean and covariance with interval, direction, status, coordinates and last balise."""

from __future__ import annotations

import math
from bisect import bisect_right, insort
from typing import Any

from milepost.fusion.integrity import interval
from milepost.fusion.rule import Fused
from milepost.nodes.roster import Presence
from milepost.nodes.working_states import kind_of
from milepost.track.line import Line
from milepost_schemas import AbsoluteFix, FusedState
from milepost_schemas.state import Status

from .limits import FARTHEST_M, FASTEST_MPS, within

# of 95 % of a normal distribution
ACCURACY_SIGMAS = 1.96
INITIALISING_NS = 1_000_000_000
STANDSTILL_MPS = 0.05
KEPT_FIXES = 512
# a balise that was passed: when, its name, position and location accuracy
Passed = tuple[int, str, float, float]


class StateWriter:
    """Writes states for one line. The status is `lost` where half the interval is wider than `lost_above_m`."""

    def __init__(self, line: Line, period_ns: int, sigmas: float, lost_above_m: float) -> None:
        self._line = line
        self._line_hash = line.content_hash
        # before the first balise, and after a restart, any balise may be the reference
        self._worst_accuracy_m = max((b.location_accuracy_m for b in line.balises), default=0.0)
        self._period_ns = period_ns
        self._sigmas = sigmas
        self._lost_above_m = lost_above_m
        self._fixes: list[Passed] = []

    @property
    def memory(self) -> tuple[Passed, ...]:
        """The balises that were passed, in order."""
        return tuple(self._fixes)

    @memory.setter
    def memory(self, other: tuple[Passed, ...]) -> None:
        self._fixes = list(other)

    def passed(self, fix: AbsoluteFix) -> None:
        """Note a balise that was passed."""
        insort(self._fixes, (fix.measured_at_ns, fix.balise_id, fix.position_m, fix.location_accuracy_m))
        if len(self._fixes) > 2 * KEPT_FIXES:
            del self._fixes[:KEPT_FIXES]

    def write(
        self, head: dict[str, Any], fused: Fused, presence: Presence, since_ns: int, missing: list[str], *, settled: bool
    ) -> FusedState:
        """The state at `head["measured_at_ns"]`: a function of the observations until then and, live, of tokens."""
        line, at_ns = self._line, head["measured_at_ns"]
        (s, v, a), P = fused.mean[:3], [row[:3] for row in fused.covariance[:3]]
        last, reset = self._last_fix(at_ns, fused), fused.reset
        if reset is not None and not at_ns - self._period_ns < reset.at_ns <= at_ns:
            reset = None  # an earlier epoch has announced it
        # an estimate beyond the message's limits is reported as `lost`
        inside = abs(s) < FARTHEST_M and abs(v) < FASTEST_MPS
        s, v = within(s, FARTHEST_M), within(v, FASTEST_MPS)
        accuracy_m = line.map_accuracy_m + (last[3] if last else self._worst_accuracy_m)
        if fused.bounds is not None and inside:
            (low, high), (slow, fast) = fused.bounds
            low, high = low - accuracy_m, high + accuracy_m
        else:
            low, high = interval(s, P[0][0], self._sigmas, accuracy_m)
            slow, fast = interval(v, P[1][1], self._sigmas)
        latitude, longitude = line.track.locate(s) if line.track is not None else (None, None)
        status: Status = self._status(at_ns - since_ns, 0.5 * (high - low), fused, presence) if inside else "lost"
        fields = {
            **head,
            "epoch": at_ns // self._period_ns,
            "position_m": s,
            "speed_mps": v,
            "acceleration_mps2": a,
            "covariance": P,
            "position_min_m": low,
            "position_max_m": high,
            "speed_min_mps": slow,
            "speed_max_mps": fast,
            "position_accuracy_m": ACCURACY_SIGMAS * math.sqrt(max(P[0][0], 0.0)),
            "speed_accuracy_mps": ACCURACY_SIGMAS * math.sqrt(max(P[1][1], 0.0)),
            "direction": "standstill" if abs(v) < STANDSTILL_MPS else "forward" if v > 0.0 else "backward",
            "status": status,
            "line": line.name,
            "line_hash": self._line_hash,
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "last_balise": last and {"balise_id": last[1], "position_m": last[2], "distance_since_m": s - last[2]},
            "sensors": [{"unit": u, "share": presence.shares[u], "age_s": age} for u, age in presence.ages_s.items()],
            "excluded": [{"unit": u, "reason": reason, "kind": kind_of(reason)} for u, reason in presence.excluded.items()],
            "doubted": list(fused.doubted),
            "reset": reset and {"size_m": reset.size_m, "size_mps": reset.size_mps, "reason": reset.reason},
            "awaiting": missing,
            "settled": settled,
        }
        return FusedState.model_validate(fields)

    def _last_fix(self, at_ns: int, fused: Fused) -> Passed | None:
        """The last fix until then that the leading hypothesis did not refuse."""
        odd = {at for verdict in fused.verdicts.values() for at in verdict.odd_ns}
        place = bisect_right(self._fixes, at_ns, key=lambda fix: fix[0])
        while place and self._fixes[place - 1][0] in odd:
            place -= 1
        return self._fixes[place - 1] if place else None

    def _status(self, since_start_ns: int, half_width_m: float, fused: Fused, presence: Presence) -> Status:
        if half_width_m > self._lost_above_m:
            return "lost"
        if not presence.ages_s:
            return "coasting"
        if since_start_ns < INITIALISING_NS:
            return "initialising"
        return "degraded" if presence.excluded or fused.doubted else "normal"
