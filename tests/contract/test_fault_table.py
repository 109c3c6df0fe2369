"""Every row of the table of faults keeps what the table promises."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from pydantic_core import PydanticUndefined

from examples import T0, examples_of, surveyed_line, world
from milepost.cli.inject import KINDS, Wanted, run_list
from milepost.config.faults import check_faults
from milepost.config.train import load_train
from milepost.config.yaml_files import ConfigError
from milepost.sensors import SENSORS
from milepost.simulation.faults import FAULTS, FaultEntry, FaultKind, Injection, Link, Surroundings
from milepost_schemas import BY_NAME, STREAMS, Message, decode, encode

ROOT = Path(__file__).resolve().parents[2]
LINE = surveyed_line()
READINGS = [row.name for row in STREAMS if row.key == "reading/{unit}"]
# a value for each option that is required
REQUIRED = {"size": 1.5, "rate": 0.5, "factor": 2.0, "by_s": 0.25, "rate_mps": 1.0, "offset_m": 5.0, "ppm": 500.0}
each_row = pytest.mark.parametrize("row", FAULTS.values(), ids=lambda row: row.name)


def required(row: FaultKind) -> dict[str, Any]:
    """The options that a kind cannot do without."""
    ratio = -0.25 if row.name == "slide" else 0.25
    return {n: {**REQUIRED, "ratio": ratio}[n] for n, field in row.options.model_fields.items() if field.is_required()}


def entry(row: FaultKind, unit: str = "u1") -> FaultEntry:
    return FaultEntry.model_validate({"unit": unit, "kind": row.name, "from_s": 0.0, **required(row)})


def around(stream: str, row: FaultKind) -> Surroundings:
    kind = (row.sensors or [name for name, sensor in SENSORS.items() if sensor.stream == stream])[0]
    return Surroundings("u1", stream, kind, LINE, world().motion)


def test_the_table_is_indexed_by_name() -> None:
    assert [row.name for row in FAULTS.values()] == list(FAULTS)
    assert all(re.fullmatch(r"[a-z][a-z_]*", name) for name in FAULTS)


@each_row
def test_a_row_names_streams_of_readings_and_kinds_of_sensors(row: FaultKind) -> None:
    assert row.streams
    assert set(row.streams) <= set(READINGS)
    for kind in row.sensors:
        assert SENSORS[kind].stream in row.streams


@each_row
def test_every_option_says_what_it_is(row: FaultKind) -> None:
    for name, field in row.options.model_fields.items():
        assert field.description, name
        assert field.is_required() == (field.default is PydanticUndefined)


@each_row
def test_a_fault_makes_messages_that_every_receiver_accepts(row: FaultKind) -> None:
    for stream in row.streams:
        injection = Injection(around(stream, row), T0, [entry(row)])
        for number, reading in enumerate(examples_of(BY_NAME[stream]) * 3):
            for message, delay_s in injection.send(reading.model_copy(update={"sequence": number})):
                assert decode(encode(message), BY_NAME[stream].message) == message
                assert delay_s >= 0.0


@each_row
def test_a_fault_is_the_same_in_every_run(row: FaultKind) -> None:
    for stream in row.streams:
        runs = []
        for _ in range(2):
            injection = Injection(around(stream, row), T0, [entry(row)])
            runs.append([injection.send(reading) for reading in examples_of(BY_NAME[stream]) * 3])
        assert runs[0] == runs[1]


@each_row
def test_a_fault_fits_the_units_that_it_says_and_no_others(row: FaultKind) -> None:
    train = load_train(ROOT / "deploy/trains/full.yaml")
    fits = {u for u, s in train.sensors.items() if s.stream in row.streams and (not row.sensors or s.kind in row.sensors)}
    assert fits, "no unit of the full train can have it"
    for unit in train.sensors:
        if unit in fits:
            check_faults(train, [entry(row, unit)], train.path, "faults")
            continue
        with pytest.raises(ConfigError, match=rf"full.yaml: faults\.0\.kind: {unit}: {row.name} does not fit"):
            check_faults(train, [entry(row, unit)], train.path, "faults")


@each_row
@given(data=st.data())
def test_no_option_makes_a_sensor_fail(row: FaultKind, data: st.DataObject) -> None:
    """Any options are refused, or make valid messages, or messages that are refused as invalid."""
    numbers = {name: data.draw(st.floats()) for name in required(row)}
    try:
        fault = FaultEntry.model_validate({"unit": "u1", "kind": row.name, "from_s": 0.0, **numbers})
    except ValidationError:
        return
    for stream in row.streams:
        injection, link = Injection(around(stream, row), T0, [fault]), Link[Message]()
        for reading in examples_of(BY_NAME[stream]) * 2:
            try:
                sent = injection.send(reading)
            except ValidationError:
                continue
            for message, delay_s in sent:
                link.send(message, delay_s, T0)


NOTHING = Wanted("", "", (), None, False, "")


def test_the_command_lists_every_kind_with_every_option(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_list(NOTHING, as_json=True) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [row["fault"] for row in listed] == list(KINDS)
    for row in listed:
        assert set(row["options"]) == set(KINDS[row["fault"]].options.model_fields)
    assert run_list(NOTHING, as_json=False) == 0
    printed = capsys.readouterr().out
    for row in FAULTS.values():
        assert f"\n{row.name} " in f"\n{printed}"
        assert all(f"--{name.replace('_', '-')}" in printed for name in row.options.model_fields)
