"""Every mistake in a train, line or scenario file is one line naming file and field, before anything starts."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml

from examples import LINE_FILE, REMOVED, SCENARIO_FILE, TRAIN_FILE, changed, write_train
from milepost.cli import up as up_command
from milepost.cli.main import main
from milepost.config.line_file import load_line
from milepost.config.roles import ROLES, processes
from milepost.config.scenario_file import load_scenario
from milepost.config.train import load_train
from milepost.config.yaml_files import ConfigError, merged, read_yaml

GNSS = {"kind": "gnss", "source": "recording", "recording": "log.csv"}
UNFIT = {"file": "log.csv", "time": {"column": "time_utc", "unit": "iso8601"}, "columns": {"satellites": {"column": "n"}}}
RECEIVER = {"kind": "gnss", "source": "receiver"}
LIVE = {"protocol": "nmea", "tcp": "127.0.0.1:1"}
TWO_WAYS = {**LIVE, "file": "log.csv"}
GEOMETRY = {"geojson": "line.geojson", "length_m": REMOVED, "balises": []}
POINTS = [[4.5, 50.9], [4.503, 50.9], [4.506, 50.901]]
LOG = ["time_utc,latitude_deg,longitude_deg,position_type"] + [
    f"2022-02-25T09:32:{54 + i}.000Z,50.9,{4.5 + 0.0002 * i},NARROW_INT3" for i in range(6)
]


@dataclass(frozen=True)
class Mistake:
    """Changes to a train that loads, and the field (and some of the words) that the line must have."""

    name: str
    field: str
    says: str = ""
    train: dict[str, Any] = field(default_factory=dict)
    line: dict[str, Any] = field(default_factory=dict)
    file: str = "train.yaml"


WORLD = "world.motion"

MISTAKES = (
    # keys
    Mistake("unknown key", "spede", "unknown key", {"spede": 1}),
    Mistake("unknown key in a part", "fusion.horizon", "unknown key", {"fusion.horizon": 5.0}),
    Mistake("unknown key of a sensor", "units.radar.rate", "unknown key", {"units.radar.rate": 100.0}),
    Mistake("another sensor's key", "units.radar.pitch_m", "unknown key", {"units.radar.pitch_m": 0.1}),
    Mistake("missing key", "prior", "required", {"prior": REMOVED}),
    Mistake("missing key in a part", "prior.speed_std_mps", "required", {"prior.speed_std_mps": REMOVED}),
    Mistake("missing jerk", "motion_model.jerk_psd_m2ps5", "required", {"motion_model": {}}),
    # types
    Mistake("text for a number", "prior.speed_mps", "number", {"prior.speed_mps": "fast"}),
    Mistake("number in quotes", "prior.speed_mps", "number", {"prior.speed_mps": "20.0"}),
    Mistake("truth for a number", "units.radar.rate_hz", "number", {"units.radar.rate_hz": True}),
    Mistake("number for a truth", "fusion.feedback", "bool", {"fusion.feedback": 1}),
    Mistake("fraction for a whole number", "fusion.period_ms", "int", {"fusion.period_ms": 20.5}),
    Mistake("list for a mapping", "fusion", "", {"fusion": [1]}),
    Mistake("mapping for a list", f"{WORLD}.profile", "list", {f"{WORLD}.profile": {"0": 20.0}}),
    Mistake("null for a part", "motion_model", "", {"motion_model": None}),
    Mistake("unit that is no mapping", "units.radar", "", {"units.radar": "doppler_radar"}),
    Mistake("number for a file", "line", "", {"line": 5}),
    # values
    Mistake("name with a slash", "train", "", {"train": "a/b"}),
    Mistake("name with a capital letter", "train", "lower-case letters, digits", {"train": "Metro"}),
    Mistake(
        "unit's name that is the motion model's", "units", "motion-model", {"units.motion-model": {"kind": "doppler_radar"}}
    ),
    Mistake("hard motion for certain", "motion_model.hard_probability", "0.5", {"motion_model.hard_probability": 1.0}),
    Mistake("unit's name with a star", "units", "", {"units.a*": {"kind": "doppler_radar"}}),
    Mistake("no standard deviation", "prior.position_std_m", "greater than 0", {"prior.position_std_m": 0.0}),
    Mistake("negative rate", "units.radar.rate_hz", "greater than 0", {"units.radar.rate_hz": -100.0}),
    Mistake("prior beyond the line", "prior.position_m", "is not on line", {"prior.position_m": 400_000.0}),
    Mistake("prior before the line", "prior.position_m", "is not on line", {"prior.position_m": -400_000.0}),
    Mistake("seed below zero", "world.seed", "greater than or equal to 0", {"world.seed": -1}),
    Mistake("seed that is no whole number", "world.seed", "int", {"world.seed": 1.5}),
    Mistake("not a number", "prior.position_m", "finite", {"prior.position_m": float("nan")}),
    Mistake("infinite", "fusion.interval_sigmas", "finite", {"fusion.interval_sigmas": float("inf")}),
    Mistake("speed beyond any train's", "prior.speed_mps", "200", {"prior.speed_mps": 300.0}),
    Mistake("period too long", "fusion.period_ms", "1000", {"fusion.period_ms": 5000}),
    Mistake("horizon too short", "fusion.horizon_s", "0.1", {"fusion.horizon_s": 0.0}),
    Mistake("negative variance", "units.radar.speed_variance_m2ps2", "", {"units.radar.speed_variance_m2ps2": -0.04}),
    Mistake("no pitch", "units.loop.pitch_m", "", {"units.loop.pitch_m": 0.0}),
    Mistake("latency too long", "units.balise-reader.latency_s", "", {"units.balise-reader.latency_s": 2.0}),
    # shares
    Mistake("shares above one", "fusion", "sum to 1", {"fusion.shares": {"radar": 0.7, "loop": 0.4}}),
    Mistake("shares below one", "fusion", "sum to 1", {"fusion.shares": {"radar": 0.7}}),
    Mistake("negative share", "fusion.shares.loop", "", {"fusion.shares": {"radar": 1.0, "loop": -0.5}}),
    Mistake("share of nobody", "fusion.shares.wheel", "", {"fusion.shares": {"radar": 0.5, "wheel": 0.5}}),
    Mistake(
        "share of a unit without filter",
        "fusion.shares.balise-reader",
        "filter",
        {"fusion.shares": {"radar": 0.5, "balise-reader": 0.5}},
    ),
    Mistake("unknown rule", "fusion", "'majority'", {"fusion.rule": "majority"}),
    # units
    Mistake("unknown sensor", "units.radar.kind", "must be one of doppler_radar", {"units.radar.kind": "sonar"}),
    Mistake("no kind", "units.radar.kind", "must be one of", {"units.radar": {"rate_hz": 100.0}}),
    Mistake("kind that is a list", "units.radar.kind", "must be one of", {"units.radar.kind": ["doppler_radar"]}),
    Mistake("unknown filter", "units.radar.filter", "must be one of kalman", {"units.radar.filter": "kalmann"}),
    Mistake("filter for balises", "units.balise-reader.filter", "", {"units.balise-reader.filter": "kalman"}),
    Mistake("no units", "units", "", {"units": {}, "fusion": {}}),
    Mistake(
        "nobody to fuse",
        "units",
        "no unit has a filter",
        {"units.radar.filter": None, "units.loop.filter": None, "fusion": {}},
    ),
    Mistake("span with one end", "units.radar.withhold_s", "", {"units.radar.withhold_s": [[5.0]]}),
    Mistake("span with three ends", "units.radar.withhold_s", "", {"units.radar.withhold_s": [[1.0, 2.0, 3.0]]}),
    Mistake("span backwards", "units.radar.withhold_s", "", {"units.radar.withhold_s": [[6.0, 5.0]]}),
    # sources
    Mistake("unknown source", "units.radar.source", "recording", {"units.radar.source": "device"}),
    Mistake("recording not named", "units.gnss.recording", "required", {"units.gnss": {**GNSS, "recording": None}}, GEOMETRY),
    Mistake(
        "recording missing", "units.gnss.recording", "no such file", {"units.gnss": {**GNSS, "recording": "no.csv"}}, GEOMETRY
    ),
    Mistake("recording of a radar", "units.radar", "recording", {"units.radar.source": "recording"}),
    Mistake(
        "recording broken", "units.gnss", "line 3: longitude_deg", {"units.gnss": {**GNSS, "recording": "bad.csv"}}, GEOMETRY
    ),
    Mistake("recording not text", "units.gnss", "image.bin", {"units.gnss": {**GNSS, "recording": "image.bin"}}, GEOMETRY),
    Mistake("map of nothing", "units.gnss", "latitude_deg", {"units.gnss": {**GNSS, "recording": UNFIT}}, GEOMETRY),
    Mistake(
        "simulated gnss",
        "units.gnss",
        "rtk_fixed",
        {"units.gnss": {"kind": "gnss", "position_std_m": {"single": 1.0}}},
        GEOMETRY,
    ),
    Mistake("receiver left out", "units.gnss.receiver", "required", {"units.gnss": RECEIVER}, GEOMETRY),
    Mistake("receiver of a radar", "units.radar.receiver", "required", {"units.radar.source": "receiver"}),
    Mistake("live beside a world", "units.gnss.receiver", "world", {"units.gnss": {**RECEIVER, "receiver": LIVE}}, GEOMETRY),
    Mistake("two ways in", "units.gnss.receiver", "one of", {"units.gnss": {**RECEIVER, "receiver": TWO_WAYS}}, GEOMETRY),
    Mistake("position without geometry", "units.gnss", "geometry", {"units.gnss": GNSS}),
    Mistake("simulated units without a world", "units.radar", "world", {"world": REMOVED}),
    # world
    Mistake("unknown motion", WORLD, "white_jerk", {f"{WORLD}.kind": "stationary"}),
    Mistake("no motion", WORLD, "required", {"world": {"seed": 1}}),
    Mistake("negative seed", "world.seed", "", {"world.seed": -1}),
    Mistake("profile empty", f"{WORLD}.profile", "", {f"{WORLD}.profile": []}),
    Mistake("profile not from 0", WORLD, "increase", {f"{WORLD}.profile": [[1.0, 20.0]]}),
    Mistake("profile not increasing", WORLD, "increase", {f"{WORLD}.profile": [[0.0, 20.0], [9.0, 1.0], [9.0, 2.0]]}),
    Mistake("corner with three numbers", f"{WORLD}.profile.0", "", {f"{WORLD}.profile": [[0.0, 20.0, 1.0]]}),
    Mistake("hasty driver", f"{WORLD}.driver_time_s", "30", {f"{WORLD}.driver_time_s": 1.0}),
    Mistake("two deviations", f"{WORLD}.start_std", "", {f"{WORLD}.start_std": [0.1, 0.1]}),
    Mistake(
        "recorded motion missing",
        "world.motion.gnss_log",
        "no.csv",
        {"world.motion": {"kind": "recorded", "gnss_log": "no.csv"}},
        GEOMETRY,
    ),
    Mistake(
        "recorded motion broken",
        "world.motion.gnss_log",
        "line 3: longitude_deg",
        {"world.motion": {"kind": "recorded", "gnss_log": "bad.csv"}},
        GEOMETRY,
    ),
    Mistake(
        "recorded motion without geometry",
        "world.motion.gnss_log",
        "geometry",
        {"world.motion": {"kind": "recorded", "gnss_log": "log.csv"}},
    ),
    # line
    Mistake("line missing", "line", "no.yaml: no such file", {"line": "no.yaml"}),
    Mistake("line is a folder", "line", "no such file", {"line": "."}),
    Mistake("unknown key of a line", "lenght_m", "unknown key", line={"lenght_m": 1.0}, file="line.yaml"),
    Mistake("no length", "length_m", "required", line={"length_m": REMOVED}, file="line.yaml"),
    Mistake("length 0", "length_m", "greater than 0", line={"length_m": 0.0}, file="line.yaml"),
    Mistake(
        "balise beyond the line",
        "balises.1.position_m",
        "beyond",
        line={"balises": [{"id": "b1", "position_m": 1.0}, {"id": "b2", "position_m": 5001.0}]},
        file="line.yaml",
    ),
    Mistake(
        "balise twice",
        "balises.1.id",
        "duplicate",
        line={"balises": [{"id": "b1", "position_m": 1.0}, {"id": "b1", "position_m": 2.0}]},
        file="line.yaml",
    ),
    Mistake("balises all beyond", "balises.from_m", "beyond", line={"balises.from_m": 5050.0}, file="line.yaml"),
    Mistake("balises far beyond", "balises.from_m", "beyond", line={"balises.from_m": 9000.0}, file="line.yaml"),
    Mistake("balises too dense", "balises.every_m", "2.6", line={"balises.every_m": 0.1}, file="line.yaml"),
    Mistake("balise without id", "balises.0.id", "required", line={"balises": [{"position_m": 1.0}]}, file="line.yaml"),
    Mistake("geometry missing", "geojson", "no.geojson", line={**GEOMETRY, "geojson": "no.geojson"}, file="line.yaml"),
    *(
        Mistake(
            f"geometry {name}", "geojson", f"{name}.geojson", line={**GEOMETRY, "geojson": f"{name}.geojson"}, file="line.yaml"
        )
        for name in ("broken", "list", "point", "words", "nothing", "empty", "flat")
    ),
    *(
        Mistake(f"geometry {name}", "geojson", says, line={**GEOMETRY, "geojson": f"{name}.geojson"}, file="line.yaml")
        for name, says in (("single", "two points"), ("repeated", "differ"), ("off-earth", "line.yaml"), ("nan", "line.yaml"))
    ),
    Mistake(
        "geometry empty beside a length",
        "geojson",
        "empty.geojson",
        line={"geojson": "empty.geojson"},
        file="line.yaml",
    ),
)

GEOJSON: dict[str, Any] = {
    "line": {"type": "Feature", "geometry": {"type": "LineString", "coordinates": POINTS}},
    "list": [1, 2],
    "point": {"type": "Point", "coordinates": [4.5, 50.9]},
    "words": {"type": "LineString", "coordinates": [["a", "b"], ["c", "d"]]},
    "nothing": {},
    "empty": {"type": "LineString", "coordinates": []},
    "flat": {"type": "LineString", "coordinates": [4.5, 50.9]},
    "single": {"type": "LineString", "coordinates": POINTS[:1]},
    "repeated": {"type": "LineString", "coordinates": [POINTS[0], POINTS[0], POINTS[1]]},
    "off-earth": {"type": "LineString", "coordinates": [[4.5, 50.9], [4.5, 150.9]]},
    "nan": {"type": "LineString", "coordinates": [[4.5, 50.9], [4.5, float("nan")]]},
}


SUGGESTIONS = {
    "key": (
        {"spede": 1},
        "spede: unknown key; known keys: train, chaos, health_every_s, line, motion_model, prior, fusion, world, etcs, units",
    ),
    "key of a part": ({"fusion.horizon": 5.0}, "fusion.horizon: unknown key; did you mean 'horizon_s'?"),
    "key of a sensor": ({"units.radar.rate": 9.0}, "units.radar.rate: unknown key; did you mean 'rate_hz'?"),
    "key of a motion": ({f"{WORLD}.profil": []}, "world.motion.profil: unknown key; did you mean 'profile'?"),
    "key of a filter": (
        {"units.radar.filter": {"kind": "h_infinity", "gama": 2.0}},
        "units.radar.filter.gama: unknown key; did you mean 'gamma'?",
    ),
    "key instead of one that is required": (
        {"prior.speed_mps": REMOVED, "prior.sped_mps": 3.0},
        "prior.sped_mps: unknown key; did you mean 'speed_mps'?",
    ),
    "sensor": ({"units.radar.kind": "dopler_radar"}, "not 'dopler_radar'; did you mean 'doppler_radar'?"),
    "filter": ({"units.radar.filter": "kalmann"}, "not 'kalmann'; did you mean 'kalman'?"),
    "rule": ({"fusion.rule": "informaton"}, "not 'informaton'; did you mean 'information'?"),
    "motion": (
        {f"{WORLD}.kind": "white_jerks"},
        "kind must be one of white_jerk, recorded, recorded_path, not 'white_jerks'; did you mean 'white_jerk'?",
    ),
    "source": (
        {"units.radar.source": "recorded"},
        "units.radar.source: must be one of simulation, recording, receiver, not 'recorded'; did you mean 'recording'?",
    ),
}


@pytest.mark.parametrize("name", SUGGESTIONS)
def test_the_nearest_known_word_is_suggested(tmp_path: Path, name: str) -> None:
    changes, says = SUGGESTIONS[name]
    with pytest.raises(ConfigError) as caught:
        load_train(write_train(tmp_path, changes))
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"prior.speed_mps": "fast"}, "prior.speed_mps: Input should be a valid number, not 'fast'"),
        ({"prior.position_std_m": -2.5}, "prior.position_std_m: Input should be greater than 0, not -2.5"),
        ({"fusion.period_ms": 5000}, "fusion.period_ms: Input should be less than or equal to 1000, not 5000"),
        ({"fusion.shares": "by_acuracy"}, "fusion.shares: must be one of by_accuracy, not 'by_acuracy'"),
    ],
    ids=str,
)
def test_a_wrong_value_is_shown(tmp_path: Path, changes: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_train(write_train(tmp_path, changes))
    assert says in str(caught.value)


def test_a_long_value_is_shown_by_its_beginning(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load_train(write_train(tmp_path, {"prior.speed_mps": "x" * 1000}))
    assert str(caught.value).endswith("xxxxxxxx...")
    assert len(str(caught.value)) < len(str(tmp_path)) + 200


def write_files(folder: Path, mistake: Mistake) -> Path:
    for name, content in GEOJSON.items():
        (folder / f"{name}.geojson").write_text(json.dumps(content), encoding="utf-8")
    (folder / "broken.geojson").write_text('{"type": "LineString", "coord', encoding="utf-8")
    (folder / "log.csv").write_text("\n".join(LOG) + "\n", encoding="utf-8")
    (folder / "bad.csv").write_text("\n".join([*LOG[:2], LOG[2].replace("4.5002", "east"), *LOG[3:]]), encoding="utf-8")
    (folder / "image.bin").write_bytes(b"\x89PNG\r\n\x1a\n\x00\xff\xfe")
    return write_train(folder, mistake.train, mistake.line)


def only_mistake(said: str) -> str:
    """The one line besides the one that says what is being read."""
    (line,) = [line for line in said.splitlines() if not line.startswith("milepost: reading ")]
    return line


@pytest.fixture
def up_says(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Run `milepost up` on a train file and return its one line; fails if it would have started anything."""

    def nothing_may_start(*_: object) -> None:
        pytest.fail("the mistake was not noticed: something would have been started")

    monkeypatch.setattr(up_command, "Supervisor", nothing_may_start)

    def run(*arguments: str) -> str:
        monkeypatch.setattr(sys, "argv", ["milepost", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert said.err.endswith("\n")
        return only_mistake(said.err)

    return run


def test_the_valid_files_load(tmp_path: Path) -> None:
    train = load_train(write_files(tmp_path, Mistake("none", "")))
    assert list(train.sensors) == ["radar", "loop", "balise-reader"]
    assert train.fused_units == ["radar", "loop"]
    with_geometry = load_train(write_files(tmp_path, Mistake("none", "", train={"units.gnss": GNSS}, line=GEOMETRY)))
    assert with_geometry.line.track is not None
    assert with_geometry.fused_units == ["radar", "loop", "gnss"]


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda m: m.name)
def test_a_mistake_is_one_line_naming_file_and_field(tmp_path: Path, up_says: Any, mistake: Mistake) -> None:
    line = up_says("up", "--train", str(write_files(tmp_path, mistake)), "--listen", "tcp/127.0.0.1:0")
    where = f"milepost: {tmp_path / mistake.file}: {mistake.field}"
    assert line.startswith(where), line
    assert mistake.says in line


TEXTS = {
    "key twice": ("train: a\nline: b\ntrain: c\n", "line 3", "duplicate key 'train'"),
    "key twice in a part": ("train: a\nfusion:\n  rule: x\n  rule: y\n", "line 4", "duplicate key 'rule'"),
    "not yaml": ("train: [1, 2\nline: }", "line 2", ""),
    "tab": ("train:\n\tx: 1\n", "line 2", ""),
    "empty": ("", "", "not a mapping"),
    "list": ("- 1\n- 2\n", "", "not a mapping"),
    "text": ("maglev", "", "not a mapping"),
    "unknown tag": ("train: !!python/object:os.system ls\n", "line 1", ""),
    "unknown anchor": ("train: *nobody\n", "line 1", ""),
    "impossible date": ("train: 2024-13-45\n", "", ""),
    "impossible number": ("train: 0x_\n", "", ""),
    "list as key": ("? [a]\n: 1\n", "", ""),
    "control character": ("train: \x07\n", "", ""),
    "key of two lines": ('"train\\nline": 1\n', "", ""),
    "bottomless": ("[" * 3000, "", ""),
    "two documents": ("train: a\n---\ntrain: b\n", "line", ""),
}


@pytest.mark.parametrize("name", TEXTS)
def test_invalid_yaml_is_reported_in_one_line(tmp_path: Path, up_says: Any, name: str) -> None:
    text, field_, says = TEXTS[name]
    path = tmp_path / "train.yaml"
    path.write_text(text, encoding="utf-8")
    line = up_says("up", "--train", str(path))
    assert line.startswith(f"milepost: {path}: {field_}")
    assert says in line


def test_an_unreadable_file_is_reported_in_one_line(tmp_path: Path, up_says: Any) -> None:
    path = tmp_path / "train.yaml"
    assert up_says("up", "--train", str(path)) == f"milepost: {path}: No such file or directory"
    path.write_bytes(b"\xff\xfe\x00t")
    assert up_says("up", "--train", str(path)) == f"milepost: {path}: not UTF-8 text"
    assert up_says("up", "--train", str(tmp_path)) == f"milepost: {tmp_path}: Is a directory"


@pytest.mark.parametrize("endpoint", ["here", "tcp/127.0.0.1:99999", "tcp/127.0.0.1:", "tcp/:x", "udp/127.0.0.1:7447", ""])
def test_an_invalid_endpoint_is_reported_in_one_line(tmp_path: Path, up_says: Any, endpoint: str) -> None:
    assert up_says("up", "--train", str(write_train(tmp_path)), "--listen", endpoint).startswith("milepost: up: --listen: ")


SCENARIO_MISTAKES: dict[str, tuple[dict[str, Any], str, str]] = {
    "unknown key": ({"durations": 1.0}, "durations", "unknown key"),
    "unknown train": ({"train": "metor"}, "train: metor: neither a file nor", "did you mean 'metro'?"),
    "train file that is not there": ({"train": "trian.yaml"}, "train: trian.yaml: no such file", "did you mean 'train.yaml'?"),
    "no duration": ({"duration_s": REMOVED}, "duration_s", "required"),
    "negative duration": ({"duration_s": -1.0}, "duration_s", "greater than 0"),
    "text for a number": ({"duration_s": "long"}, "duration_s", "number"),
    "negative seed": ({"seed": -1}, "seed", ""),
    "list for changes": ({"change": [1]}, "change", ""),
    "withheld without a unit": ({"withheld": {"from_s": 0.0, "to_s": 1.0}}, "withheld.unit", "required"),
    "withheld of nobody": ({"withheld": {"unit": "wheel", "from_s": 0.0, "to_s": 1.0}}, "withheld.unit", "wheel"),
    "alone without anybody": ({"alone": ["wheel"]}, "alone", "wheel"),
    "fault of nobody": ({"faults": [{"unit": "rader", "kind": "stuck", "from_s": 1.0}]}, "faults.0.unit", "'radar'"),
    "unknown fault": ({"faults": [{"unit": "radar", "kind": "broken", "from_s": 1.0}]}, "faults.0: kind", "'broken'"),
    "fault of a balise that is not there": (
        {"faults": [{"unit": "balise-reader", "kind": "missed_balise", "from_s": 1.0, "balise": "zzz"}]},
        "faults.0",
        "balise-reader: balise: zzz is not among the 50 of test-line",
    ),
    "fault without its option": ({"faults": [{"unit": "radar", "kind": "bias", "from_s": 1.0}]}, "faults.0: size", "required"),
    "misspelt option of a fault": (
        {"faults": [{"unit": "radar", "kind": "bias", "from_s": 1.0, "siz": 1.0}]},
        "faults.0: siz: not an option of bias, which has size",
        "did you mean 'size'?",
    ),
    "option of another fault": (
        {"faults": [{"unit": "radar", "kind": "stuck", "from_s": 1.0, "size": 1.0}]},
        "faults.0: size",
        "not an option of stuck",
    ),
    "fault that does not fit": (
        {"variants": {"v": {"faults": [{"unit": "radar", "kind": "jump", "from_s": 1.0, "size": 1.0}]}}},
        "variants.v.faults.0.kind",
        "radar: jump does not fit speed_reading",
    ),
    "fault of an estimator that does not fit": (
        {"estimators": {"e": {"faults": [{"unit": "radar", "kind": "spin", "from_s": 1.0, "ratio": 1.0}]}}},
        "estimators.e.faults.0.kind",
        "spin does not fit doppler_radar, but odometer",
    ),
}


@pytest.mark.parametrize("name", SCENARIO_MISTAKES)
def test_a_mistake_in_a_scenario_is_reported_in_one_line(tmp_path: Path, up_says: Any, name: str) -> None:
    changes, field_, says = SCENARIO_MISTAKES[name]
    write_train(tmp_path)
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(changed(SCENARIO_FILE, changes)), encoding="utf-8")
    line = up_says("evaluate", str(path))
    assert line.startswith(f"milepost: {path}: {field_}"), line
    assert says in line


