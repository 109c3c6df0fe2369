"""The fuser's process: observations and fixes in, one state an epoch out, feedback to the filters."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from milepost.estimation.estimator import Prior
from milepost.estimation.fusion import RULES, Lists
from milepost.estimation.integrity import interval
from milepost.estimation.layout import Layout
from milepost.estimation.timeline import Observation
from milepost.estimation.track import Line
from milepost_schemas import AbsoluteFix, Estimate, Feedback, FusedState, Message

from .base import Node, Output, Subscription
from .roster import Presence, Roster, UnitRow

# an epoch further back than this is not worth sending live
BACKLOG_NS = 1_000_000_000
INITIALISING_NS = 1_000_000_000
STANDSTILL_MPS = 0.05


@dataclass(frozen=True)
class FuserSettings:
    """What a train file says of fusion. `lost_above_m`: half an interval wider than this says nothing useful any more."""

    rule: str
    period_ns: int
    deadline_ns: int
    horizon_ns: int
    feedback: bool
    shares: dict[str, float]
    sigmas: float
    lost_above_m: float
    jerk_psd: float
    prior: Prior
    layout: Layout
    units: list[UnitRow]


class FuserNode(Node):
    """Epochs lie on the grid t_k = k · period; see `roster` for what an epoch waits for."""

    def __init__(self, train: str, instance: str, settings: FuserSettings, line: Line) -> None:
        super().__init__(train, "fuser", instance)
        self.subscriptions = [Subscription("estimate"), Subscription("fix")]
        self._settings = settings
        self._line = line
        self._line_hash = line.content_hash
        self._rule = RULES[settings.rule](settings.layout, settings.jerk_psd, settings.prior, settings.horizon_ns)
        self._roster = Roster(settings.units, settings.shares, settings.deadline_ns)
        self._orders = {row.unit: row.order for row in settings.units}
        self._fixes: list[tuple[int, str, float, float]] = []
        self._earliest_ns: int | None = None
        self._latest_ns = 0
        self._epoch_ns: int | None = None
        self._settled_ns: int | None = None

    @property
    def rewinds(self) -> int:
        """How often something late was put in its place."""
        return self._rule.counters.rewinds

    def continue_from(self, feedback: Feedback) -> bool:
        """Start from what a former fuser said last, instead of the train file's prior. Returns whether its states are ours."""
        if feedback.fused.states != self._rule.names:
            return False
        mean, covariance = np.array(feedback.fused.mean), np.array(feedback.fused.covariance)
        self._rule.start_from(feedback.measured_at_ns, mean, covariance)
        self._earliest_ns = self._latest_ns = feedback.measured_at_ns
        self._epoch_ns = feedback.measured_at_ns + self._settings.period_ns
        return True

    def unit_alive(self, unit: str, alive: bool) -> None:
        """A token appeared or went."""
        self._roster.process_alive(unit, alive)

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """An estimate, or a fix; then the epochs that are ready."""
        if isinstance(message, Estimate):
            yield from self._take_estimate(message, now_ns)
        elif isinstance(message, AbsoluteFix):
            yield from self._take_fix(message, now_ns)
        yield from self._epochs(now_ns)

    def tick(self, now_ns: int) -> Iterable[Output]:
        """The epochs that are ready by time alone."""
        self._rule.advance_to(now_ns)
        yield from self._epochs(now_ns)

    def next_tick_ns(self) -> int | None:
        """The next epoch, or the deadline of one that is waiting."""
        if self._epoch_ns is None:
            return None
        missing = self._roster.worth_waiting(self._roster.missing(self._epoch_ns))
        return self._epoch_ns + self._settings.deadline_ns if missing else self._epoch_ns

    def _take_estimate(self, estimate: Estimate, now_ns: int) -> Iterable[Output]:
        order = self._orders.get(estimate.unit)
        if order is None:
            yield from self.refuse("unknown_unit", f"{estimate.unit} is not in the train file", now_ns)
            return
        observations = [
            Observation(
                o.measured_at_ns,
                order,
                o.reading_sequence,
                o.sensor_instance,
                o.component,
                estimate.unit,
                tuple(o.row),
                o.value,
                o.variance,
            )
            for o in estimate.observations
        ]
        belief = (estimate.measured_at_ns, estimate.belief.mean, estimate.belief.covariance)
        try:
            reasons = self._rule.take_estimate(estimate.unit, belief, observations, now_ns)
        except ValueError as error:
            yield from self.refuse("other_layout", str(error), now_ns)
            return
        for observation, reason in zip(observations, reasons, strict=True):
            yield from self._noted(observation, reason, now_ns)

    def _take_fix(self, fix: AbsoluteFix, now_ns: int) -> Iterable[Output]:
        order = self._orders.get(fix.reader)
        if order is None:
            yield from self.refuse("unknown_unit", f"{fix.reader} is not in the train file", now_ns)
            return
        row = (1.0, 0.0, 0.0)
        observation = Observation(
            fix.measured_at_ns,
            order,
            fix.reading_sequence,
            fix.reader_instance,
            0,
            fix.reader,
            row,
            fix.position_m,
            fix.position_variance_m2,
        )
        reason = self._rule.take_fix(observation, now_ns)
        if reason is None:
            insort(self._fixes, (fix.measured_at_ns, fix.balise_id, fix.position_m, fix.location_accuracy_m))
        yield from self._noted(observation, reason, now_ns)

    def _noted(self, observation: Observation, reason: str | None, now_ns: int) -> Iterable[Output]:
        if reason is not None:
            text = f"{observation.unit}: reading {observation.sequence} of {observation.instance}: {reason}"
            yield from self.refuse(reason, text, now_ns)
            return
        at = observation.measured_at_ns
        self._roster.saw(observation.unit, at, now_ns)
        self._earliest_ns = at if self._earliest_ns is None else min(self._earliest_ns, at)
        self._latest_ns = max(self._latest_ns, at)
        if self._epoch_ns is None:
            self._epoch_ns = self._grid(at)

    def _grid(self, at_ns: int) -> int:
        period = self._settings.period_ns
        return -(-at_ns // period) * period

    def _epochs(self, now_ns: int) -> Iterator[Output]:
        deadline = self._settings.deadline_ns
        if self._epoch_ns is not None and now_ns - self._epoch_ns > BACKLOG_NS:
            skipped = (now_ns - self._epoch_ns) // self._settings.period_ns
            self._epoch_ns = self._grid(now_ns)
            yield self.event("warning", "epochs_skipped", f"{skipped} epochs were too far back to be sent", now_ns)
        while self._epoch_ns is not None and self._epoch_ns <= now_ns:
            missing = self._roster.missing(self._epoch_ns)
            waiting = self._roster.worth_waiting(missing)
            if waiting and now_ns < self._epoch_ns + deadline:
                return
            for unit in waiting:
                self._roster.missed_deadline(unit)
            yield from self._publish(self._epoch_ns, missing, now_ns)
            self._epoch_ns += self._settings.period_ns

    def _publish(self, epoch_ns: int, missing: list[str], now_ns: int) -> Iterator[Output]:
        presence = self._roster.at(epoch_ns, live=True)
        fused = self._rule.state_at(epoch_ns, presence.shares)
        if fused is None:
            return
        head = self.head("state", epoch_ns, now_ns)
        yield Output("state", "", self._state(head, fused, presence, missing, settled=False))
        if self._settings.feedback:
            body = {"states": self._rule.names, "mean": fused[0], "covariance": fused[1]}
            head = self.head("feedback", epoch_ns, now_ns)
            yield Output("feedback", "", Feedback(**head, fused=body, shares=dict(presence.shares)))

    def settled_states(self, now_ns: int | None) -> Iterator[FusedState]:
        """The states of the epochs that no message can change any more; with None, of all that are left.

        To be asked before a step at `now_ns`: the step may fold what these epochs need. The sequence is the epoch's
        number and the times are the epoch's, so that equal observations give equal messages.
        """
        if self._earliest_ns is None:
            return
        horizon, period = self._settings.horizon_ns, self._settings.period_ns
        if self._settled_ns is None:
            if now_ns is not None and self._earliest_ns >= now_ns - horizon:
                return
            self._settled_ns = self._grid(self._earliest_ns)
        while self._settled_ns < now_ns - horizon if now_ns is not None else self._settled_ns <= self._latest_ns:
            at = self._settled_ns
            self._settled_ns += period
            presence = self._roster.at(at, live=False)
            fused = self._rule.state_at(at, presence.shares)
            if fused is not None:
                head = {"train": self.train, "unit": self.unit, "instance": "settled", "sequence": at // period}
                head |= {"measured_at_ns": at, "published_at_ns": at + horizon}
                yield self._state(head, fused, presence, [], settled=True)

    def _state(
        self, head: dict[str, Any], fused: Lists, presence: Presence, missing: list[str], *, settled: bool
    ) -> FusedState:
        settings, line = self._settings, self._line
        epoch_ns = head["measured_at_ns"]
        (s, v, a), P = fused[0][:3], [row[:3] for row in fused[1][:3]]
        place = bisect_right(self._fixes, epoch_ns, key=lambda fix: fix[0])
        last = self._fixes[place - 1] if place else None
        low, high = interval(s, P[0][0], settings.sigmas, line.map_accuracy_m + (last[3] if last else 0.0))
        slow, fast = interval(v, P[1][1], settings.sigmas)
        latitude, longitude = line.track.locate(s) if line.track is not None else (None, None)
        return FusedState(
            **head,
            epoch=epoch_ns // settings.period_ns,
            position_m=s,
            speed_mps=v,
            acceleration_mps2=a,
            covariance=P,
            position_min_m=low,
            position_max_m=high,
            speed_min_mps=slow,
            speed_max_mps=fast,
            direction="standstill" if abs(v) < STANDSTILL_MPS else "forward" if v > 0.0 else "backward",
            status=self._status(epoch_ns, high - s, presence),
            line=line.name,
            line_hash=self._line_hash,
            latitude_deg=latitude,
            longitude_deg=longitude,
            last_balise=None
            if last is None
            else {"balise_id": last[1], "position_m": last[2], "distance_since_m": s - last[2]},
            sensors=[{"unit": u, "share": presence.shares[u], "age_s": age} for u, age in presence.ages_s.items()],
            excluded=[{"unit": u, "reason": reason} for u, reason in presence.excluded.items()],
            awaiting=missing,
            settled=settled,
        )

    def _status(self, epoch_ns: int, reach_m: float, presence: Presence) -> str:
        if reach_m > self._settings.lost_above_m:
            return "lost"
        if not presence.ages_s:
            return "coasting"
        if self._earliest_ns is not None and epoch_ns - self._earliest_ns < INITIALISING_NS:
            return "initialising"
        return "degraded" if presence.excluded else "normal"
