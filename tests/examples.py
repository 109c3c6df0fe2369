"""One place for examples: a valid message of every stream, options of every sensor, a train file to spoil."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from milepost.recordings.column_options import RecordingOptions
from milepost.recordings.gnss_log import with_default_columns
from milepost.recordings.measured import Measured, Source
from milepost.sensors import SENSORS
from milepost.sensors.base import World
from milepost.simulation.motion import Profile, WhiteJerkMotion
from milepost.track.line import Balise, Line
from milepost.track.track import Track
from milepost_schemas import (
    AbsoluteFix,
    BalisePassed,
    BaliseTelegram,
    Candidate,
    Estimate,
    Event,
    FaultCommand,
    Feedback,
    FusedState,
    Gaussian,
    Health,
    Hypotheses,
    Hypothesis,
    InertialReading,
    LinearObservation,
    Message,
    PositionReading,
    PositionReport,
    SensorExcluded,
    SensorInUse,
    SpeedReading,
    Spread,
    Stream,
    Truth,
)

T0 = 1_700_000_000_000_000_000


def head(unit: str = "radar", **changed: Any) -> dict[str, Any]:
    """The head of a message."""
    fields = {
        "train": "maglev-1",
        "unit": unit,
        "instance": "a1b2c3d4",
        "sequence": 7,
        "measured_at_ns": T0 + 10_000_000,
        "published_at_ns": T0 + 11_000_000,
    }
    return {**fields, **changed}


GAUSSIAN = Gaussian(
    states=["position_m", "speed_mps", "acceleration_mps2", "radar.scale"],
    mean=[1234.5, 20.25, 0.125, 1.001],
    covariance=[[4.0, 0.5, 0.0, 0.0], [0.5, 1.0, 0.1, 0.0], [0.0, 0.1, 0.25, 0.0], [0.0, 0.0, 0.0, 1e-6]],
)

# every optional field is given in at least one example of its stream
EXAMPLES: dict[str, tuple[Message, ...]] = {
    "speed_reading": (
        SpeedReading(**head(), speed_mps=20.5, speed_variance_m2ps2=0.04, interval_s=0.01),
        SpeedReading(**head("loop"), speed_max_mps=0.25, interval_s=0.4),
    ),
    "position_reading": (
        PositionReading(
            **head("gnss"),
            latitude_deg=50.892505,
            longitude_deg=4.539371,
            solution="rtk_fixed",
            altitude_m=56.5,
            horizontal_std_m=0.0125,
            satellites=14,
            hdop=0.75,
            speed_mps=20.25,
            speed_std_mps=0.0625,
            course_deg=271.5,
        ),
    ),
    "inertial_reading": (
        InertialReading(
            **head("imu"),
            specific_force_mps2=[0.125, -0.25, -9.8125],
            turn_rate_radps=[0.0, 0.0, 0.0125],
            mean_over_s=0.05,
        ),
    ),
    "balise_telegram": (BaliseTelegram(**head("balise-reader"), balise_id="b00012", reader_variance_m2=0.0004),),
    "estimate": (
        Estimate(
            **head(),
            belief=GAUSSIAN,
            observations=[
                LinearObservation(
                    sensor_instance="a1b2c3d4",
                    reading_sequence=41,
                    component=1,
                    measured_at_ns=T0 + 10_000_000,
                    row=[0.0, 1.0, 0.0, 20.0],
                    value=20.5,
                    variance=0.04,
                )
            ],
            feedback_epoch_ns=T0,
        ),
    ),
    "fix": (
        AbsoluteFix(
            **head("balise"),
            reader="balise-reader",
            reader_instance="e5f6",
            reading_sequence=3,
            balise_id="b00012",
            position_m=1200.0,
            position_variance_m2=0.0004,
            location_accuracy_m=0.05,
            doubtful="balise_early: 2.00 m before its window",
        ),
    ),
    "feedback": (
        Feedback(
            **head("fuser"),
            fused=GAUSSIAN,
            shares={"radar": 0.75, "loop": 0.25},
            position_min_m=1224.25,
            position_max_m=1244.0,
            speed_min_mps=15.0,
            speed_max_mps=25.5,
        ),
    ),
    "state": (
        FusedState(
            **head("fuser"),
            epoch=85_000_000_000,
            position_m=1234.5,
            speed_mps=20.25,
            acceleration_mps2=-0.5,
            covariance=[[4.0, 0.5, 0.0], [0.5, 1.0, 0.1], [0.0, 0.1, 0.25]],
            position_min_m=1224.25,
            position_max_m=1244.0,
            speed_min_mps=15.0,
            speed_max_mps=25.5,
            position_accuracy_m=0.1,
            speed_accuracy_mps=0.05,
            doubted=["radar", "loop"],
            reset={"size_m": 0.4, "size_mps": -0.1, "reason": "excluded: radar"},
            direction="forward",
            status="normal",
            line="maglev-test-track",
            line_hash="0123456789abcdef",
            latitude_deg=50.5,
            longitude_deg=4.25,
            last_balise=BalisePassed(balise_id="b00012", position_m=1200.0, distance_since_m=34.5),
            sensors=[SensorInUse(unit="radar", share=1.0, age_s=0.005)],
            excluded=[SensorExcluded(unit="loop", reason="silent", kind="silent")],
            awaiting=["loop"],
            settled=True,
        ),
    ),
    "candidate": (),
    "hypotheses": (
        Hypotheses(
            **head("fuser"),
            epoch=85_000_000_000,
            hypotheses=[
                Hypothesis(
                    without=["radar", "motion-model"],
                    judgement="leads",
                    position_m=1234.5,
                    position_std_m=0.25,
                    speed_mps=20.5,
                    speed_std_mps=0.05,
                )
            ],
        ),
    ),
    "position_report": (
        PositionReport(
            **head("etcs"),
            epoch=85_000_000_000,
            trigger="balise_group",
            system_version=3,
            l_packet=138,
            q_scale=0,
            nid_lrbg=5768169,
            d_lrbg=5,
            q_dirlrbg=0,
            q_dlrbg=1,
            l_doubtover=25,
            l_doubtunder=15,
            q_integrity=2,
            l_trainint=201,
            v_train=127,
            q_dirtrain=2,
            m_mode=1,
            m_level=1,
            nid_ntc=6,
            packet_hex="00045058".ljust(36, "0"),
        ),
    ),
    "event": (Event(**head("fuser"), severity="warning", code="coasting", text="no sensor is heard"),),
    "health": (
        Health(
            **head("filter-radar"),
            uptime_s=12.5,
            received_hz={"speed_reading": 100.0},
            sent_hz={"estimate": 100.0},
            expected_hz={"speed_reading": 100.0, "estimate": 100.0},
            refused={"duplicate": 2},
            rewinds=3,
            gaps=1,
            step_us=Spread(p50=20.0, p99=45.5, max=300.25),
            latency_ms=Spread(p50=0.25, p99=1.5, max=9.75),
        ),
    ),
    "chaos": (
        FaultCommand(
            **head(),
            kind="wrong_balise",
            for_s=2.5,
            numbers={"offset_m": 10.5},
            words={"says": "b00013"},
            flags={"once": False},
        ),
        FaultCommand(**head()),
    ),
    "truth": (Truth(**head("world"), position_m=1234.0, speed_mps=20.0, acceleration_mps2=0.0625),),
}

EXAMPLES["candidate"] = (
    Candidate(**head("fuser-2"), state=EXAMPLES["state"][0], feedback=EXAMPLES["feedback"][0]),
    Candidate(**head("fuser-2"), state=EXAMPLES["state"][0]),
)


def examples_of(stream: Stream) -> tuple[Message, ...]:
    """The examples of a row of the stream table."""
    found = EXAMPLES.get(stream.name)
    assert found, f"tests/examples.py: EXAMPLES has no message for the stream {stream.name!r}; add one"
    return found


Path_ = tuple[str | int, ...]


def parts(value: Any, at: Path_ = ()) -> Iterator[tuple[Path_, BaseModel]]:
    """The message and every part in it, with the way to it."""
    if isinstance(value, BaseModel):
        yield at, value
        for name in type(value).model_fields:
            yield from parts(getattr(value, name), (*at, name))
    elif isinstance(value, list | dict):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from parts(item, (*at, key))


def values(value: Any, at: Path_ = ()) -> Iterator[tuple[Path_, Any]]:
    """Every value inside a message's fields (maps and lists too), with the way to it; the message itself left out."""
    if at:
        yield at, value
    if isinstance(value, list | dict):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from values(item, (*at, key))


