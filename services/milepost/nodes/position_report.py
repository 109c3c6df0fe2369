"""The process that reports a train's position as ERTMS/ETCS does, from its fused states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from milepost.feeds.position_report import BaliseGroup, OnBoard, packed, position_report
from milepost_schemas import FusedState, Message, PositionReport
from milepost_schemas.position_report import Trigger

from .base import Node, Output, Subscription


class PositionReportNode(Node):
    """Reports every `every_ns`, at each balise group, and when the train stops or starts.

    So SUBSET-026-3 wants it in 3.6.5.1.4 and 3.6.5.1.5. `groups` are the balise groups of the line that have an identity, by
    the balise's name. Others are never a reference.
    """

    subscriptions = (Subscription("state"),)

    def __init__(self, train: str, instance: str, groups: Mapping[str, BaliseGroup], on_board: OnBoard, every_ns: int) -> None:
        super().__init__(train, "etcs", instance)
        self._groups, self._on_board, self._every_ns = groups, on_board, every_ns
        self._last: FusedState | None = None
        self._group: BaliseGroup | None = None
        self._reported_ns = self._turned_ns = 0

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """A report, if one is due with this state; of two states of an epoch the first counts."""
        last = self._last
        if not isinstance(message, FusedState) or (last is not None and message.measured_at_ns <= last.measured_at_ns):
            return
        before = self._group
        if message.last_balise is not None:
            self._group = self._groups.get(message.last_balise.balise_id, before)
        self._last = message
        trigger = self._trigger(last, message, self._group != before)
        if trigger is not None:
            self._reported_ns = message.measured_at_ns
            yield self._report(message, trigger, now_ns)

    def _trigger(self, last: FusedState | None, state: FusedState, other_group: bool) -> Trigger | None:
        if last is None:
            return "first"
        if other_group:
            return "balise_group"
        stands, stood = (each.direction == "standstill" for each in (state, last))
        # a train that crawls at the threshold stops and starts with every epoch: the periodic report says so soon enough
        if stands != stood and state.measured_at_ns - self._turned_ns >= self._every_ns:
            self._turned_ns = state.measured_at_ns
            return "standstill_reached" if stands else "standstill_left"
        return "time" if state.measured_at_ns - self._reported_ns >= self._every_ns else None

    def _report(self, state: FusedState, trigger: Trigger, now_ns: int) -> Output:
        variables = position_report(state, self._group, self._on_board)
        system_version = self._on_board.system_version
        packet = packed(variables, system_version)
        del variables["nid_packet"]
        head = self.head("position_report", state.measured_at_ns, now_ns)
        why = {"epoch": state.epoch, "trigger": trigger, "system_version": system_version}
        report = PositionReport.model_validate({**head, **why, **variables, "packet_hex": packet.hex()})
        return Output("position_report", "", report)
