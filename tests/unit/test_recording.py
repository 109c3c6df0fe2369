"""Recorded messages read back as they were written; a bad line is refused, counted, told once, and the rest goes on."""

from __future__ import annotations

import io
import json
import random
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from examples import EXAMPLES, T0, examples_of, head, write_train
from milepost.config.train import Train, load_train
from milepost.nodes.base import Output
from milepost.offline.message_log import Reader, write_line
from milepost_schemas import STREAMS, Message, SpeedReading

RECEIVED = T0 + 20_000_000


@pytest.fixture(scope="module")
def train(tmp_path_factory: pytest.TempPathFactory) -> Train:
    changes = {"train": "maglev-1"}
    return load_train(write_train(tmp_path_factory.mktemp("train"), changes))


def reading(sequence: int = 0, **changed: Any) -> dict[str, Any]:
    """A good line of a recording."""
    message = SpeedReading(**head(sequence=sequence, published_at_ns=T0 + sequence), speed_mps=20.0, speed_variance_m2ps2=0.04)
    line = {"key": "milepost/v1/maglev-1/reading/radar", "received_at_ns": RECEIVED, "payload": message.model_dump()}
    return {**line, **changed}


def payload(**changed: Any) -> dict[str, Any]:
    return {**reading()["payload"], **changed}


def reader(folder: Path, train: Train, lines: list[bytes], kinds: tuple[str, ...] = ("reading",)) -> Reader:
    path = folder / "recording.jsonl"
    path.write_bytes(b"\n".join(lines) + b"\n")
    return Reader(path, train, kinds)


def as_bytes(line: Any) -> bytes:
    return json.dumps(line).encode()


@pytest.mark.parametrize("row", STREAMS, ids=lambda row: row.name)
def test_a_written_message_reads_back_equal(tmp_path: Path, train: Train, row: Any) -> None:
    # a train without an inertial unit has no inertial readings to read
    if row.name == "inertial_reading":
        train = load_train(write_train(tmp_path, {"train": "maglev-1", "units.imu": {"kind": "imu"}}))
    # and one without a GNSS receiver no position readings
    if row.name == "position_reading":
        folder = tmp_path / "gnss"
        folder.mkdir()
        (folder / "l.geojson").write_text('{"type": "LineString", "coordinates": [[4.5, 50.9], [4.6, 50.9]]}', encoding="utf-8")
        train = load_train(write_train(folder, {"train": "maglev-1", "units.gnss": {"kind": "gnss"}}, {"geojson": "l.geojson"}))
    for message in examples_of(row):
        unit = message.unit if "{unit}" in row.key else ""
        file = io.StringIO()
        write_line(file, "maglev-1", Output(row.name, unit, message), RECEIVED)
        assert file.getvalue().count("\n") == 1
        found = reader(tmp_path, train, [file.getvalue().encode()], (row.key.split("/")[0],))
        back = list(found.messages())
        assert found.refusals.counts == {}
        assert back == [(row.name, unit, message, RECEIVED)]


def test_every_message_of_a_long_recording_comes_back_in_order_of_arrival(tmp_path: Path, train: Train) -> None:
    lines = [as_bytes(reading(n, received_at_ns=RECEIVED + n)) for n in range(500)]
    random.Random(1).shuffle(lines)
    found = list(reader(tmp_path, train, lines).messages())
    expected = [json.loads(line)["payload"]["sequence"] for line in lines]
    assert [message.sequence for _, _, message, _ in found] == expected


