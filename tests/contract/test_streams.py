"""The contract: every row of the stream table keeps its promises to senders and receivers in any language."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any, get_args

import msgpack
import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from examples import examples_of, parts, replaced, values, without
from milepost.cli.schema import schema_files
from milepost.runtime.bus import PRIORITIES
from milepost_schemas import ROOT, STREAMS, Message, Refused, Stream, alive_key, decode, encode, rpc_key, simulation_start_key
from milepost_schemas.codec import unpack
from milepost_schemas.streams import Pace

each_row = pytest.mark.parametrize("row", STREAMS, ids=lambda row: row.name)

# the first value that is out of range on either side, for (schema, field) or for a field wherever it stands; None: no limit
LIMITS: dict[str, tuple[Any, Any]] = {
    "sequence": (-1, 2**63),
    "reading_sequence": (-1, 2**63),
    "component": (-1, 2**63),
    "measured_at_ns": (0, 2**63),
    "published_at_ns": (0, 2**63),
    "feedback_epoch_ns": (0, 2**63),
    "epoch": (-1, 2**63),
    "rewinds": (-1, 2**63),
    "gaps": (-1, 2**63),
    "position_m": (math.nextafter(-1e7, -math.inf), math.nextafter(1e7, math.inf)),
    "speed_mps": (math.nextafter(-200.0, -math.inf), math.nextafter(200.0, math.inf)),
    "reading.speed_max_mps": (math.nextafter(1e-3, 0.0), math.nextafter(1e4, math.inf)),
    "truth.acceleration_mps2": (math.nextafter(-20.0, -math.inf), math.nextafter(20.0, math.inf)),
    "position_reading.latitude_deg": (math.nextafter(-90.0, -math.inf), math.nextafter(90.0, math.inf)),
    "position_reading.longitude_deg": (math.nextafter(-180.0, -math.inf), math.nextafter(180.0, math.inf)),
    "speed_variance_m2ps2": (math.nextafter(1e-12, 0.0), math.nextafter(1e15, math.inf)),
    "reader_variance_m2": (math.nextafter(1e-12, 0.0), math.nextafter(1e15, math.inf)),
    "position_variance_m2": (math.nextafter(1e-12, 0.0), math.nextafter(1e15, math.inf)),
    "variance": (math.nextafter(1e-12, 0.0), math.nextafter(1e15, math.inf)),
    "value": (math.nextafter(-1e9, -math.inf), math.nextafter(1e9, math.inf)),
    "location_accuracy_m": (-5e-324, None),
    "interval_s": (-5e-324, None),
    "uptime_s": (-5e-324, None),
    "age_s": (-5e-324, None),
    "share": (-5e-324, math.nextafter(1.0, 2.0)),
}


def fields_of(message: Message) -> dict[str, Any]:
    return message.model_dump()


def refusal(fields: object, schema: type[Message]) -> Refused:
    with pytest.raises(Refused) as caught:
        decode(msgpack.packb(fields), schema)
    return caught.value


def accepted_or_refused(payload: bytes, schema: type[Message]) -> None:
    """Anything but a message or a Refused escapes and fails the test."""
    outcome = outcome_of(payload, schema)
    if isinstance(outcome, Refused):
        assert outcome.reason in {"undecodable", "invalid"}
        assert "\n" not in str(outcome)
    else:
        assert isinstance(outcome, schema)


def outcome_of(payload: bytes, schema: type[Message]) -> Message | Refused:
    try:
        return decode(payload, schema)
    except Refused as refused:
        return refused


@each_row
def test_a_decoded_message_has_the_same_fields(row: Stream) -> None:
    for message in examples_of(row):
        assert type(message) is row.message
        back = decode(encode(message), row.message)
        assert back == message
        assert fields_of(back) == fields_of(message)
        assert encode(back) == encode(message)


@each_row
def test_the_payload_is_a_plain_msgpack_map_of_the_fields(row: Stream) -> None:
    for message in examples_of(row):
        assert msgpack.unpackb(encode(message)) == fields_of(message)


@each_row
def test_the_examples_set_every_field_at_least_once(row: Stream) -> None:
    given_ = {name for message in examples_of(row) for name in row.message.model_fields if getattr(message, name) is not None}
    assert given_ == set(row.message.model_fields), "tests/examples.py: give every optional field in some example"


def test_a_key_and_a_message_together_name_one_row() -> None:
    assert len({(row.key, row.message) for row in STREAMS}) == len(STREAMS)
    assert len({row.name for row in STREAMS}) == len(STREAMS)


def test_schema_names_and_versions_name_one_message_each() -> None:
    encodings = {row.message: row.message.encoding() for row in STREAMS}
    assert len(set(encodings.values())) == len(encodings)
    for message, encoding in encodings.items():
        assert encoding == f"application/msgpack;{message.SCHEMA}/{message.VERSION}"


@each_row
def test_a_row_is_consistent(row: Stream) -> None:
    assert row.paced_by in get_args(Pace)
    assert row.cached >= 0
    assert max(len(encode(message)) for message in examples_of(row)) < row.largest_bytes / 4
    assert row.priority in PRIORITIES
    assert row.purpose
    key = row.key_for("t1", "u1")
    assert key.startswith(f"{ROOT}/t1/")
    assert ("u1" in key) == ("{unit}" in row.key)
    assert zenoh.KeyExpr(row.key_for("t1")).includes(zenoh.KeyExpr(key))


@each_row
def test_only_keys_with_an_at_sign_stay_out_of_a_wildcard(row: Stream) -> None:
    heard = zenoh.KeyExpr(f"{ROOT}/**").intersects(zenoh.KeyExpr(row.key_for("t1", "u1")))
    assert heard == ("@" not in row.key)
    assert heard == (row.name not in ("truth", "chaos"))


def test_a_wildcard_covers_tokens_but_not_calls_or_simulation_control() -> None:
    everything = zenoh.KeyExpr(f"{ROOT}/**")
    assert not everything.intersects(zenoh.KeyExpr(rpc_key("t1", "latest_feedback", "u1")))
    assert not everything.intersects(zenoh.KeyExpr(simulation_start_key("t1")))
    assert everything.includes(zenoh.KeyExpr(alive_key("t1", "u1", "i1")))


@each_row
def test_unknown_fields_are_ignored_at_every_depth(row: Stream) -> None:
    for message in examples_of(row):
        for at, _ in parts(message):
            for extra in ({"deep": [1, None]}, "text", 1.5, None):
                fields = replaced(fields_of(message), (*at, "added_later"), extra)
                assert decode(msgpack.packb(fields), row.message) == message


@each_row
def test_each_missing_required_field_is_refused_by_name(row: Stream) -> None:
    count = 0
    for message in examples_of(row):
        for at, part in parts(message):
            for name, field in type(part).model_fields.items():
                if field.is_required():
                    refused = refusal(without(fields_of(message), (*at, name)), row.message)
                    assert refused.reason == "invalid"
                    assert ".".join(str(step) for step in (*at, name)) in refused.detail
                    count += 1
    assert count >= 6


def wrong_types(value: Any) -> list[Any]:
    """Values of other types, as a sender in another language might make them by mistake."""
    if isinstance(value, bool):
        return [0, 1, "true", 1.0, [], {}]
    if isinstance(value, int):
        return [float(value), str(value), True, [value], {"value": value}, b"1"]
    if isinstance(value, float):
        return [str(value), True, False, [value], {"value": value}, b"1.0"]
    if isinstance(value, str):
        return [1, 1.0, True, [value], {"value": value}, value.encode()]
    if isinstance(value, list):
        return ["text", 1, {}, {str(i): item for i, item in enumerate(value)}, b""]
    if isinstance(value, dict):
        return ["text", 1, [], list(value.values()), b""]
    raise AssertionError(f"an example has a {type(value).__name__}: say here what is not one")


@each_row
def test_each_ill_typed_field_is_refused(row: Stream) -> None:
    for message in examples_of(row):
        for at, value in values(fields_of(message)):
            if value is None:
                continue
            for wrong in wrong_types(value):
                refused = refusal(replaced(fields_of(message), at, wrong), row.message)
                assert refused.reason == "invalid", (at, wrong)
                assert str(at[0]) in refused.detail, (at, wrong)


@each_row
def test_a_required_field_may_not_be_null(row: Stream) -> None:
    for message in examples_of(row):
        for at, part in parts(message):
            for name, field in type(part).model_fields.items():
                if field.is_required():
                    refusal(replaced(fields_of(message), (*at, name), None), row.message)


@each_row
def test_a_whole_number_is_accepted_as_a_float(row: Stream) -> None:
    """JavaScript's encoders write 20.0 as 20."""
    for message in examples_of(row):
        for at, value in values(fields_of(message)):
            if isinstance(value, float) and value.is_integer():
                assert decode(msgpack.packb(replaced(fields_of(message), at, int(value))), row.message) == message