@pytest.mark.parametrize("typed", [["--siz", "1"], ["--siz=1"], ["--size", "1", "--siz", "2"]])
def test_a_misspelt_option_of_inject_is_named_with_the_nearest(up_says: Any, typed: list[str]) -> None:
    line = up_says("inject", "radar", "bias", *typed)
    assert line == "milepost: inject: --siz: not an option of bias, which has --size; did you mean '--size'?"


def test_an_invalid_change_is_reported_with_the_scenario_and_field(tmp_path: Path) -> None:
    write_train(tmp_path)
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump({**SCENARIO_FILE, "change": {"prior": {"speed_mps": "fast"}}}), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_scenario(path)
    assert str(caught.value).startswith(f"{path}: change: ")
    assert "prior.speed_mps: " in str(caught.value)


def test_a_scenarios_changes_seed_and_rule_override_the_train_file(tmp_path: Path) -> None:
    write_train(tmp_path)
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump({**SCENARIO_FILE, "seed": 5, "change": {"prior": {"speed_mps": 7.0}}}), encoding="utf-8")
    _, train = load_scenario(path)
    assert (train.file.prior.speed_mps, train.file.prior.speed_std_mps) == (7.0, 0.1)
    assert train.file.world is not None
    assert train.file.world.seed == 5
    _, train = load_scenario(path, seed=9, rule="federated")
    assert train.file.world is not None
    assert (train.file.world.seed, train.file.fusion.rule) == (9, "federated")


