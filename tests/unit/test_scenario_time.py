"""When scenario time began, as a process that starts later is told: by `world`, or by most of those that know it."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from milepost.chaos.running import free_port
from milepost.runtime import scenario_time, zenoh_config
from milepost.runtime.bus import Stop, ZenohBus, open_session
from milepost_schemas import SimulationStart

TRAIN = "t"
KNOWN = {"world", "fuser", "filter-radar", "sensor-radar", "sensor-loop"}
START = SimulationStart(start_ns=1_700_000_000_000_000_000, speed=1.0, end_ns=1_700_000_060_000_000_000)
OTHER = START.model_copy(update={"start_ns": START.start_ns + 5_000_000_000})


class Asker:
    """A process that waits for the start, in a thread."""

    def __init__(self, bus: ZenohBus) -> None:
        self.bus = bus
        self._told: queue.SimpleQueue[SimulationStart | None] = queue.SimpleQueue()
        threading.Thread(target=lambda: self._told.put(scenario_time.wait_for_start(bus, KNOWN)), daemon=True).start()

    def told(self, within_s: float) -> SimulationStart | None:
        """What it was told; raises queue.Empty where it waits on."""
        return self._told.get(timeout=within_s)


@pytest.fixture
def buses() -> Iterator[tuple[ZenohBus, ZenohBus]]:
    """Of one who asks and of those that answer, on a router."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        stack.enter_context(
            open_session({"mode": "router", "listen": {"endpoints": [endpoint]}, "scouting": {"multicast": {"enabled": False}}})
        )
        asks, answers = (ZenohBus(stack.enter_context(open_session(zenoh_config.client([endpoint]))), TRAIN) for _ in range(2))
        yield asks, answers


def test_most_of_the_train_say_it_where_worlds_own_answer_does_not_come(buses: tuple[ZenohBus, ZenohBus]) -> None:
    """A router that was replaced knew the tokens and answers of 18 processes, and for good no answer of `world`."""
    asks, answers = buses
    kept = [scenario_time.remember(answers, name, START) for name in ("fuser", "filter-radar", "sensor-radar")]
    assert Asker(asks).told(10.0) == START
    assert kept


@pytest.mark.parametrize("names", [("fuser", "filter-radar"), ("stranger", "another", "a third", "fuser")])
def test_less_than_most_of_the_train_are_not_believed_before_world_speaks(names: tuple[str, ...], buses) -> None:
    asks, answers = buses
    kept = [scenario_time.remember(answers, name, OTHER) for name in names]
    asker = Asker(asks)
    with pytest.raises(queue.Empty):
        asker.told(1.0)
    asks.inbox.put(Stop())
    assert asker.told(10.0) is None
    assert kept


def test_what_world_says_counts_at_once_where_nobody_else_knows(buses: tuple[ZenohBus, ZenohBus]) -> None:
    asks, answers = buses
    asker = Asker(asks)
    announced = scenario_time.announce(answers, START)
    assert asker.told(10.0) == START
    announced.undeclare()