@each_row
def test_not_a_number_and_infinity_are_refused_in_every_float(row: Stream) -> None:
    for message in examples_of(row):
        for at, value in values(fields_of(message)):
            if isinstance(value, float):
                for bad in (math.nan, math.inf, -math.inf):
                    assert str(at[0]) in refusal(replaced(fields_of(message), at, bad), row.message).detail, at


def limits_of(row: Stream, at: tuple[str | int, ...]) -> str | None:
    """The entry of LIMITS for a value."""
    family = "reading" if row.key.startswith("reading") else row.name
    names = (f"{row.message.SCHEMA}.{at[-1]}", f"{family}.{at[-1]}", str(at[-1]))
    return next((name for name in names if name in LIMITS), None)


def test_every_limit_belongs_to_a_value_in_an_example() -> None:
    used = {limits_of(row, at) for row in STREAMS for m in examples_of(row) for at, _ in values(fields_of(m))}
    assert used - {None} == set(LIMITS)


@each_row
def test_a_value_beyond_its_physical_range_is_refused_by_name(row: Stream) -> None:
    for message in examples_of(row):
        for at, value in values(fields_of(message)):
            name = limits_of(row, at)
            if value is None or name is None:
                continue
            where = ".".join(str(step) for step in at)
            for beyond, inwards in zip(LIMITS[name], (math.inf, -math.inf), strict=True):
                if beyond is None:
                    continue
                assert where in refusal(replaced(fields_of(message), at, beyond), row.message).detail
                limit = beyond + int(math.copysign(1, inwards)) if isinstance(beyond, int) else math.nextafter(beyond, inwards)
                # another rule of the message may object to the limit, this field's range may not
                outcome = outcome_of(msgpack.packb(replaced(fields_of(message), at, limit)), row.message)
                assert isinstance(outcome, row.message) or f"{where}:" not in outcome.detail


