"""The balise service: it turns telegrams into absolute fixes with the line's balise table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from milepost.track.line import Line
from milepost_schemas import AbsoluteFix, BaliseTelegram, Message

from .base import Node, Output, Subscription


class BaliseNode(Node):
    """Looks up each telegram's balise and publishes a fix that is stamped with the time of passage."""

    def __init__(self, train: str, instance: str, readers: Sequence[str], line: Line) -> None:
        super().__init__(train, "balise", instance)
        self.subscriptions = [Subscription("balise_telegram", reader) for reader in readers]
        self._balises = {balise.balise_id: balise for balise in line.balises}

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """A fix for a telegram; an event where the balise is not in the line's table."""
        if not isinstance(message, BaliseTelegram):
            return
        balise = self._balises.get(message.balise_id)
        if balise is None:
            self.refusals.add("unknown_balise")
            yield self.event(
                "warning", "unknown_balise", f"{message.unit} read {message.balise_id}, which the line does not have", now_ns
            )
            return
        fix = AbsoluteFix(
            **self.head("fix", message.measured_at_ns, now_ns),
            reader=message.unit,
            reader_instance=message.instance,
            reading_sequence=message.sequence,
            balise_id=balise.balise_id,
            position_m=balise.position_m,
            position_variance_m2=message.reader_variance_m2,
            location_accuracy_m=balise.location_accuracy_m,
        )
        yield Output("fix", self.unit, fix)
