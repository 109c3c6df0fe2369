"""A local filter's process: it turns readings into estimates and takes feedback at its epoch."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
from pydantic import ValidationError

from milepost.estimation.filters.base import LocalFilter
from milepost.estimation.layout import N_COMMON
from milepost.estimation.observation import FUTURE_NS, UNTIMELY, Observation
from milepost.sensors.base import Sensor
from milepost.sensors.observed import Belief, Observed
from milepost_schemas import Estimate, Feedback, Message

from .base import Node, Output, Subscription
from .observations import RESTORED_COMPONENT, as_fields, as_judged, of_reading

# dividing a covariance by a smaller share overflows
LEAST_SHARE = 1e-6
# a valid message may still hold values that the arithmetic cannot use; the process must survive it
FARTHEST_MEAN, LARGEST_VARIANCE = 1e9, 1e15
FORGET_AT_LEAST = 2048
KEPT_READINGS = 64
# how often the fuser is told of readings that come too late or too early
TELL_NS = 500_000_000
UNUSABLE = (ArithmeticError, np.linalg.LinAlgError, ValidationError)


class FilterNode(Node):
    """Runs one local filter of one unit. `order` is the unit's row in the train file."""

    remembers = True

    def __init__(
        self, train: str, instance: str, sensor: Sensor[Any], local: LocalFilter[Any], order: int, feedback: bool
    ) -> None:
        super().__init__(train, sensor.unit, instance)
        self.subscriptions = [Subscription(sensor.stream, sensor.unit)]
        if feedback:
            # feedback has no effect before the next reading, so it need not wake the process
            self.subscriptions.append(Subscription("feedback", newest_only=True))
        self._sensor = sensor
        self._observer = sensor.observer()
        self._restored: tuple[Observed, ...] = ()
        self._needs_belief = sensor.needs_belief
        # where a row depends on more than the reading, the fuser makes it again from the reading
        learns = local.learner(local.options) is not None
        self._sends_readings = learns or sensor.needs_belief or self._observer is not sensor
        self._unsent: deque[dict[str, Any]] = deque(maxlen=KEPT_READINGS)
        self._told_ns: int | None = None
        self._moments: set[int] = set()
        self._forget_at = FORGET_AT_LEAST
        self._filter = local
        self._estimator = local.estimator
        self._order = order
        self._names = local.estimator.layout.names
        self._latest_ns = 0
        self._feedback: Feedback | None = None
        self._out_of_use = False
        # where the own states stand in feedback, and of which states that was found out
        self._layout_told: list[str] = []
        self._places: list[int] = []

    @property
    def rewinds(self) -> int:
        """How often a reading came after a later one."""
        return self._estimator.counters.rewinds

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """A reading, or feedback."""
        if isinstance(message, Feedback):
            return self._take_feedback(message, message.shares.get(self.unit, 0.0), now_ns)
        return self._take_reading(message, now_ns)

    def answer(self, procedure: str) -> Message | None:
        """`latest_feedback`: the feedback that a restarted fuser continues from."""
        return self._feedback if procedure == "latest_feedback" else None

    def snapshot(self) -> bytes | None:
        """The calibration to store for the next cold start; None where the sensor has none, or while the unit is not in use.

        What is learned beside an exclusion may be what the unit is excluded for.
        """
        if self._out_of_use:
            return None
        belief = self._estimator.belief_at(self._latest_ns) if self._latest_ns else None
        return None if belief is None else self._sensor.snapshot(Belief(*belief), self._latest_ns)

    def restore(self, kept: bytes, now_ns: int) -> Iterable[Output]:
        """Use a stored calibration. Only on a cold start: the fused state contains it already, and it must not count twice."""
        try:
            self._restored = (self._sensor.restore(kept, now_ns),)
        except ValueError as error:
            text = f"{self.unit}: the stored calibration is not used: {error}"
            yield self.event("warning", "calibration_unusable", text, now_ns)
        else:
            yield self.event("info", "calibration_restored", f"{self.unit}: the stored calibration is used", now_ns)

    def catch_up(self, feedback: Feedback, now_ns: int) -> bool:
        """Begin with the fused state and the train file's share instead of the train file's prior."""
        self._observer.restarted()
        for _ in self._take_feedback(feedback, self._estimator.share, now_ns):
            return False
        return self._feedback is feedback

    def _take_reading(self, reading: Message, now_ns: int) -> Iterable[Output]:
        estimator = self._estimator
        estimator.advance_to(now_ns)
        reason = estimator.timeline.untimely(reading.measured_at_ns, now_ns)
        if reason is None and reading.measured_at_ns in self._moments:
            # refused here, before the observer sees it: an observer must not learn from a repeated reading
            reason = "duplicate"
        if reason is not None:
            yield from self.refuse_reading(self.unit, reading.sequence, reading.instance, reason, now_ns)
            if reason in UNTIMELY:
                yield from self._tell(reading, reason, now_ns)
            return
        sent = self._sequences.get("estimate", 0)
        try:
            estimate, refused = self._estimated(reading, now_ns)
        except UNUSABLE:
            # nothing was sent, so its number is used again: consumers must not see a gap
            self._sequences["estimate"] = sent
            estimate, refused = None, ["unusable"]
        for notice in (*self._observer.notices(), *self._filter.notices()):
            yield self.event(*notice, now_ns)
        for reason in refused:
            yield from self.refuse_reading(self.unit, reading.sequence, reading.instance, reason, now_ns)
        if estimate is not None:
            yield Output("estimate", self.unit, estimate)

    def _tell(self, reading: Message, reason: str, now_ns: int) -> Iterable[Output]:
        """An estimate without anything new, so that the fuser knows that the unit is heard, and how late."""
        state = self._estimator.lists_at(self._latest_ns) if self._latest_ns else None
        if state is not None and (self._told_ns is None or now_ns - self._told_ns >= TELL_NS):
            self._told_ns = now_ns
            self._unsent.append(as_judged(reading, False, reason))
            yield Output("estimate", self.unit, self._estimate([], *state, now_ns))

    def _estimated(self, reading: Message, now_ns: int) -> tuple[Estimate | None, list[str]]:
        """The estimate after a reading, and the reasons for which observations of it are refused. Raises UNUSABLE."""
        belief = self._estimator.belief_at(reading.measured_at_ns) if self._needs_belief else None
        observed = self._observer.observe(reading, None if belief is None else Belief(*belief))
        self._note_moment(reading.measured_at_ns)
        offered, known = of_reading(reading, self._order, observed), self._take_restored(reading)
        counted, refused = self._filter.take(offered, now_ns, known)
        if (offered or known) and not counted:
            return None, refused
        self._latest_ns = max(self._latest_ns, reading.measured_at_ns)
        state = self._estimator.lists_at(self._latest_ns)
        if self._sends_readings:
            observer = self._observer
            self._unsent.append(as_judged(reading, bool(observed), observer.refused, observer.gating is not None))
        # without a belief there is no estimate yet: a refused reading is sent with the first one
        return None if state is None else self._estimate(counted, *state, now_ns), refused

    def _take_restored(self, reading: Message) -> list[Observation]:
        """The stored calibration as observations beside the first reading's; none beside later ones."""
        if not self._restored:
            return []
        known, self._restored = of_reading(reading, self._order, self._restored, RESTORED_COMPONENT), ()
        return known

    def _note_moment(self, moment_ns: int) -> None:
        self._moments.add(moment_ns)
        if len(self._moments) > self._forget_at:
            boundary_ns = self._estimator.timeline.boundary_ns
            self._moments = {at for at in self._moments if at >= boundary_ns}
            self._forget_at = max(FORGET_AT_LEAST, 2 * len(self._moments))

    def _estimate(
        self,
        counted: list[Observation],
        mean: list[float],
        covariance: list[list[float]],
        now_ns: int,
    ) -> Estimate:
        readings = list(self._unsent)
        self._unsent.clear()
        # one validation from plain lists costs half as much as building each part by itself
        return Estimate.model_validate(
            {
                **self.head("estimate", self._latest_ns, now_ns),
                "belief": {"states": self._names, "mean": mean, "covariance": covariance},
                "observations": [as_fields(o) for o in counted],
                "readings": readings,
                "feedback_epoch_ns": None if self._feedback is None else self._feedback.measured_at_ns,
            }
        )

    def _take_feedback(self, feedback: Feedback, share: float, now_ns: int) -> Iterable[Output]:
        epoch = feedback.measured_at_ns
        if epoch > now_ns + FUTURE_NS:
            yield from self.refuse("from_future", f"feedback of epoch {epoch} is ahead of time", now_ns)
            return
        if self._feedback is not None and epoch <= self._feedback.measured_at_ns:
            self.refusals.add("duplicate" if epoch == self._feedback.measured_at_ns else "superseded")
            return
        self._out_of_use = share <= 0.0
        # An excluded unit has share 0 and takes no feedback, with two exceptions: the first feedback, to begin from, and
        # feedback to an observer that judges by it, which must see when its readings agree with the fused state again.
        if share <= 0.0 and (self._feedback is None or self._observer is not self._sensor):
            share = self._estimator.share
        if share < LEAST_SHARE:
            return
        states = feedback.fused.states
        # a rule that does not fuse private states sends only the common ones
        names = self._names if len(states) > N_COMMON else self._names[:N_COMMON]
        if self._layout_told != states:
            self._layout_told, self._places = states, [states.index(name) for name in names if name in states]
        places = self._places
        if len(places) < len(names):
            yield from self.refuse("other_layout", f"feedback lacks one of {', '.join(names)}", now_ns)
            return
        mean = [feedback.fused.mean[i] for i in places]
        rows = [feedback.fused.covariance[i] for i in places]
        covariance = [[row[k] for k in places] for row in rows]
        variances = [row[i] for i, row in enumerate(covariance)]
        try:
            if max(map(abs, mean)) > FARTHEST_MEAN or max(variances) > LARGEST_VARIANCE or min(variances[:N_COMMON]) <= 0.0:
                raise ArithmeticError("mean or variance out of range")
            accepted = self._estimator.accept_feedback(epoch, mean, covariance, share)
        except UNUSABLE as error:
            yield from self.refuse("unusable", f"feedback of epoch {epoch}: {error}", now_ns)
            return
        if accepted:
            self._feedback = feedback
            self._latest_ns = max(self._latest_ns, epoch)