@each_row
def test_names_are_valid_parts_of_a_key(row: Stream) -> None:
    message = examples_of(row)[0]
    for field in ("train", "unit", "instance"):
        for bad in ("", "a/b", "*", "**", "A", "a b", "@sim", "-a", "a" * 64, "a\n", "é", "$*", "a?b", "a#b"):
            assert field in refusal(replaced(fields_of(message), (field,), bad), row.message).detail, bad


def test_a_speed_reading_is_either_a_value_with_variance_or_a_bound() -> None:
    value, bound = (fields_of(message) for message in examples_of(STREAMS[0]))
    schema = STREAMS[0].message
    for fields in (
        without(value, ("speed_variance_m2ps2",)),
        without(value, ("speed_mps",)),
        {**value, "speed_max_mps": 21.0},
        {**bound, "speed_variance_m2ps2": 0.1},
        without(bound, ("speed_max_mps",)),
    ):
        refusal(fields, schema)


def test_a_state_lies_inside_its_own_interval() -> None:
    row = next(row for row in STREAMS if row.name == "state")
    fields = fields_of(examples_of(row)[0])
    for name, bad in (("position_min_m", 1235.0), ("position_max_m", 1234.0), ("speed_min_mps", 21.0), ("speed_max_mps", 20.0)):
        assert "interval" in refusal({**fields, name: bad}, row.message).detail


@pytest.mark.parametrize("name", ["estimate", "feedback"])
def test_a_gaussian_has_matching_sizes_and_begins_with_common_states(name: str) -> None:
    row = next(row for row in STREAMS if row.name == name)
    fields = fields_of(examples_of(row)[0])
    part = "belief" if name == "estimate" else "fused"
    gaussian = fields[part]
    for changes in (
        {"mean": gaussian["mean"][:3]},
        {"states": [*gaussian["states"], "more"]},
        {"covariance": [line[:3] for line in gaussian["covariance"][:3]]},
        {"states": ["speed_mps", "position_m", *gaussian["states"][2:]]},
    ):
        assert part in refusal({**fields, part: {**gaussian, **changes}}, row.message).detail


