"""A stranger who answers what processes ask after a restart moves nobody: most of the train knows better."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgpack
import pytest

from conftest import Outside, Stack, widest_m, width_m

pytestmark = pytest.mark.long

TOP = "milepost/v1/maglev-1"
STATE = f"{TOP}/state"


def position_off_m(outside: Outside, state: dict) -> float:
    """How far a state is outside its own interval from the truth, or 0."""

    def truth():
        return next((t for t in outside.messages(f"{TOP}/@sim/truth") if t["measured_at_ns"] == state["measured_at_ns"]), None)

    true = outside.wait_for(truth, 5.0, "the truth of that epoch")
    return max(state["position_min_m"] - true["position_m"], true["position_m"] - state["position_max_m"], 0.0)


@contextmanager
def forged(outside: Outside, key: str, answer: Callable[[], bytes]) -> Iterator[list[str]]:
    """A queryable that answers everybody; yields who has asked."""
    asked: list[str] = []

    def reply(query):
        with query:
            asked.append(str(query.selector))
            query.reply(key, answer())

    queryable = outside.session.declare_queryable(key, reply)
    try:
        yield asked
    finally:
        queryable.undeclare()


# `filter-radar` is a process of the train, whose own answer is another one
@pytest.mark.parametrize("name", ["stranger", "filter-radar", "world"])
def test_a_forged_state_with_the_newest_stamp_moves_no_restarted_fuser(maglev: tuple[Stack, Outside], name: str) -> None:
    stack, outside = maglev
    outside.wait_state(STATE, lambda m: m["status"] == "normal", 20.0, "a normal state")
    lie = dict(outside.there(f"{TOP}/feedback"))
    size = len(lie["fused"]["mean"])
    lie["fused"]["mean"] = [lie["fused"]["mean"][0] + 1000.0, 1.0, *lie["fused"]["mean"][2:]]
    lie["fused"]["covariance"] = [[1e-4 * (i == k) for k in range(size)] for i in range(size)]
    for field in ("position_min_m", "position_max_m", "speed_min_mps", "speed_max_mps"):
        lie[field] = None

    def newest() -> bytes:
        now = time.time_ns()
        return msgpack.packb({**lie, "measured_at_ns": now, "published_at_ns": now})

    with forged(outside, f"{TOP}/@rpc/latest_feedback/{name}", newest) as asked:
        old = outside.newest(STATE)["instance"]
        os.kill(stack.pid_of("fuser"), signal.SIGKILL)
        new = outside.wait_state(STATE, lambda m: m["instance"] != old, 20.0, "a state of the new fuser")
        outside.wait_state(STATE, lambda m: m["epoch"] > new["epoch"] + 50, 10.0, "a second more")
    assert asked
    seen, before = ([m for m in outside.messages(STATE) if m["instance"] == each] for each in (new["instance"], old))
    assert max(position_off_m(outside, state) for state in seen[:50:10]) == 0.0
    assert width_m(seen[0]) < widest_m(before[-1], seen[0]), "it continues from what the train remembers"
    outside.wait_state(STATE, lambda m: m["status"] == "normal", 20.0, "normal again")


def test_a_forged_start_of_scenario_time_moves_no_restarted_sensor(maglev: tuple[Stack, Outside]) -> None:
    """WHEN a sensor restarts that a stranger tells another start, THEN its readings are still those of this train."""
    stack, outside = maglev
    reading = f"{TOP}/reading/radar"
    (reply,) = [r for r in outside.session.get(f"{TOP}/@sim/start") if r.ok is not None]
    told = msgpack.unpackb(reply.ok.payload.to_bytes())
    lie = msgpack.packb({**told, "start_ns": told["start_ns"] - 60_000_000_000})
    with forged(outside, f"{TOP}/@sim/start", lambda: lie) as asked:
        old = outside.there(reading)["instance"]
        os.kill(stack.pid_of("sensor", "radar"), signal.SIGKILL)
        outside.wait_for(lambda: outside.newest(reading)["instance"] != old, 20.0, "a reading of the new sensor")
        outside.wait_state(STATE, lambda m: m["status"] == "normal", 20.0, "normal again")
    assert asked
    now = outside.newest(reading)
    assert abs(now["measured_at_ns"] - time.time_ns()) < 1_000_000_000
    assert now["speed_mps"] == pytest.approx(outside.newest(STATE)["speed_mps"], abs=2.0)


def test_a_stranger_who_takes_all_questions_and_answers_none_keeps_no_answer_away(maglev: tuple[Stack, Outside]) -> None:
    """A queryable that calls itself complete: Zenoh asks such a one alone, unless all are asked for."""
    stack, outside = maglev
    outside.wait_state(STATE, lambda m: m["status"] == "normal", 20.0, "a normal state")
    asked: list[str] = []

    def ignore(query):
        with query:
            asked.append(str(query.selector))

    queryable = outside.session.declare_queryable(f"{TOP}/@rpc/**", ignore, complete=True)
    try:
        old = outside.newest(STATE)["instance"]
        os.kill(stack.pid_of("fuser"), signal.SIGKILL)
        new = outside.wait_state(STATE, lambda m: m["instance"] != old, 20.0, "a state of the new fuser")
    finally:
        queryable.undeclare()
    assert asked
    assert position_off_m(outside, new) == 0.0, "it begins with its prior, not with what the train remembers"
    outside.wait_state(STATE, lambda m: m["status"] == "normal", 20.0, "normal again")
