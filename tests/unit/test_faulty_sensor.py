"""A sensor's process that lies: on command, and without a reading that no message can hold."""

from __future__ import annotations

from typing import Any

import pytest

from examples import T0, head, sensor, straight_line, world
from milepost.nodes.base import Output, Subscription
from milepost.nodes.faulty import FaultySensor
from milepost.nodes.sensor import SensorNode
from milepost.simulation.faults import FaultEntry, Injection, Surroundings
from milepost_schemas import Event, FaultCommand, SpeedReading

S = 1_000_000_000
# a command comes between two readings
LATER = 5_000_000


def lying(*faults: FaultEntry, takes_commands: bool = True) -> FaultySensor:
    """A radar at 100 Hz on a train at 20 m/s for 100 s."""
    on = world()
    radar = sensor("doppler_radar", straight_line(), "radar")
    inner = SensorNode("t1", "i1", radar, radar.open(on, 0.0), T0)
    around = Surroundings("radar", "speed_reading", "doppler_radar", on.line, on.motion)
    return FaultySensor(inner, Injection(around, T0, faults), takes_commands)


def readings(outputs: Any) -> list[SpeedReading]:
    return [output.message for output in outputs if output.stream == "speed_reading"]


def command(kind: str | None, **fields: Any) -> FaultCommand:
    return FaultCommand(**head("radar", instance="inject-1"), kind=kind, **fields)


def answer(node: FaultySensor, kind: str | None, at_ns: int, **fields: Any) -> Event:
    (output,) = node.step(command(kind, **fields), at_ns)
    assert isinstance(output, Output)
    assert isinstance(output.message, Event)
    return output.message


def test_a_command_begins_a_fault_that_ends_by_itself() -> None:
    node, honest = lying(), lying()
    before = readings(node.tick(T0 + S))
    said = answer(node, "bias", T0 + S + LATER, for_s=1.0, numbers={"size": 5.0})
    after = readings(node.tick(T0 + 3 * S))
    assert (said.severity, said.code) == ("warning", "fault_injected")
    assert said.text == "radar: fault injected: bias (size 5) for 1 s (inject-1)"
    expected = [*readings(honest.tick(T0 + S)), *readings(honest.tick(T0 + 3 * S))]
    lies = [a for a, b in zip([*before, *after], expected, strict=True) if a != b]
    assert {round((m.measured_at_ns - T0) / 1e7) for m in lies} == set(range(101, 201))


def test_a_command_without_a_fault_ends_all() -> None:
    node = lying()
    answer(node, "stuck", T0 + S + LATER)
    answer(node, "drop_out", T0 + S + LATER)
    assert readings(node.tick(T0 + 2 * S))[-1].measured_at_ns == T0 + S
    assert answer(node, None, T0 + 2 * S + LATER).text == "radar: injected faults ended: stuck, drop_out (inject-1)"
    again = readings(node.tick(T0 + 3 * S))
    assert len({m.speed_mps for m in again}) > 90
    assert again[0].sequence == 101
    assert answer(node, None, T0 + 3 * S).text == "radar: injected faults ended: there was none (inject-1)"


@pytest.mark.parametrize(
    ("kind", "fields", "says"),
    [
        ("broken", {}, "kind: must be one of bias"),
        ("bias", {}, "size: required"),
        ("duplicate", {"numbers": {"times": 1.5}}, "times: Input should be a valid integer"),
        ("jump", {"numbers": {"size": 5.0}}, "jump does not fit speed_reading"),
        ("bias", {"words": {"size": "five"}}, "size: Input should be a valid number"),
    ],
)
def test_a_command_that_cannot_be_obeyed_is_refused(kind: str, fields: dict[str, Any], says: str) -> None:
    node = lying()
    said = answer(node, kind, T0 + S, **fields)
    assert said.code == "fault_refused"
    assert says in said.text
    assert readings(node.tick(T0 + 2 * S)) == readings(lying().tick(T0 + 2 * S))


def test_a_fault_of_a_balise_that_the_line_does_not_have_is_refused() -> None:
    on, line = world(), straight_line(1000.0)
    reader = sensor("balise_reader", line, "reader")
    inner = SensorNode("t1", "i1", reader, reader.open(on, 0.0), T0)
    around = Surroundings("reader", "balise_telegram", "balise_reader", line, on.motion)
    node = FaultySensor(inner, Injection(around, T0), takes_commands=True)
    said = answer(node, "missed_balise", T0 + S, words={"balise": "b0000"})
    assert said.code == "fault_refused"
    assert "balise: b0000 is not among the 10 of test-line; did you mean 'b00010'?" in said.text
    assert answer(node, "missed_balise", T0 + S, words={"balise": "b00003"}).code == "fault_injected"


def test_a_command_cannot_name_another_unit_or_time() -> None:
    node = lying()
    answer(node, "drop_out", T0 + S + LATER, numbers={"from_s": 50.0, "for_s": 1.0}, words={"unit": "loop"})
    assert readings(node.tick(T0 + 3 * S))[-1].measured_at_ns == T0 + S


def test_a_count_is_understood_as_a_count() -> None:
    node = lying()
    assert answer(node, "duplicate", T0 + S, numbers={"times": 2.0}).code == "fault_injected"


def test_only_a_train_that_allows_it_listens() -> None:
    assert Subscription("chaos", "radar") in lying().subscriptions
    assert not lying(takes_commands=False).subscriptions


def test_a_reading_that_no_message_can_hold_is_refused_and_reported_once() -> None:
    node = lying(FaultEntry.model_validate({"unit": "radar", "kind": "scale", "from_s": 0.5, "for_s": 1.0, "factor": 1e6}))
    outputs = list(node.tick(T0 + 2 * S))
    (event,) = [output.message for output in outputs if output.stream == "event"]
    assert isinstance(event, Event)
    assert event.code == "refused_invalid_reading"
    assert "radar: speed_mps" in event.text
    assert node.refusals.counts == {"invalid_reading": 100}
    assert [m.sequence for m in readings(outputs)] == list(range(101))


def test_it_is_finished_when_the_last_delayed_reading_is_sent() -> None:
    node = lying(FaultEntry.model_validate({"unit": "radar", "kind": "delay", "from_s": 99.5, "by_s": 2.0}))
    node.tick(T0 + 100 * S)
    assert not node.finished
    assert node.next_tick_ns() is not None
    assert readings(node.tick(T0 + 103 * S))[-1].measured_at_ns == T0 + 100 * S
    assert node.finished