WITH_COVARIANCE = [row for row in STREAMS if any(at[-1] == "covariance" for at, _ in values(fields_of(examples_of(row)[0])))]


@pytest.mark.parametrize("row", WITH_COVARIANCE, ids=lambda row: row.name)
def test_an_invalid_covariance_is_refused(row: Stream) -> None:
    for message in examples_of(row):
        (at, value) = next((at, value) for at, value in values(fields_of(message)) if at[-1] == "covariance")
        asymmetrical = replaced({"m": value}, ("m", 0, 1), 0.4)["m"]
        indefinite = replaced(replaced({"m": value}, ("m", 0, 1), 3.0), ("m", 1, 0), 3.0)["m"]
        for bad in (asymmetrical, indefinite, value[:-1], []):
            refusal(replaced(fields_of(message), at, bad), row.message)


def test_beliefs_and_states_carry_a_covariance() -> None:
    assert {row.name for row in WITH_COVARIANCE} == {"candidate", "estimate", "feedback", "state"}


@each_row
def test_every_truncated_payload_is_refused(row: Stream) -> None:
    for message in examples_of(row):
        payload = encode(message)
        for size in range(len(payload)):
            with pytest.raises(Refused) as caught:
                decode(payload[:size], row.message)
            assert caught.value.reason == "undecodable"


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x81", b"\x01\x02", b"\xd9\x02\xff\xfe"])
def test_a_payload_that_is_no_msgpack_is_refused_with_a_reason(payload: bytes) -> None:
    with pytest.raises(Refused) as caught:
        unpack(payload)
    assert caught.value.reason == "undecodable"
    assert re.fullmatch(r"not msgpack: \S.*", caught.value.detail)


@each_row
def test_bytes_after_the_end_are_refused(row: Stream) -> None:
    payload = encode(examples_of(row)[0])
    for tail in (b"\x00", b"\xc0", payload):
        with pytest.raises(Refused, match="undecodable"):
            decode(payload + tail, row.message)


@each_row
@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        b"\x91" * 100_000,
        b"\x81\xa1a" * 50_000,
        b"\xdf\xff\xff\xff\xff",
        b"\xdd\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\xa4\xff\xfe\xfd\xfc",
        b"\x81\x01\x02",
        b"\x81\xa5train\xd6\xff\x00\x00\x00\x00",
        b'{"train": "maglev-1"}',
        b"\xc0",
        b"\x90",
        b"\x80",
    ],
    ids=["empty", "reserved", "deep-lists", "deep-maps", "huge-map", "huge-list", "huge-bytes", "not-utf8", "number-key",
         "timestamp", "json", "null", "empty-list", "empty-map"],
)  # fmt: skip
def test_hostile_payloads_are_refused(row: Stream, payload: bytes) -> None:
    with pytest.raises(Refused):
        decode(payload, row.message)


@each_row
@given(payload=st.binary(max_size=400))
def test_random_bytes_raise_only_refused(row: Stream, payload: bytes) -> None:
    accepted_or_refused(payload, row.message)


@each_row
@given(data=st.data())
def test_flipped_bytes_raise_only_refused(row: Stream, data: st.DataObject) -> None:
    payload = bytearray(encode(data.draw(st.sampled_from(examples_of(row)))))
    for _ in range(data.draw(st.integers(1, 8))):
        payload[data.draw(st.integers(0, len(payload) - 1))] ^= data.draw(st.integers(1, 255))
    accepted_or_refused(bytes(payload), row.message)


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=8) | st.binary(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=12,
)


@each_row
@given(data=st.data())
def test_any_replaced_value_raises_only_refused(row: Stream, data: st.DataObject) -> None:
    fields = fields_of(data.draw(st.sampled_from(examples_of(row))))
    at = data.draw(st.sampled_from([at for at, _ in values(fields)]))
    accepted_or_refused(msgpack.packb(replaced(fields, at, data.draw(ANYTHING))), row.message)


def test_the_schema_files_are_those_of_the_table_and_no_others(root: Path) -> None:
    folder = root / "schemas" / "json"
    expected = schema_files()
    assert {path.name for path in folder.iterdir()} == set(expected), "run `make schema` and remove what is left over"
    for name, content in expected.items():
        assert (folder / name).read_text(encoding="utf-8") == content, f"{name}: run `make schema`"
