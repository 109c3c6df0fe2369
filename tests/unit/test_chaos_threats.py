"""What the man in the middle of the chaos suite does to messages, before any are sent."""

from __future__ import annotations

import msgpack
import pytest

from examples import EXAMPLES
from milepost.chaos.threats import DELAY_S, REPEATED, THREATS
from milepost_schemas import BY_NAME, Refused, decode, encode

STREAMS = ("speed_reading", "position_reading", "inertial_reading", "estimate")


def payloads(stream: str, number: int) -> list[bytes]:
    example = EXAMPLES[stream][0]
    return [encode(example.model_copy(update={"sequence": k})) for k in range(number)]


def sent(threat: str, stream: str = "speed_reading", number: int = 8) -> tuple[list[bytes], list[list[tuple[float, bytes]]]]:
    tamper, given = THREATS[threat](), payloads(stream, number)
    return given, [list(tamper(payload)) for payload in given]


def test_repetition_deletion_and_delay_leave_content_as_it_is() -> None:
    given, repeated = sent("repetition")
    assert repeated[-1] == [(0.0, given[-1]), *((0.0, old) for old in given[-1 - REPEATED : -1])]
    assert sent("deletion")[1] == [[]] * 8
    given, late = sent("delay")
    assert late == [[(DELAY_S, each)] for each in given]


def test_resequencing_lets_later_messages_pass_earlier_ones() -> None:
    _, out = sent("resequencing")
    assert [after_s > 0.0 for ((after_s, _),) in out] == [False, True] * 4


@pytest.mark.parametrize("stream", STREAMS)
def test_what_is_corrupted_otherwise_than_in_its_bits_cannot_be_decoded(stream: str) -> None:
    given, out = sent("corruption", stream)
    for k, ((_, payload),) in enumerate(out):
        assert payload != given[k]
        if k % 4:  # a flipped bit may give a value as good as any: nothing but the bank can tell
            with pytest.raises(Refused):
                decode(payload, BY_NAME[stream].message)


@pytest.mark.parametrize("stream", STREAMS)
def test_a_masquerade_comes_first_in_the_senders_name_with_false_content(stream: str) -> None:
    given, out = sent("masquerade", stream)
    for true, ((_, forged), (_, second)) in zip(given, out, strict=True):
        assert second == true
        message = decode(forged, BY_NAME[stream].message)
        differing = {name for name, value in msgpack.unpackb(true).items() if msgpack.unpackb(forged)[name] != value}
        assert differing
        assert not differing & {"train", "unit", "instance", "sequence", "measured_at_ns"}
        assert message.unit == msgpack.unpackb(true)["unit"]
