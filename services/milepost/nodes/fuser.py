"""The fuser's process: it turns estimates and fixes into one state per epoch, and sends feedback to the filters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property

import numpy as np

from milepost.estimation.layout import Array
from milepost.estimation.observation import FUTURE_NS, UNTIMELY, Observation
from milepost.estimation.time_units import NS_PER_S
from milepost.fusion.information_rule import InformationFusion
from milepost.fusion.rule import Fused, LocalBelief
from milepost.fusion.rules import RULES
from milepost.track.line import Line
from milepost_schemas import AbsoluteFix, Estimate, Feedback, FusedState, Message, Refused, SnapshotPart

from .base import Node, Output, Subscription
from .catching_up.snapshot import Memory, Snapshots, resume
from .epochs import Epochs
from .fuser_settings import FuserSettings
from .judgements import note_judgements
from .observations import of_estimate, of_fix, whole_readings
from .roster import UNKNOWN, Presence, Roster
from .telling.decisions import Decisions, only_decided
from .telling.feedback import feedback_of
from .telling.hypotheses import hypotheses
from .telling.state_writer import StateWriter


class FuserNode(Node):
    """Fuses at epochs on the grid t_k = k · period; `roster` says which units an epoch waits for."""

    remembers = True
    watches_processes = True

    def __init__(self, train: str, instance: str, settings: FuserSettings, line: Line, unit: str = "fuser") -> None:
        super().__init__(train, unit, instance)
        self.subscriptions = [Subscription("estimate"), Subscription("fix")]
        self._settings = settings
        stated = settings.layout, settings.jerk_psd, settings.prior, settings.horizon_ns, settings.feedback
        self.rule = self._rule = RULES[settings.rule](*stated, settings.judges, settings.doubts)
        self._roster = Roster(settings.units, settings.shares, settings.deadline_ns)
        self._decisions = Decisions()
        self._filtered = {row.unit for row in settings.units if row.fused} - settings.judges.keys()
        self._orders = {row.unit: row.order for row in settings.units}
        self._writer = StateWriter(line, settings.period_ns, settings.sigmas, settings.lost_above_m)
        self._feedback: Feedback | None = None
        self._epochs = Epochs(settings.period_ns)
        # where the rule needs the shares for its state, they follow from the state of the epoch before
        self._prior_mps = float(settings.prior.mean[1])
        self._fused_before: Fused | None = None
        self._settled_before: Fused | None = None

    @property
    def rewinds(self) -> int:
        """How often a late observation caused a rewind."""
        return self._rule.counters.rewinds

    def answer(self, procedure: str) -> Message | None:
        """`latest_feedback`: the feedback that a restarted filter begins with."""
        return self._feedback if procedure == "latest_feedback" else None

    def catch_up(self, feedback: Feedback, now_ns: int) -> bool:
        """Continue from a former fuser's last state, however old: its covariance grows with its age, the prior's does not."""
        if feedback.fused.states != self._rule.names or feedback.measured_at_ns > now_ns + FUTURE_NS:
            return False
        self._continue_from(feedback.measured_at_ns, np.array(feedback.fused.mean), np.array(feedback.fused.covariance))
        return True

    def began(self, start_ns: int) -> None:
        """Note when scenario time began: without a fused state, and with a later first reading, the prior is of then."""
        self._epochs.began_ns = start_ns

    def _continue_from(self, at_ns: int, mean: Array, covariance: Array) -> None:
        self._rule.start_from(at_ns, mean, covariance)
        self._epochs.continue_from(at_ns)
        self._roster.expect_from(at_ns)

    @cached_property
    def _snapshots(self) -> Snapshots | None:
        """None for a rule without a bank: its filters' next beliefs contain all that it knows."""
        rule = self._rule
        return Snapshots(self._settings, rule.estimator.kernel.rows) if isinstance(rule, InformationFusion) else None

    def hand_over(self, now_ns: int) -> Iterator[SnapshotPart]:
        """All that it knows of the train, from its first epoch on."""
        snapshots, kept = self._snapshots, self._rule.kept() if self._epochs.next_ns is not None else None
        if kept is None or snapshots is None:
            return iter(())
        known = self._epochs.times, self._roster.memory, self._writer.memory, self._decisions.memory, self._feedback
        return snapshots.parts(Memory(*known, kept), now_ns)

    def take_over(self, parts: Sequence[SnapshotPart], agreed: Feedback, now_ns: int) -> None:
        """Continue from what a replica knows, hypotheses and all: from now on both settle to the same bits."""
        if self._snapshots is None:
            raise Refused("no_bank", f"the rule {self._settings.rule} has no bank")
        memory = self._snapshots.opened(parts, now_ns)
        resume(self._rule, memory.kept, agreed)
        self._epochs.times, self._feedback = memory.times, memory.feedback
        self._roster.memory, self._writer.memory, self._decisions.memory = memory.units, memory.passed, memory.reported

    def unit_alive(self, unit: str, alive: bool) -> None:
        """Note that a process's liveliness token appeared or was dropped."""
        self._roster.process_alive(unit, alive)

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """Take an estimate or a fix, then publish the epochs that are ready."""
        if isinstance(message, Estimate):
            yield from self._take_estimate(message, now_ns)
        elif isinstance(message, AbsoluteFix):
            yield from self._take_fix(message, now_ns)
        yield from self._publish_ready(now_ns)

    def tick(self, now_ns: int) -> Iterable[Output]:
        """Publish the epochs whose time or deadline has come."""
        self._rule.advance_to(now_ns)
        self._roster.forget(now_ns - self._settings.horizon_ns)
        yield from self._publish_ready(now_ns)

    def next_tick_ns(self) -> int | None:
        """The next epoch, or the deadline of one that is waiting."""
        epoch_ns = self._epochs.next_ns
        if epoch_ns is None:
            return None
        missing = self._roster.awaited(self._roster.missing(epoch_ns))
        return epoch_ns + self._settings.deadline_ns if missing else epoch_ns

    def _take_estimate(self, estimate: Estimate, now_ns: int) -> Iterable[Output]:
        order = self._orders.get(estimate.unit)
        if order is None:
            yield from self.refuse("unknown_unit", f"{estimate.unit} is not in the train file", now_ns)
            return
        judge, stated = self._settings.judges.get(estimate.unit), estimate.belief
        belief = LocalBelief(estimate.measured_at_ns, stated.mean, stated.covariance, estimate.feedback_epoch_ns is not None)
        rows = of_estimate(estimate, order)
        try:
            observations = rows if judge is None else whole_readings(estimate, order, judge.message, rows)
            reasons = self._rule.take_estimate(estimate.unit, belief, observations, now_ns)
        except Refused as refused:
            yield from self.refuse(refused.reason, f"{estimate.unit}: {refused.detail}", now_ns)
            return
        except ValueError as error:
            yield from self.refuse("other_layout", str(error), now_ns)
            return
        untimely = any(reading.why in UNTIMELY for reading in estimate.readings)
        if not observations and not untimely and abs(estimate.measured_at_ns - now_ns) <= self._settings.horizon_ns:
            self._roster.arrived(estimate.unit, estimate.measured_at_ns, now_ns)
        if len(reasons) > len(observations):
            yield from self.refuse(
                reasons[0] or "invalid", f"{estimate.unit}: belief {estimate.sequence}: {reasons[0]}", now_ns
            )
        for observation, reason in zip(observations, reasons, strict=False):
            yield from self._noted(observation, reason, now_ns)
        taken = {o.measured_at_ns for o, reason in zip(observations, reasons, strict=False) if reason is None}
        note_judgements(self._roster, estimate, rows, taken, judge is not None, now_ns)

    def _take_fix(self, fix: AbsoluteFix, now_ns: int) -> Iterable[Output]:
        order = self._orders.get(fix.reader)
        if order is None:
            yield from self.refuse("unknown_unit", f"{fix.reader} is not in the train file", now_ns)
            return
        observation = of_fix(fix, order)
        if fix.doubtful is not None and self._rule.needs_shares:
            # a rule without a bank of hypotheses cannot take a fix back
            yield from self.refuse("doubtful", f"{fix.reader}: fix at {fix.balise_id}: {fix.doubtful}", now_ns)
            return
        reason = self._rule.take_fix(observation, now_ns)
        if reason is None:
            self._writer.passed(fix)
        yield from self._noted(observation, reason, now_ns)

    def _noted(self, observation: Observation, reason: str | None, now_ns: int) -> Iterable[Output]:
        at = observation.measured_at_ns
        if reason is not None:
            if reason in UNTIMELY:
                self._roster.arrived(observation.unit, at, now_ns, untimely=True)
            yield from self.refuse_reading(observation.unit, observation.sequence, observation.instance, reason, now_ns)
            return
        self._roster.arrived(observation.unit, at, now_ns)
        if (began_ns := self._epochs.late_since(at)) is not None:
            prior = self._settings.prior
            self._continue_from(began_ns, *self._settings.layout.prior(prior.mean, prior.std))
        self._epochs.observed(at, self._roster.all_heard, now_ns)

    def _publish_ready(self, now_ns: int) -> Iterator[Output]:
        epochs, deadline = self._epochs, self._settings.deadline_ns
        skipped = epochs.skipped(now_ns)
        if skipped:
            yield self.event("warning", "epochs_skipped", f"{skipped} epochs were too old and were not sent", now_ns)
        while (epoch_ns := epochs.next_ns) is not None and epoch_ns <= now_ns:
            missing = self._roster.missing(epoch_ns)
            waiting = self._roster.awaited(missing)
            if waiting and now_ns < epoch_ns + deadline:
                return
            for unit in waiting:
                self._roster.missed_deadline(unit)
            yield from self._publish(epoch_ns, missing, now_ns)
            epochs.sent(epoch_ns)

    def _fuse(self, epoch_ns: int, live: bool, before: Fused | None) -> tuple[Fused, Presence] | None:
        """An epoch's fused state and its units; None before the first observation. `before`: the state of the epoch before."""
        roster, presence = self._roster, None
        if self._rule.needs_shares:
            speed_mps, variances = (before.speed_mps, before.variances) if before else (self._prior_mps, UNKNOWN)
            presence = roster.at(epoch_ns, live, {}, speed_mps, variances)
        fused = self._rule.state_at(epoch_ns, presence.shares if presence else {}, live)
        if fused is None:
            return None
        if presence is None or roster.follows_state:
            presence = roster.at(epoch_ns, live, only_decided(fused.verdicts, self._filtered), fused.speed_mps, fused.variances)
        return fused, presence

    def _publish(self, epoch_ns: int, missing: list[str], now_ns: int) -> Iterator[Output]:
        made = self._fuse(epoch_ns, True, self._fused_before)
        if made is None:
            return
        fused, presence = made
        self._fused_before = fused
        for severity, code, text in self._decisions.news(fused, presence, epoch_ns):
            yield self.event(severity, code, text, now_ns)
        since_ns = max(fused.since_ns, self._epochs.times.resumed_ns)
        head = self.head("state", epoch_ns, now_ns)
        state = self._writer.write(head, fused, presence, since_ns, missing, settled=False)
        yield Output("state", "", state)
        if self._settings.feedback and epoch_ns // self._settings.period_ns % self._settings.feedback_every == 0:
            head = self.head("feedback", epoch_ns, now_ns)
            self._feedback = feedback_of(head, self._rule.names, fused, presence, state)
            yield Output("feedback", "", self._feedback)
        if fused.bank is not None and epoch_ns % NS_PER_S < self._settings.period_ns:
            head = self.head("hypotheses", epoch_ns, now_ns)
            yield Output("hypotheses", self.unit, hypotheses(head, state.epoch, fused.bank))

    def settled_states(self, now_ns: int | None) -> Iterator[FusedState]:
        """The states of the epochs that no message can change any more; with None, of all that are left.

        Call it before the step at `now_ns`: the step may fold observations that these epochs need. The sequence is the
        epoch's number and the times are the epoch's, so that equal observations give equal messages.
        """
        horizon, period = self._settings.horizon_ns, self._settings.period_ns
        while (at := self._epochs.next_settled(horizon, now_ns)) is not None:
            made = self._fuse(at, False, self._settled_before)
            if made is not None:
                self._settled_before, presence = made
                head = {"train": self.train, "unit": self.unit, "instance": "settled", "sequence": at // period}
                head |= {"measured_at_ns": at, "published_at_ns": at + horizon}
                since_ns = max(self._settled_before.since_ns, self._epochs.times.resumed_ns)
                yield self._writer.write(head, self._settled_before, presence, since_ns, [], settled=True)
