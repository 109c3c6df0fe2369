"""How the recording of a train is doing, once a second."""

from __future__ import annotations

import time
import uuid
from typing import Any

from milepost.config.train import Train
from milepost.nodes.base import Node
from milepost.recorder.recorder import Recorder
from milepost.recorder.scenario_clock import SIMULATION, simulation_facts
from milepost_schemas import Health, SimulationStart, simulation_start_key

from ..bus import ZenohBus
from ..clock import Clock
from ..logs.records import log_event
from ..together.part import declare_alive
from .intake import Intake

NAME = "recorder"
ASK_FOR_S = 0.5
LOST = "overflow"


class Reporter:
    """Tells once a second how the recording of a train is doing and what has happened to it."""

    def __init__(self, train: Train, bus: ZenohBus, recorder: Recorder, intake: Intake) -> None:
        self._train = train
        self._bus = bus
        self._recorder = recorder
        self._intake = intake
        self._node = Node(train.name, NAME, uuid.uuid4().hex[:8])
        self._clock = Clock()
        self._start: SimulationStart | None = None
        self._begun_s = self._since_s = time.monotonic()
        self._before: dict[str, int] = {}
        self._lost_before = 0

    def appear(self) -> None:
        """Show a token."""
        declare_alive(self._bus, self._node, NAME)

    def once_a_second(self) -> None:
        """Send health, and what has happened."""
        if self._train.has_scenario_time and self._start is None:
            self._ask_for_start()
        now_ns, lost = self._clock.now_ns(), self._intake.lost_of(self._train.name)
        while self._recorder.notices:
            severity, code, text = self._recorder.notices.pop(0)
            self._tell(severity, code, text, now_ns)
        if lost > self._lost_before:
            text = f"{lost - self._lost_before} messages are missing: they came faster than the disk takes them"
            self._tell("error", "messages_lost", text, now_ns)
            self._lost_before = lost
        self._bus.publish("health", NAME, self._health(now_ns, lost))

    def _tell(self, severity: Any, code: str, text: str, now_ns: int) -> None:
        event = self._node.event(severity, code, text, now_ns)
        self._bus.publish(*event)
        log_event(event.message)

    def _ask_for_start(self) -> None:
        told = self._bus.ask(simulation_start_key(self._train.name), SimulationStart, ASK_FOR_S)
        if told:
            self._start = told[0][1]
            self._clock = Clock(self._start)
            facts, recorder = simulation_facts(self._start.start_ns, self._start.speed), self._recorder
            self._intake.tell(lambda: recorder.describe(SIMULATION, facts, time.time_ns()))

    def _health(self, now_ns: int, lost: int) -> Health:
        now_s, received = time.monotonic(), dict(self._recorder.received)
        span = max(now_s - self._since_s, 1e-3)
        rates = {name: (count - self._before.get(name, 0)) / span for name, count in received.items()}
        self._since_s, self._before = now_s, received
        return Health(
            **self._node.head("health", now_ns, now_ns),
            uptime_s=now_s - self._begun_s,
            received_hz=rates,
            sent_hz={"health": 1.0},
            refused={**self._recorder.refused, **({LOST: lost} if lost else {})},
            rewinds=0,
            gaps=self._recorder.gaps.missing,
        )
