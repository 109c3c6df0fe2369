"""THE TABLE OF DECODERS: how each is fed with bytes, what it refuses, and valid inputs to begin from.

A target's `decode` returns the reasons for which it refused the input, or parts of it; none where it took all. It catches what
the decoder documents: whatever it raises is a defect.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import yaml

from examples import EXAMPLES, LINE_FILE, RECORDED_ODOMETER, SCENARIO_FILE, TRAIN_FILE, gnss_log, write_train
from milepost.campaign.campaign_file import load_campaign
from milepost.campaign.results_file import results_file
from milepost.config.errors import ConfigError
from milepost.config.line_file import load_line
from milepost.config.scenario_file import load_scenario
from milepost.config.train import load_train
from milepost.offline.message_log import Reader
from milepost.recordings.column_map import CsvSource
from milepost.recordings.column_options import RecordingOptions
from milepost.recordings.epochs import Decoder
from milepost.recordings.gnss_log import read_gnss_log
from milepost.recordings.nmea import NmeaDecoder
from milepost.recordings.ubx import UbxDecoder
from milepost.sensors.odometer.calibration import Calibration, from_bytes, to_bytes
from milepost.track.geojson import geojson_points
from milepost_schemas import STREAMS, Part, Refused, SimulationStart, SnapshotPart, SpeedReading, decode, encode
from receivers import NMEA_LOG, UBX_LOG

Reasons = tuple[str, ...]
# quoted words and numbers: what is left of a sentence is its kind
PARTICULAR = re.compile(r"'.*'|\".*\"|-?\d[\d.e+-]*")
LISTS = re.compile(r"; |there are |must be one of |known keys|has no such|codec")


@dataclass(frozen=True)
class Target:
    """A decoder. `form` says how its valid inputs are altered so that they stay nearly valid: see `mutations`.

    `slow_ms`: an input that takes longer is a defect. `share`: of how many inputs this one gets how many.
    """

    name: str
    decode: Callable[[bytes], Reasons]
    seeds: tuple[bytes, ...]
    form: str
    share: float = 1.0
    slow_ms: float = 10.0


@cache
def scratch() -> Path:
    """A folder for decoders that read files; in memory where the system has such a place."""
    memory = Path("/dev/shm")
    kept = tempfile.TemporaryDirectory(prefix="milepost-fuzz-", dir=memory if os.access(memory, os.W_OK) else None)
    FOLDERS.append(kept)
    return Path(kept.name)


FOLDERS: list[tempfile.TemporaryDirectory[str]] = []


def file_of(name: str, content: bytes) -> Path:
    path = scratch() / name
    path.write_bytes(content)
    return path


def kind_of(text: str) -> str:
    """A refusal without what is particular to its input."""
    return PARTICULAR.sub("...", LISTS.split(text)[0])[:50].strip()


def message(schema: type[Part], data: bytes) -> Reasons:
    try:
        decode(data, schema)
    except Refused as refused:
        return (refused.reason,)
    return ()


def receiver(kind: type[Decoder], data: bytes) -> Reasons:
    decoder = kind()
    fixes = decoder.feed(data) + decoder.finish()
    return tuple(decoder.skipped) or (() if fixes else ("no fix",))


def csv_source(data: bytes) -> Reasons:
    path = file_of("wheel.csv", data)
    options = RecordingOptions.model_validate({**RECORDED_ODOMETER["recording"], "file": str(path)})
    try:
        source = CsvSource(options, SpeedReading, 0.0)
        while source.next_s() is not None:
            source.read()
    except ValueError as error:
        return (named(error, path),)
    return tuple(source.skipped)


def gnss_csv(data: bytes) -> Reasons:
    path = file_of("gnss.csv", data)
    try:
        read_gnss_log(gnss_log(path))
    except ValueError as error:
        return (named(error, path),)
    return ()


def geojson(data: bytes) -> Reasons:
    path = file_of("line.geojson", data)
    try:
        geojson_points(path)
    except ValueError as error:
        return (named(error, path),)
    return ()


def named(error: ValueError, path: Path) -> str:
    """The kind of a refusal that names its file, as documented; any other ValueError is a defect."""
    if not str(error).startswith(f"{path}: "):
        raise AssertionError(f"does not name its file: {error}") from error
    return kind_of(str(error).removeprefix(f"{path}: "))


def configuration(load: Callable[[Path], object], name: str, data: bytes) -> Reasons:
    path = beside_a_train() / name
    path.write_bytes(data)
    try:
        load(path)
    except ConfigError as error:
        if "\n" in str(error):
            raise AssertionError("more than one line") from error
        return (kind_of(str(error).rpartition(": ")[2]),)
    return ()


@cache
def beside_a_train() -> Path:
    """A folder with a valid line and a valid train."""
    folder = scratch() / "config"
    folder.mkdir()
    write_train(folder)
    return folder


def calibration(data: bytes) -> Reasons:
    try:
        from_bytes(data)
    except ValueError as error:
        return (str(error),)
    return ()


@cache
def train() -> Any:
    return load_train(beside_a_train() / "train.yaml")


def recording(data: bytes) -> Reasons:
    reader = Reader(file_of("messages.jsonl", data), train(), ("reading", "estimate", "fix"))
    count = sum(1 for _ in reader.messages())
    return tuple(reader.refusals.counts) or (() if count else ("no message",))


def results(data: bytes) -> Reasons:
    try:
        with results_file(file_of("runs.jsonl", data)):
            return ()
    except ConfigError as error:
        return (kind_of(str(error).rpartition(": ")[2]),)


def lines(*objects: object) -> bytes:
    return b"".join(json.dumps(each).encode() + b"\n" for each in objects)


def dumped(content: object) -> bytes:
    return yaml.safe_dump(content, sort_keys=False).encode()


def logged(stream: str, unit: str) -> dict[str, Any]:
    """An example as a line of a recording of the train of `tests/examples.py`."""
    row = next(row for row in STREAMS if row.name == stream)
    fields = {**EXAMPLES[stream][0].model_dump(), "train": TRAIN_FILE["train"], "unit": unit}
    return {"key": row.key_for(TRAIN_FILE["train"], unit), "received_at_ns": fields["published_at_ns"], "payload": fields}


WHEEL = b"t,v\n0.0,20.0\n0.1,20.5\n0.2,20.25\n"
GNSS = (
    b"time_utc,latitude_deg,longitude_deg,position_type\n"
    b"2022-02-25T12:00:00Z,50.892505,4.539371,NARROW_INT\n2022-02-25T12:00:01Z,50.892515,4.539381,SINGLE\n"
)
PATH = {"type": "Feature", "geometry": {"type": "LineString", "coordinates": [[4.5, 50.9], [4.51, 50.91], [4.52, 50.92, 60.0]]}}
CAMPAIGN = {
    "campaign": "c",
    "trains": {"test": {"train": "train.yaml", "duration_s": 30.0, "onset_s": 10.0}},
    "faults": [{"label": "bias", "kind": "bias", "options": {"size": 1.0}, "streams": ["speed_reading"]}],
    "runs": 2,
}
RESULT = {"key": "k", "train": "t", "seed": 1, "figures": {"violated": 0, "width_m": 1.5}}
START = SimulationStart(start_ns=1_700_000_000_000_000_000, speed=1.0, end_ns=1_700_000_600_000_000_000)
SNAPSHOT = SnapshotPart(fingerprint="f", taken_at_ns=1_700_000_000_000_000_000, part=0, parts=2, content=b"\x90")
KEPT = Calibration("wheel", 0.85, 1.001, 0.0004, 1_700_000_000_000_000_000)

TARGETS: dict[str, Target] = {
    target.name: target
    for target in (
        *(
            Target(
                f"message-{row.name}",
                partial(message, row.message),
                tuple(encode(example) for example in EXAMPLES[row.name]),
                "msgpack",
            )
            for row in STREAMS
        ),
        Target("simulation-start", partial(message, SimulationStart), (encode(START),), "msgpack", 0.5),
        Target("snapshot-part", partial(message, SnapshotPart), (encode(SNAPSHOT),), "msgpack", 0.5),
        Target("nmea", partial(receiver, NmeaDecoder), (NMEA_LOG,), "nmea", 2.0),
        Target("ubx", partial(receiver, UbxDecoder), (UBX_LOG,), "ubx", 2.0),
        Target("csv-readings", csv_source, (WHEEL,), "text"),
        Target("csv-gnss", gnss_csv, (GNSS,), "text"),
        Target("geojson", geojson, (json.dumps(PATH).encode(),), "json", 0.5),
        Target("recording", recording, (lines(logged("speed_reading", "radar"), logged("fix", "balise")),), "json-lines"),
        Target("campaign-results", results, (lines(RESULT, {**RESULT, "key": "k2"}),), "json-lines", 0.5),
        Target("calibration", calibration, (to_bytes(KEPT),), "json", 0.5),
        Target("yaml-line", partial(configuration, load_line, "line-2.yaml"), (dumped(LINE_FILE),), "yaml", 0.3),
        Target("yaml-train", partial(configuration, load_train, "train-2.yaml"), (dumped(TRAIN_FILE),), "yaml", 0.3, 50.0),
        Target(
            "yaml-scenario", partial(configuration, load_scenario, "scenario.yaml"), (dumped(SCENARIO_FILE),), "yaml", 0.3, 50.0
        ),
        Target("yaml-campaign", partial(configuration, load_campaign, "campaign.yaml"), (dumped(CAMPAIGN),), "yaml", 0.3, 50.0),
    )
}
