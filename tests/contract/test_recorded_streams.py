"""Every recorded row of the stream table goes into a recording and comes out of it, in every format, without a loss."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from examples import T0, examples_of
from milepost.cli.recording.describe import run_export
from milepost.cli.schema import schema_files
from milepost.config.errors import ConfigError
from milepost.recorder.columns import columns_of
from milepost.recorder.export import export, outputs
from milepost.recorder.file import RecordingFile
from milepost.recorder.incoming import Incoming, head_of
from milepost.recorder.reading import McapReader
from milepost.recorder.rows import place_of, recorded_keys, row_of
from milepost_schemas import STREAMS, FusedState, Stream, encode

RECORDED = [row for row in STREAMS if row.recorded]
each_row = pytest.mark.parametrize("row", RECORDED, ids=lambda row: row.name)
# numbers that have no unit, beside counts and shares
BARE = re.compile(
    r"(sequence|epoch|share|rewinds|gaps|satellites|hdop|component|system_version|mean|covariance|step_us\.\w+|latency_ms\.\w+)$"
)
# variables of ERTMS/ETCS: coded, under the names that SUBSET-026 gives them
CODED = re.compile(r"^(l|q|d|v|m|nid)_[a-z]+$")
UNIT = re.compile(r"_(m|m2|mps|mps2|m2ps2|radps|s|ns|us|ms|hz|deg)$")


def incoming(row: Stream) -> list[Incoming]:
    """The examples of a row as they would come."""
    return [
        Incoming(row.key_for(m.train, m.unit), row.message.encoding(), T0 + n, encode(m))
        for n, m in enumerate(examples_of(row))
    ]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One file with all examples."""
    path = tmp_path_factory.mktemp("recording") / "all.mcap"
    file = RecordingFile(path)
    for row in RECORDED:
        for message in incoming(row):
            file.add(message, head_of(message.payload))
    file.close()
    return path


