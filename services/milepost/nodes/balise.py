"""The balise service: it turns telegrams into absolute fixes with the line's balise table, and says what is irregular."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from milepost.estimation.observation import FUTURE_NS
from milepost.track.line import Line
from milepost.track.linking import Linking
from milepost.track.passage import Interval, Irregularity, Telegram
from milepost.track.placement import Belief, Placement
from milepost_schemas import AbsoluteFix, BaliseTelegram, Feedback, Message

from .base import Node, Output, Subscription


class BaliseNode(Node):
    """Looks up each telegram's balise and publishes a fix that is stamped with the time of passage.

    It withholds no fix of a known balise: one that is not as the published interval leads to expect is marked `doubtful`.
    """

    def __init__(self, train: str, instance: str, readers: Sequence[str], line: Line) -> None:
        super().__init__(train, "balise", instance)
        # feedback wakes it: a balise that is not read sends nothing that could
        self.subscriptions = [*(Subscription("balise_telegram", reader) for reader in readers), Subscription("feedback")]
        self._line = line
        self._indexes = {balise.balise_id: i for i, balise in enumerate(line.balises)}
        self._linking, self._placement = Linking(line), Placement(line)

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """A fix for a telegram, and events for what is irregular; feedback tells where balises are expected."""
        if isinstance(message, Feedback):
            return self._take_feedback(message, now_ns)
        return self._take_telegram(message, now_ns) if isinstance(message, BaliseTelegram) else ()

    def _take_feedback(self, feedback: Feedback, now_ns: int) -> Iterator[Output]:
        at_ns, body = feedback.measured_at_ns, feedback.fused
        if at_ns > now_ns + FUTURE_NS:
            yield from self.refuse("from_future", f"feedback of epoch {at_ns} is ahead of time", now_ns)
            return
        self._placement.believe(Belief(at_ns, body.mean, body.covariance), feedback.published_at_ns)
        bounds = feedback.interval
        if bounds is not None:
            yield from self._events(self._linking.follow(Interval(at_ns, *bounds)), now_ns)

    def _take_telegram(self, telegram: BaliseTelegram, now_ns: int) -> Iterator[Output]:
        index = self._indexes.get(telegram.balise_id)
        if index is None:
            self.refusals.add("unknown_balise")
            text = f"{telegram.unit} read {telegram.balise_id}, which the line does not have"
            yield self.event("warning", "unknown_balise", text, now_ns)
            return
        balise, at_ns, variance_m2 = self._line.balises[index], telegram.measured_at_ns, telegram.reader_variance_m2
        taken = self._linking.take(Telegram(telegram.unit, index, at_ns, variance_m2))
        doubtful = next((found.detail for found in taken.found if found.detail), None)
        fix = AbsoluteFix(
            **self.head("fix", at_ns, now_ns),
            reader=telegram.unit,
            reader_instance=telegram.instance,
            reading_sequence=telegram.sequence,
            balise_id=balise.balise_id,
            position_m=balise.position_m,
            position_variance_m2=variance_m2,
            location_accuracy_m=balise.location_accuracy_m,
            doubtful=doubtful,
        )
        yield Output("fix", self.unit, fix)
        yield from self._events(taken.found, now_ns)
        if taken.passed:
            misplaced = self._placement.passed(index, at_ns, variance_m2, now_ns)
            yield from self._events([misplaced] if misplaced else [], now_ns)

    def _events(self, found: Iterable[Irregularity], now_ns: int) -> Iterator[Output]:
        for severity, code, text, _ in found:
            if text:
                yield self.event(severity, code, text, now_ns)