def run_up(train: Path) -> tuple[int, str, str]:
    """Exit code, output and errors of `milepost up`. A process that it left behind would hold the pipes, and time out here."""
    child = subprocess.Popen(
        [sys.executable, "-m", "milepost", "up", "--train", str(train), "--listen", "tcp/127.0.0.1:0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    out, err = child.communicate(timeout=60)
    return child.returncode, out, err


@pytest.mark.parametrize("name", ["unknown sensor", "recording broken", "geometry broken"])
def test_the_command_exits_with_2_and_starts_no_process(tmp_path: Path, name: str) -> None:
    mistake = next(m for m in MISTAKES if m.name == name)
    code, out, err = run_up(write_files(tmp_path, mistake))
    assert (code, out) == (2, "")
    assert only_mistake(err).startswith(f"milepost: {tmp_path / mistake.file}: {mistake.field}")


def test_defaults_are_those_of_the_design(tmp_path: Path) -> None:
    train = load_train(write_train(tmp_path, {"fusion": REMOVED}))
    fusion = train.file.fusion
    assert (fusion.rule, fusion.period_ms, fusion.deadline_ms, fusion.horizon_s) == ("information", 20, 15.0, 5.0)
    assert fusion.feedback
    assert train.sensors["radar"].options.speed_variance_m2ps2 == 0.04
    assert train.sensors["radar"].period_s == 0.01
    assert train.sensors["loop"].period_s is None
    line = load_line(tmp_path / "line.yaml")
    assert line.balises[0].location_accuracy_m == 12.0


def test_balises_of_a_rule_stand_at_equal_distances(tmp_path: Path) -> None:
    write_train(tmp_path, line={"length_m": 1000.0, "balises": {"every_m": 250.0, "from_m": 0.0, "prefix": "x"}})
    line = load_line(tmp_path / "line.yaml")
    assert [(b.balise_id, b.position_m) for b in line.balises] == [
        ("x00001", 0.0),
        ("x00002", 250.0),
        ("x00003", 500.0),
        ("x00004", 750.0),
        ("x00005", 1000.0),
    ]


def test_listed_balises_are_put_in_order_of_chainage(tmp_path: Path) -> None:
    rows = [{"id": "far", "position_m": 900.0}, {"id": "near", "position_m": 10.0, "location_accuracy_m": 0.5}]
    write_train(tmp_path, line={"balises": rows})
    line = load_line(tmp_path / "line.yaml")
    assert [(b.balise_id, b.location_accuracy_m) for b in line.balises] == [("near", 0.5), ("far", 12.0)]


def test_a_lines_length_defaults_to_its_geometrys(tmp_path: Path) -> None:
    write_files(tmp_path, Mistake("none", "", line=GEOMETRY))
    line = load_line(tmp_path / "line.yaml")
    assert line.track is not None
    assert line.length_m == line.track.length_m


@pytest.mark.parametrize(
    ("change", "differs"),
    [
        ({"balises.every_m": 50.0}, True),
        ({"balises.from_m": 101.0}, True),
        ({"balises.prefix": "x"}, True),
        ({"balises.location_accuracy_m": 1.0}, True),
        ({"map_accuracy_m": 0.5}, True),
        ({"length_m": 5001.0}, True),
        ({"line": "other-line"}, True),
        ({"map_accuracy_m": 0.0}, False),
    ],
    ids=str,
)
def test_the_lines_hash_changes_with_its_content(tmp_path: Path, change: dict[str, Any], differs: bool) -> None:
    path = tmp_path / "line.yaml"
    path.write_text(yaml.safe_dump(LINE_FILE), encoding="utf-8")
    before = load_line(path).content_hash
    path.write_text(yaml.safe_dump(changed(LINE_FILE, change)), encoding="utf-8")
    assert (load_line(path).content_hash != before) == differs


def test_paths_are_relative_to_the_file_that_names_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "trains").mkdir()
    (tmp_path / "elsewhere").mkdir()
    path = write_train(tmp_path / "trains")
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert load_train(path).file.line == tmp_path / "trains" / "line.yaml"


def test_floats_of_yaml_1_2_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: 1e-6\nb: -2E3\nc: 1.5e+2\nd: 7\ne: 1e\n", encoding="utf-8")
    assert read_yaml(path) == {"a": 1e-6, "b": -2000.0, "c": 150.0, "d": 7, "e": "1e"}


def test_a_change_replaces_values_and_lists_and_merges_mappings() -> None:
    base = {"a": {"b": 1, "c": [1, 2]}, "d": 4}
    assert merged(base, {"a": {"c": [3]}, "d": {"e": 5}}) == {"a": {"b": 1, "c": [3]}, "d": {"e": 5}}
    assert base == {"a": {"b": 1, "c": [1, 2]}, "d": 4}


def needs_data(error: ConfigError) -> bool:
    return "shared/data" in str(error) and "such file" in str(error)


DEPLOY = Path(__file__).resolve().parents[2] / "deploy"


@pytest.mark.parametrize("path", sorted(DEPLOY.glob("trains/*.yaml")), ids=lambda p: p.stem)
def test_every_train_that_we_ship_loads_and_can_be_built(path: Path) -> None:
    try:
        train = load_train(path)
    except ConfigError as error:
        if needs_data(error):
            pytest.skip(f"needs recorded data: {error}")
        raise
    listed = processes(train)
    assert len({process.name for process in listed}) == len(listed)
    assert {process.role for process in listed} <= set(ROLES)


@pytest.mark.parametrize("path", sorted(DEPLOY.glob("scenarios/*.yaml")), ids=lambda p: p.stem)
def test_every_scenario_that_we_ship_loads(path: Path) -> None:
    try:
        scenario, train = load_scenario(path)
    except ConfigError as error:
        if needs_data(error):
            pytest.skip(f"needs recorded data: {error}")
        raise
    assert scenario.scenario == path.stem
    assert set(scenario.alone) <= set(train.fused_units)


def test_the_example_train_uses_every_section_of_a_train_file() -> None:
    assert set(TRAIN_FILE) == {"train", "line", "motion_model", "prior", "fusion", "world", "units"}
