"""Fleet files: what they may say, and mistakes in one line."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
import yaml

from milepost.cli.recording.job import recorder_jobs
from milepost.config.fleet_file import load_fleet, load_together
from milepost.config.shipped_files import find_file, names_in
from milepost.config.train import load_train
from milepost.config.yaml_files import ConfigError
from milepost.runtime.process import ProcessOptions
from milepost.runtime.together.jobs import together_jobs
from milepost.runtime.train_jobs import checked_world, train_jobs

GUIDE = Path("deploy/fleets/README.md").read_text(encoding="utf-8")


def written(folder: Path, *trains: dict) -> Path:
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump({"fleet": "mine", "trains": list(trains)}), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", names_in("fleets"))
def test_a_shipped_fleet_loads_with_names_that_differ(name: str) -> None:
    members = load_fleet(find_file(Path(name), "fleets"))
    assert len({member.train.name for member in members}) == len(members) > 1


def test_a_member_differs_from_its_train_file_in_what_is_stated(tmp_path: Path) -> None:
    change = {"world": {"seed": 7}}
    entry = {"train": "maglev", "name": "airport-1", "line": "airport-maglev", "start_after_s": 2.5, "change": change}
    (member,) = load_fleet(written(tmp_path, entry))
    assert (member.train.name, member.train.line.name, member.start_after_s) == ("airport-1", "airport-maglev", 2.5)
    assert member.train.file.world.seed == 7
    # what is told to a process that cannot be forked makes the same train
    assert member.change["train"] == "airport-1"
    assert Path(member.change["line"]).name == "airport-maglev.yaml"


def test_a_train_may_lie_beside_the_fleet_file(tmp_path: Path, root: Path) -> None:
    fields = yaml.safe_load((root / "deploy/trains/maglev.yaml").read_text(encoding="utf-8"))
    fields |= {"train": "own-1", "line": str(root / "deploy/lines/maglev-test-track.yaml")}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(fields), encoding="utf-8")
    assert [member.train.name for member in load_fleet(written(tmp_path, {"train": "own.yaml"}))] == ["own-1"]


@pytest.mark.parametrize(
    ("trains", "line"),
    [
        ([], "trains: List should have at least 1 item"),
        ([{"train": "metro"}, {"train": "metro"}], "trains.1.name: trains.0 is called metro-1 too; names must differ"),
        ([{"train": "metor"}], "trains.0.train: metor: neither a file nor one of the trains: "),
        ([{"train": "metro", "nam": "x"}], "trains.0.nam: unknown key; did you mean 'name'?"),
        ([{"train": "metro", "name": "Metro 2"}], "trains.0.name: "),
        ([{"train": "metro", "start_after_s": -1.0}], "trains.0.start_after_s: "),
        ([{"train": "metro", "line": "nowhere"}], "trains.0.line: nowhere: "),
        ([{"train": "metro", "external": ["radar"]}], "trains.0.external: must be one of odometer-1, "),
        ([{"train": "metro", "change": {"fusion": {"period_ms": 0}}}], "trains.0: "),
    ],
    ids=["none", "same name", "no train", "unknown key", "bad name", "negative delay", "no line", "no unit", "bad change"],
)
def test_a_mistake_is_one_line_that_names_the_place(tmp_path: Path, trains: list[dict], line: str) -> None:
    path = written(tmp_path, *trains)
    with pytest.raises(ConfigError) as caught:
        load_fleet(path)
    assert str(caught.value).startswith(f"{path}: {line}")
    assert "\n" not in str(caught.value)


def test_a_sensor_of_somebody_elses_has_no_process_here() -> None:
    """What is needed to build it, such as a world, is not asked for either."""
    (member,) = load_together([find_file(Path("metro"), "trains")], ["radar-1"])
    world = checked_world(member.train, 10.0, member.external)
    names = {job.name for job in train_jobs(member.train, world, ProcessOptions([]), None, member.external)}
    assert "sensor-radar-1" not in names
    assert {"filter-radar-1", "sensor-radar-2"} <= names
    with pytest.raises(ConfigError, match=r"up: --external: must be one of odometer-1, .*, not 'radar'; did you mean"):
        load_together([member.train.path], ["radar"])


def test_a_process_that_cannot_be_forked_is_told_what_is_different_from_the_train_file(tmp_path: Path) -> None:
    (member,) = load_fleet(written(tmp_path, {"train": "maglev", "name": "airport-1", "line": "airport-maglev"}))
    shared = ProcessOptions([], change=json.dumps(member.change))
    recorder = recorder_jobs(member.train, tmp_path / "recording", shared, None)
    for job in (*recorder, *train_jobs(member.train, checked_world(member.train, 10.0), shared)):
        told = dict(zip(job.options[::2], job.options[1::2], strict=True))
        train = load_train(Path(told["--train"]), json.loads(told["--change"]))
        assert (train.name, train.line.name) == ("airport-1", "airport-maglev")
        assert job.title.endswith("(airport-1)")
        assert job.label == f"airport-1 {job.name}"


@pytest.mark.parametrize("block", re.findall(r"```yaml\n(.*?)```", GUIDE, re.S))
def test_the_guides_file_is_one(tmp_path: Path, block: str) -> None:
    (tmp_path / "invented.yaml").write_text(block, encoding="utf-8")
    assert [member.train.name for member in load_fleet(tmp_path / "invented.yaml")] == ["metro-1", "metro-2"]


def test_two_trains_of_one_name_are_refused_with_both_files() -> None:
    metro = find_file(Path("metro"), "trains")
    with pytest.raises(ConfigError, match=r"up: --train: .*metro.yaml and .*metro.yaml are both called metro-1"):
        load_together([metro, metro])


def test_a_count_makes_so_many_trains_that_differ_in_name_and_seed(tmp_path: Path) -> None:
    entry = {"train": "metro", "name": "tram", "count": 3, "change": {"world": {"seed": 5}}}
    members = load_fleet(written(tmp_path, entry, {"train": "maglev", "count": 1}))
    assert [member.train.name for member in members] == ["tram-1", "tram-2", "tram-3", "maglev-1-1"]
    assert [member.train.file.world.seed for member in members[:3]] == [5, 6, 7]
    # what is told to a process that cannot be forked makes the same train
    assert load_train(members[2].train.path, members[2].change).file == members[2].train.file


def test_names_that_a_count_makes_may_not_be_taken(tmp_path: Path) -> None:
    path = written(tmp_path, {"train": "metro", "name": "tram-2"}, {"train": "metro", "name": "tram", "count": 2})
    with pytest.raises(ConfigError, match=r"trains\.1\.name: trains.0 is called tram-2 too; names must differ"):
        load_fleet(path)


def test_trains_that_run_together_have_no_more_processes_than_there_are_cores() -> None:
    members = load_fleet(find_file(Path("three-trains"), "fleets"))
    jobs = list(together_jobs(members, ProcessOptions([]), (), several=True))
    assert len(jobs) == min(3, len(os.sched_getaffinity(0)))
    named = [name for job in jobs for name in job.train.split(", ")]
    assert sorted(named) == ["airport-1", "metro-1", "metro-2"]


def test_a_train_alone_that_cannot_be_forked_is_told_all_that_its_processes_are(tmp_path: Path) -> None:
    (member,) = load_fleet(written(tmp_path, {"train": "maglev", "name": "airport-1", "external": ["radar"]}))
    shared = ProcessOptions(["tcp/127.0.0.1:1"], duration_s=5.0, state_dir=tmp_path)
    (job,) = together_jobs([member], shared, ("recorder",), several=True)
    told = dict(zip(job.options[::2], job.options[1::2], strict=True))
    assert (told["--duration"], told["--speed"], told["--await"], told["--external"]) == ("5.0", "1.0", "recorder", "radar")
    assert (told["--state-dir"], json.loads(told["--change"])["train"]) == (str(tmp_path), "airport-1")
    assert job.title == "milepost run together (airport-1)"