def replaced(fields: Mapping[str, Any], at: Path_, value: Any) -> dict[str, Any]:
    """A copy of a message's fields with one value replaced."""
    out = deepcopy(dict(fields))
    inner: Any = out
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return out


def without(fields: Mapping[str, Any], at: Path_) -> dict[str, Any]:
    """A copy of a message's fields without one of them."""
    out = deepcopy(dict(fields))
    inner: Any = out
    for key in at[:-1]:
        inner = inner[key]
    del inner[at[-1]]
    return out


def sensor(kind: str, line: Line, unit: str = "unit", **options: Any) -> Any:
    """A sensor of a kind on a line; what is not given has the kind's own default."""
    row = SENSORS[kind]
    return row(unit, row.options_model.model_validate({"kind": kind, **options}), line)


def gnss_log(path: Path) -> RecordingOptions:
    """A log with the default columns, as a train file's bare path means it."""
    return RecordingOptions.model_validate(with_default_columns(path))


def all_readings(source: Source) -> list[Measured]:
    """Everything that a source has to say until it ends."""
    out = []
    while source.next_s() is not None:
        measured = source.read()
        if measured is not None:
            out.append(measured)
    return out


def straight_line(length_m: float = 10_000.0, every_m: float = 100.0) -> Line:
    """A line without geometry, with a balise at equal distances."""
    count = int(length_m / every_m)
    balises = tuple(Balise(f"b{i:05d}", i * every_m, 0.05) for i in range(1, count + 1))
    return Line("test-line", length_m, balises)


