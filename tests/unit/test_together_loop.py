"""The loop that runs many nodes in one thread: messages before what is due, what is due in order, none of it lost."""

from __future__ import annotations

import queue
import time
from typing import Any

from milepost.runtime.bus import Stop
from milepost.runtime.clock import Clock
from milepost.runtime.together.loop import LabelledInbox, Loop, Seat

MS = 1_000_000


class Invented:
    """A runner with turns of its own, that notes them and may send to others' inboxes."""

    def __init__(self, name: str, done: list[str], due_ns: list[int], sends: list[LabelledInbox] | None = None) -> None:
        self.name, self.done, self.due_ns = name, done, due_ns
        self.sends = sends or []
        self.over = self.orphaned = False

    def wake_ns(self) -> int:
        return self.due_ns[0] if self.due_ns else time.time_ns() + 3600_000 * MS

    def turn(self, item: Any) -> None:
        self.done.append(f"{self.name} takes {item}" if item is not None else f"{self.name} is due")
        if item is None:
            self.due_ns.pop(0)
            for inbox in self.sends:
                inbox.put(self.name)
            self.over = not self.due_ns


def made(done: list[str], *due_ns: list[int]) -> tuple[Loop, list[Invented], list[LabelledInbox]]:
    """A loop of runners a, b and so on, with these times."""
    ready: queue.SimpleQueue[int] = queue.SimpleQueue()
    inboxes = [LabelledInbox(label, ready) for label in range(len(due_ns))]
    runners = [Invented(chr(ord("a") + label), done, list(times)) for label, times in enumerate(due_ns)]
    seats: Any = [Seat(runner, inbox, Clock()) for runner, inbox in zip(runners, inboxes, strict=True)]  # type: ignore[arg-type]
    return Loop(seats, ready), runners, inboxes


def test_what_a_turn_sends_is_taken_before_anything_else_that_is_due() -> None:
    """GIVEN two sensors that are due at once, THEN the first one's reading is taken before the second one reads."""
    done: list[str] = []
    now_ns = time.time_ns()
    loop, (first, _, fuser), inboxes = made(done, [now_ns - 2 * MS], [now_ns - MS], [])
    first.sends = [inboxes[2]]
    assert [loop.step() for _ in range(3)] == [[0], [], [1]]
    assert done == ["a is due", "c takes a", "b is due"]
    assert not fuser.over


def test_what_is_due_comes_in_order_and_in_its_time() -> None:
    done: list[str] = []
    now_ns = time.time_ns()
    loop, _, _ = made(done, [now_ns + 30 * MS, now_ns + 50 * MS], [now_ns + 40 * MS, now_ns + 60 * MS])
    for _ in range(4):
        loop.step()
    assert done == ["a is due", "b is due", "a is due", "b is due"]
    assert time.time_ns() >= now_ns + 60 * MS


def test_messages_that_never_end_do_not_keep_back_what_has_been_due_for_long() -> None:
    done: list[str] = []
    loop, _, inboxes = made(done, [time.time_ns() - 5000 * MS], [])
    for _ in range(100):
        inboxes[1].put("flood")
    loop.step()
    assert done == ["a is due"]


def test_who_is_over_takes_nothing_more() -> None:
    done: list[str] = []
    loop, _, inboxes = made(done, [time.time_ns()], [])
    assert loop.step() == [0]
    inboxes[0].put("late")
    assert loop.step() == []
    assert done == ["a is due"]


def test_a_stop_ends_it_all() -> None:
    loop, _, inboxes = made([], [time.time_ns() + 1000 * MS], [])
    inboxes[1].put(Stop())
    assert loop.step() is None
