"""One key that is flooded takes neither the inbox nor the time of the others."""

from __future__ import annotations

import msgpack
import pytest

from examples import EXAMPLES
from milepost.estimation.time_units import NS_PER_S
from milepost.runtime.inbox.flood import MOST_KEYS, MOST_WAITING, Gate, Waiting
from milepost_schemas import Refused

KEY = "milepost/v1/t/reading/radar"
FIELDS = EXAMPLES["speed_reading"][0].model_dump()


def passes(gate: Gate, now_ns: int, key: str = KEY, **changed: object) -> str:
    """Why the gate refuses a reading; empty where it does not."""
    fields = {**FIELDS, **changed}
    payload = msgpack.packb(fields)
    try:
        gate.refuse_repeated(key, payload)
        gate.pass_through("speed_reading", key, payload, fields, now_ns)
    except Refused as refused:
        return refused.reason
    return ""


def test_a_key_holds_only_so_many_places() -> None:
    waiting = Waiting()
    assert sum(waiting.enters(KEY) for _ in range(20_000)) == MOST_WAITING
    assert waiting.dropped == 20_000 - MOST_WAITING
    assert waiting.enters("another key")
    waiting.leaves(KEY)
    assert waiting.enters(KEY)
    assert not waiting.enters(KEY)


def test_keys_without_end_are_counted_as_one() -> None:
    waiting = Waiting()
    admitted = sum(waiting.enters(f"milepost/v1/t/reading/u{i}") for i in range(MOST_KEYS + 20_000))
    assert admitted == MOST_KEYS + MOST_WAITING
    for i in range(20_000):
        waiting.leaves(f"milepost/v1/t/reading/u{MOST_KEYS + i}")
    assert waiting.enters("one more key")


def test_a_message_that_came_before_is_refused_and_takes_nothing_from_new_ones() -> None:
    gate = Gate({"speed_reading": 20.0})
    assert passes(gate, 0) == ""
    assert {passes(gate, i) for i in range(20_000)} == {"duplicate"}
    assert passes(gate, 20_000, sequence=8) == ""
    assert passes(gate, 20_000, instance="another") == ""
    assert passes(gate, 20_000, speed_mps="fast") == "", "another content under the same number is its schema's matter"


@pytest.mark.parametrize(("expected_hz", "limit"), [(20.0, 200), (1.0, 100)])
def test_a_key_is_ten_times_as_fast_as_expected_at_most(expected_hz: float, limit: int) -> None:
    """WHEN 20 000 different messages come in a second, THEN the first burst and the limit pass, and another key's all."""
    gate = Gate({"speed_reading": expected_hz})
    step_ns = NS_PER_S // 20_000
    told = [passes(gate, i * step_ns, sequence=i) for i in range(20_000)]
    assert told.count("") == pytest.approx(2 * limit, abs=2)
    assert set(told) == {"", "flood"}
    assert passes(gate, NS_PER_S, "milepost/v1/t/reading/loop", sequence=1) == ""
    assert passes(gate, 3 * NS_PER_S, sequence=99_999) == "", "it passes again after the flood"


def test_what_waited_while_a_process_was_stopped_passes_at_once() -> None:
    gate = Gate({"speed_reading": 100.0})
    assert {passes(gate, 5 * NS_PER_S, sequence=i) for i in range(500)} == {""}


@pytest.mark.parametrize("fields", [None, [], {}, {"instance": 1, "sequence": "x"}])
def test_what_is_no_message_is_left_to_its_schema(fields: object) -> None:
    gate = Gate({})
    for _ in range(1000):
        gate.refuse_repeated(KEY, b"x")
        gate.pass_through("speed_reading", KEY, b"x", fields, 0)
    assert passes(gate, 0) == "", "it takes nothing from a message"


def test_keys_without_end_share_one_limit() -> None:
    gate = Gate({"speed_reading": 10.0})
    told = [passes(gate, 0, f"milepost/v1/t/reading/u{i}", sequence=i) for i in range(MOST_KEYS + 1000)]
    assert told == [""] * (MOST_KEYS + 100) + ["flood"] * 900