def surveyed_line() -> Line:
    """A line of 10 km with geometry, due north, with a balise every 100 m."""
    track = Track([(4.5, 50.9 + 0.01 * i) for i in range(10)])
    return Line("test-line", track.length_m, straight_line(track.length_m).balises, 0.0, track)


def world(
    corners: list[tuple[float, float]] | None = None,
    end_s: float = 100.0,
    seed: int = 1,
    jerk_psd: float = 0.0,
    start_m: float = 0.0,
    line: Line | None = None,
) -> World:
    """A world whose train follows a speed profile, exactly unless `jerk_psd` is given."""
    motion = WhiteJerkMotion(Profile(corners or [(0.0, 20.0)], start_m), end_s, jerk_psd, None, [0.0] * 3, seed)
    return World(motion, line or straight_line(), seed)


LINE_FILE: dict[str, Any] = {"line": "test-line", "length_m": 5000.0, "balises": {"every_m": 100.0, "from_m": 100.0}}

TRAIN_FILE: dict[str, Any] = {
    "train": "test-1",
    "line": "line.yaml",
    "motion_model": {"jerk_psd_m2ps5": 1e-6},
    "prior": {
        "position_m": 0.0,
        "position_std_m": 0.02,
        "speed_mps": 20.0,
        "speed_std_mps": 0.1,
        "acceleration_std_mps2": 0.01,
    },
    "fusion": {"shares": {"radar": 0.7, "loop": 0.3}},
    "world": {"seed": 1, "motion": {"kind": "white_jerk", "profile": [[0.0, 20.0]], "jerk_psd_m2ps5": 1e-6}},
    "units": {
        "radar": {"kind": "doppler_radar"},
        "loop": {"kind": "induction_loop"},
        "balise-reader": {"kind": "balise_reader"},
    },
}

# an odometer whose speeds v (m/s) at times t (s) are in `wheel.csv` beside the train file
RECORDED_ODOMETER: dict[str, Any] = {
    "kind": "odometer",
    "source": "recording",
    "rate_hz": 10.0,
    "recording": {
        "file": "wheel.csv",
        "time": {"column": "t"},
        "columns": {"speed_mps": {"column": "v", "unit": "m/s"}},
        "constants": {"speed_variance_m2ps2": 0.01, "interval_s": 0.1},
    },
}

SCENARIO_FILE: dict[str, Any] = {"scenario": "test-run", "train": "train.yaml", "duration_s": 10.0}

REMOVED = object()


def changed(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a file's content with `{"a.b": value}` laid over it; the value REMOVED takes the key out."""
    out = deepcopy(dict(base))
    for dotted, value in changes.items():
        *above, last = dotted.split(".")
        inner = out
        for key in above:
            inner = inner.setdefault(key, {})
        if value is REMOVED:
            del inner[last]
        else:
            inner[last] = value
    return out


def write_train(folder: Path, changes: Mapping[str, Any] | None = None, line: Mapping[str, Any] | None = None) -> Path:
    """Write a line file and a train file with changes; returns the train file's path."""
    (folder / "line.yaml").write_text(yaml.safe_dump(changed(LINE_FILE, line or {}), sort_keys=False), encoding="utf-8")
    path = folder / "train.yaml"
    path.write_text(yaml.safe_dump(changed(TRAIN_FILE, changes or {}), sort_keys=False), encoding="utf-8")
    return path
