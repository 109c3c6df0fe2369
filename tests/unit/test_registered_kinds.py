"""Kinds of sensors and filters that other distributions register."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
import yaml

from examples import LINE_FILE, TRAIN_FILE, changed
from milepost.estimation.filters import FILTERS
from milepost.sensors import SENSORS

ROOT = Path(__file__).resolve().parents[2]
GUIDE = (ROOT / "docs/add-a-sensor.md").read_text(encoding="utf-8")
FILTER = '''

from dataclasses import dataclass

from milepost.estimation.filters.kalman import KalmanFilter


@dataclass(frozen=True)
class PatientOptions:
    """Its options."""

    factor: float = 4.0


class Patient(KalmanFilter):
    """A Kalman filter with an option that it does not use."""

    kind = "patient"
    options_model = PatientOptions
'''
SCENARIO = {"scenario": "short", "train": "train.yaml", "duration_s": 3.0, "compare": ["fused"]}


def block(language: str) -> str:
    (found, *_) = re.findall(rf"```{language}\n(.*?)```", GUIDE, re.S)
    return str(found)


def module() -> str:
    """The module of the guide's distribution: its sensor, with imports in full, and a filter."""
    return block("python").replace("from .", "from milepost.sensors.") + FILTER


def write_scenario(folder: Path, unit: Mapping[str, object]) -> Path:
    """A train with one more unit, and a scenario of three seconds of it."""
    for name, content in (
        ("line", LINE_FILE),
        ("train", changed(TRAIN_FILE, {"units.new": unit})),
        ("scenario", SCENARIO),
    ):
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return folder / "scenario.yaml"


def register(site: Path, distribution: str, group: str, entry: str, source: str = "") -> None:
    """What an installed distribution leaves behind: a folder of metadata and a module."""
    info = site / f"{distribution.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(f"[{group}]\n{entry}\n", encoding="utf-8")
    name = entry.partition("=")[2].partition(":")[0].strip()
    if source:
        (site / f"{name}.py").write_text(source, encoding="utf-8")


def milepost(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    paths = [str(ROOT / "services"), str(ROOT / "schemas"), str(site)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "milepost", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.slow
def test_a_train_runs_with_kinds_of_an_installed_distribution(tmp_path: Path) -> None:
    """GIVEN the guide's distribution, installed by pip, WHEN a train names its kinds, THEN the unit is fused."""
    source, site, folder = tmp_path / "source", tmp_path / "site", tmp_path / "train"
    for each in (source, folder):
        each.mkdir()
    (source / "pyproject.toml").write_text(block("toml"), encoding="utf-8")
    (source / "optical_sensor.py").write_text(module(), encoding="utf-8")
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "-q",
        "--no-build-isolation",
        "--no-deps",
        "--no-index",
        "--target",
        str(site),
    ]
    subprocess.run([*pip, str(source)], check=True, timeout=300, capture_output=True)
    scenario = write_scenario(folder, {"kind": "optical", "filter": {"kind": "patient", "factor": 2.0}})
    log = folder / "log.jsonl"
    done = milepost(site, "evaluate", str(scenario), "--json", "--record", str(log))
    assert done.returncode == 0, done.stderr
    assert '"unit":"new"' in log.read_text(encoding="utf-8").replace(" ", "")
    schemas = milepost(site, "schema", "--out", str(tmp_path / "out"))
    assert schemas.returncode == 0, schemas.stderr
    train_schema = (tmp_path / "out/schemas/config/train.schema.json").read_text(encoding="utf-8")
    assert '"optical"' in train_schema
    assert '"patient"' in train_schema


SENSOR_ENTRY = "optical = optical_sensor:Optical"
BROKEN = {
    "a module that is not there": (
        "milepost.sensors",
        SENSOR_ENTRY,
        "",
        "ModuleNotFoundError: No module named 'optical_sensor'",
    ),
    "a module that fails": ("milepost.sensors", SENSOR_ENTRY, "raise RuntimeError('no\\nlicence')", "RuntimeError: no licence"),
    "another name": ("milepost.sensors", "optic = optical_sensor:Optical", module(), "its `kind` is 'optical', which must be"),
    "no sensor": ("milepost.sensors", SENSOR_ENTRY, "Optical = dict", "not a subclass of milepost.sensors.base.Sensor"),
    "half a sensor": (
        "milepost.sensors",
        SENSOR_ENTRY,
        "from milepost.sensors.base import Sensor, SensorOptions\n"
        "class Optical(Sensor):\n    kind = 'optical'\n    stream = 'speed_reading'\n    options_model = SensorOptions\n",
        "it does not define observe, open",
    ),
    "another stream": (
        "milepost.sensors",
        SENSOR_ENTRY,
        module().replace('stream = "speed_reading"', 'stream = "state"'),
        "its `stream` must be one of speed_reading",
    ),
    "options of another kind": (
        "milepost.filters",
        "optical = optical_sensor:Patient",
        module().replace("@dataclass(frozen=True)\n", "").replace('kind = "patient"', 'kind = "optical"'),
        "its `options_model` is not a dataclass",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_kind_is_one_line_that_names_distribution_and_entry(case: str, tmp_path: Path) -> None:
    group, entry, source, said = BROKEN[case]
    name = entry.partition(" ")[0]
    register(tmp_path, "optical-sensor", group, entry, source)
    unit = {"kind": name} if group == "milepost.sensors" else {"kind": "doppler_radar", "filter": name}
    done = milepost(tmp_path, "evaluate", str(write_scenario(tmp_path, unit)))
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"milepost: optical-sensor: entry point {group}: {entry}: ")
    assert said in line


@pytest.mark.slow
def test_a_broken_kind_that_no_unit_names_stops_nothing(tmp_path: Path) -> None:
    register(tmp_path, "optical-sensor", "milepost.sensors", SENSOR_ENTRY)
    done = milepost(tmp_path, "evaluate", str(write_scenario(tmp_path, {"kind": "doppler_radar"})))
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("group", ["milepost.sensors", "milepost.filters"])
def test_a_name_that_is_taken_is_an_error(group: str, tmp_path: Path) -> None:
    own = "odometer" if group == "milepost.sensors" else "kalman"
    scenario = write_scenario(tmp_path, {"kind": "doppler_radar"})
    register(tmp_path / "one", "first", group, f"{own} = nowhere:X")
    done = milepost(tmp_path / "one", "evaluate", str(scenario))
    assert done.returncode == 2
    assert done.stderr == (
        f"milepost: first: entry point {group}: {own} = nowhere:X: the name is taken by Milepost's own {own}\n"
    )
    for distribution in ("first", "second"):
        register(tmp_path / "two", distribution, group, "laser = nowhere:X")
    done = milepost(tmp_path / "two", "evaluate", str(scenario))
    assert done.returncode == 2
    assert done.stderr == f"milepost: second: entry point {group}: laser = nowhere:X: the name is taken by first\n"


def test_without_other_distributions_the_tables_have_our_own_kinds() -> None:
    assert not SENSORS.elsewhere
    assert not FILTERS.elsewhere
    assert len(SENSORS) == len(list(SENSORS))
    assert "odometer" in SENSORS
    assert "optical" not in SENSORS
    with pytest.raises(KeyError):
        SENSORS["optical"]