@pytest.fixture(scope="module")
def exported(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all formats of it."""
    folder = tmp_path_factory.mktemp("exported")
    with outputs(folder / "csv", folder / "parquet", folder / "foxglove.mcap", [recording]) as writers:
        done = export([recording], writers, lambda _: None)
    assert done.messages == sum(len(examples_of(row)) for row in RECORDED)
    assert done.refused == {}
    return folder


def test_what_is_exported_into_the_recordings_folder_is_refused(recording: Path, tmp_path: Path) -> None:
    """The next `info` of the folder would count it as recorded."""
    (tmp_path / "drive").mkdir()
    whole = tmp_path / "drive/all.mcap"
    whole.write_bytes(recording.read_bytes())
    with pytest.raises(ConfigError, match="would be read as a part of the recording: name a file elsewhere for --foxglove"):
        run_export(tmp_path / "drive", None, None, tmp_path / "drive/foxglove.mcap")
    assert [each.name for each in whole.parent.iterdir()] == ["all.mcap"]
    # one file alone is not mistaken for another
    assert run_export(whole, None, None, tmp_path / "drive/foxglove.mcap") == 0


def test_what_is_not_recorded_is_stated_row_by_row() -> None:
    assert [row.name for row in STREAMS if not row.recorded] == ["candidate"]


@each_row
def test_its_key_is_subscribed_to_exactly_once(row: Stream) -> None:
    assert recorded_keys("maglev-1").count(row.key_for("maglev-1")) == 1


@each_row
def test_a_key_and_an_encoding_lead_back_to_the_row(row: Stream) -> None:
    key = row.key_for("maglev-1", "x")
    assert row_of(key, row.message.encoding()) is row
    place = place_of(key)
    assert place is not None
    assert place.train == "maglev-1"
    assert row_of(key, f"{row.message.encoding()}0") is None
    # without a schema in its encoding, only a key that one row has tells which
    alone = sum(other.key == row.key for other in STREAMS) == 1
    assert row_of(key, "zenoh/bytes") is (row if alone else None)


@each_row
def test_payloads_come_back_byte_for_byte(recording: Path, row: Stream) -> None:
    reader = McapReader(recording)
    back = [message for message in reader.messages() if row_of(message.key, message.encoding) is row]
    assert back == incoming(row)
    assert reader.whole


@each_row
def test_the_file_has_the_published_json_schema_of_it(recording: Path, row: Stream) -> None:
    with recording.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    schemas = {schema.name: schema.data.decode() for schema in summary.schemas.values()}
    expected = schema_files()[f"{row.message.SCHEMA}-{row.message.VERSION}.schema.json"]
    assert schemas[f"{row.message.SCHEMA}/{row.message.VERSION}"] == expected


@each_row
def test_every_number_in_a_table_has_its_unit_in_its_name(row: Stream) -> None:
    columns = columns_of(row.message)
    assert len({column.name for column in columns}) == len(columns)
    for column in columns:
        if column.kind in (int, float):
            coded = row.name == "position_report" and CODED.search(column.name)
            assert UNIT.search(column.name) or BARE.search(column.name) or coded, column.name


@each_row
def test_csv_has_every_field_and_every_digit(exported: Path, row: Stream) -> None:
    with (exported / "csv" / f"{row.name}.csv").open(encoding="utf-8", newline="") as file:
        found = list(csv.DictReader(file))
    assert len(found) == len(examples_of(row))
    for n, (line, message) in enumerate(zip(found, examples_of(row), strict=True)):
        fields = {"received_at_ns": T0 + n, **message.model_dump()}
        for column in columns_of(row.message):
            value = column.of(fields)
            assert parsed(line[column.name], value) == value, column.name


def parsed(text: str, like: Any) -> Any:
    """A cell as a reader takes it who knows the type."""
    if like is None:
        assert text == ""
        return None
    if isinstance(like, list | dict):
        return json.loads(text)
    return text == "True" if isinstance(like, bool) else type(like)(text)


@each_row
def test_parquet_has_the_types_and_values_of_the_schema(exported: Path, row: Stream) -> None:
    table = pq.read_table(exported / "parquet" / f"{row.name}.parquet")
    assert table.column_names == [column.name for column in columns_of(row.message)]
    for column in columns_of(row.message):
        kinds = {int: "int64", float: "double", bool: "bool", str: "string"}
        if column.kind in kinds:
            assert str(table.schema.field(column.name).type) == kinds[column.kind], column.name
    for n, (line, message) in enumerate(zip(table.to_pylist(), examples_of(row), strict=True)):
        fields = {"received_at_ns": T0 + n, **message.model_dump()}
        for column in columns_of(row.message):
            value = column.of(fields)
            if (
                value is None
                or isinstance(value, int | float | str)
                or (value and isinstance(value, list) and column.kind != list[Any])
            ):
                found = line[column.name]
                assert found == value or nested_text(found, value), column.name


def nested_text(found: Any, value: Any) -> bool:
    """Whether a list differs only where the schema leaves a map open: there the table has JSON."""
    return isinstance(found, list) and all(
        {k: json.loads(v) if isinstance(value[i][k], dict) else v for k, v in each.items()} == value[i]
        for i, each in enumerate(found)
    )


@each_row
def test_foxglove_gets_json_with_its_schema(exported: Path, row: Stream) -> None:
    with (exported / "foxglove.mcap").open("rb") as file:
        found = [
            (schema.name, channel.message_encoding, json.loads(message.data), json.loads(schema.data))
            for schema, channel, message in make_reader(file).iter_messages(log_time_order=False)
            if schema is not None and schema.name == f"milepost.{row.message.SCHEMA}"
        ]
    own = [each for each in found if set(each[2]) >= set(row.message.model_fields)]
    assert [fields["sequence"] for _, _, fields, _ in own][: len(examples_of(row))] == [m.sequence for m in examples_of(row)]
    for _, encoding, fields, schema in own:
        assert encoding == "json"
        assert set(schema["required"]) <= {"received_at_ns", *fields}
        assert schema["type"] == "object"


def test_a_state_with_a_place_is_a_point_on_foxgloves_map(exported: Path) -> None:
    states = [m for row in RECORDED for m in examples_of(row) if isinstance(m, FusedState) and m.latitude_deg is not None]
    assert states
    with (exported / "foxglove.mcap").open("rb") as file:
        found = [
            (channel.topic, json.loads(message.data))
            for schema, channel, message in make_reader(file).iter_messages(log_time_order=False)
            if schema is not None and schema.name == "foxglove.LocationFix"
        ]
    assert len(found) == len(states)
    topic, fix = found[0]
    assert topic == "/milepost/v1/maglev-1/state/location"
    assert (fix["latitude"], fix["longitude"]) == (states[0].latitude_deg, states[0].longitude_deg)
    assert fix["timestamp"]["sec"] * 10**9 + fix["timestamp"]["nsec"] == states[0].measured_at_ns
    assert fix["position_covariance"][0] == states[0].covariance[0][0]