DEEP = b"[" * 100_000
BAD: dict[str, tuple[bytes, str]] = {
    "not json": (b"reading", "undecodable"),
    "half a line": (as_bytes(reading())[:-20], "undecodable"),
    "two on a line": (as_bytes(reading()) * 2, "undecodable"),
    "not utf-8": (b'{"key": "\xff\xfe"}', "undecodable"),
    "binary": (bytes(set(range(256)) - {10}), "undecodable"),
    "endless nesting": (DEEP, "undecodable"),
    "endless number": (b'{"key": ' + b"9" * 10_000 + b"}", "undecodable"),
    "list": (b"[1]", "invalid"),
    "number": (b"1", "invalid"),
    "null": (b"null", "invalid"),
    "no key": (as_bytes({"payload": payload()}), "invalid"),
    "key that is a number": (as_bytes(reading(key=5)), "invalid"),
    "key from elsewhere": (as_bytes(reading(key="other/v1/maglev-1/reading/radar")), "invalid"),
    "key of another version": (as_bytes(reading(key="milepost/v2/maglev-1/reading/radar")), "invalid"),
    "key too short": (as_bytes(reading(key="milepost/v1/maglev-1")), "invalid"),
    "key too long": (as_bytes(reading(key="milepost/v1/maglev-1/reading/radar/more")), "invalid"),
    "unit that the train has not": (as_bytes(reading(key="milepost/v1/maglev-1/reading/sonar")), "unknown_unit"),
    "no unit": (as_bytes(reading(key="milepost/v1/maglev-1/reading")), "invalid"),
    "another unit": (as_bytes(reading(key="milepost/v1/maglev-1/reading/loop")), "other_unit"),
    "another train": (as_bytes(reading(payload=payload(train="t2"))), "other_train"),
    "key of another train": (as_bytes(reading(key="milepost/v1/t2/reading/radar")), "other_train"),
    "no payload": (as_bytes({"key": reading()["key"]}), "invalid"),
    "payload that is text": (as_bytes(reading(payload="text")), "invalid"),
    "missing field": (as_bytes(reading(payload={k: v for k, v in payload().items() if k != "sequence"})), "invalid"),
    "ill-typed field": (as_bytes(reading(payload=payload(speed_mps="20"))), "invalid"),
    "not a number": (as_bytes(reading(payload=payload(speed_mps=float("nan")))), "invalid"),
    "speed of light": (as_bytes(reading(payload=payload(speed_mps=3e8))), "invalid"),
    "another kind of reading": (as_bytes(reading(key="milepost/v1/maglev-1/reading/balise-reader")), "invalid"),
    "received before time began": (as_bytes(reading(received_at_ns=0)), "invalid"),
    "received at a fraction": (as_bytes(reading(received_at_ns=1.5)), "invalid"),
    "received at a text": (as_bytes(reading(received_at_ns="now")), "invalid"),
    "received truly": (as_bytes(reading(received_at_ns=True)), "invalid"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_line_is_counted_and_the_others_are_used(tmp_path: Path, train: Train, name: str) -> None:
    bad, reason = BAD[name]
    found = reader(tmp_path, train, [as_bytes(reading(1)), bad, bad, as_bytes(reading(2))])
    assert [message.sequence for _, _, message, _ in found.messages()] == [1, 2]
    assert found.refusals.counts == {reason: 2}
    assert list(found.first) == [reason]
    assert found.first[reason].startswith("line 2: ")


def test_the_first_refusal_of_each_reason_names_its_line(tmp_path: Path, train: Train) -> None:
    lines = [BAD["not json"][0], as_bytes(reading()), BAD["another train"][0], BAD["not json"][0], BAD["another unit"][0]]
    found = reader(tmp_path, train, lines)
    assert len(list(found.messages())) == 1
    assert found.refusals.counts == {"undecodable": 2, "other_train": 1, "other_unit": 1}
    assert {reason: text.split(":")[0] for reason, text in found.first.items()} == {
        "undecodable": "line 1",
        "other_train": "line 3",
        "other_unit": "line 5",
    }


def test_other_kinds_and_empty_lines_are_ignored(tmp_path: Path, train: Train) -> None:
    written = io.StringIO()
    for name, messages in EXAMPLES.items():
        if name != "position_reading":
            write_line(written, "maglev-1", Output(name, messages[0].unit, messages[0]), RECEIVED)
    lines = [b"", b"   ", *written.getvalue().encode().splitlines()]
    found = reader(tmp_path, train, lines, ("estimate", "fix"))
    assert [stream for stream, *_ in found.messages()] == ["estimate", "fix"]
    assert found.refusals.counts == {}


def test_without_a_receipt_time_the_latest_publication_is_the_clock(tmp_path: Path, train: Train) -> None:
    published = [T0 + 5, T0 + 9, T0 + 7, T0 + 12]
    lines = []
    for n, at in enumerate(published):
        line = reading(n, payload=payload(sequence=n, published_at_ns=at))
        del line["received_at_ns"]
        lines.append(as_bytes(line))
    assert [received for *_, received in reader(tmp_path, train, lines).messages()] == [T0 + 5, T0 + 9, T0 + 9, T0 + 12]


def test_progress_reaches_the_files_size(tmp_path: Path, train: Train) -> None:
    found = reader(tmp_path, train, [as_bytes(reading(n)) for n in range(10)] + [b"bad"])
    list(found.messages())
    assert found.read_bytes == found.path.stat().st_size


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_corrupt_recording_does_not_stop_the_reader(tmp_path: Path, train: Train, data: st.DataObject) -> None:
    good = bytearray(b"\n".join(as_bytes(reading(n)) for n in range(3)))
    for _ in range(data.draw(st.integers(1, 6))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    last = as_bytes(reading(99))
    found = reader(tmp_path, train, [bytes(good), last])
    told: list[Message] = [message for _, _, message, _ in found.messages()]
    assert told[-1].sequence == 99
