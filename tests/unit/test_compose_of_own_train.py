"""`milepost compose` for a train of one's own: which files its containers have, and where."""

from __future__ import annotations

import shutil
from pathlib import Path, PurePosixPath
from typing import Any

import pytest
import yaml

from milepost.cli.composing.compose import Beside, compose
from milepost.cli.composing.services import flow, literal, word
from milepost.cli.composing.train_files import train_files
from milepost.config.train import load_train

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
RECORDING = {
    "file": "../logs/radar.csv",
    "time": {"column": "t_s"},
    "columns": {"speed_mps": {"column": "v", "unit": "m/s"}},
    "constants": {"speed_variance_m2ps2": 0.04},
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The maglev train and its line, as somebody has them in a folder of his own."""
    for kind, name in (("trains", "maglev.yaml"), ("lines", "maglev-test-track.yaml")):
        (tmp_path / kind).mkdir()
        shutil.copy(DEPLOY / kind / name, tmp_path / kind / name)
    return tmp_path


def changed(path: Path, change: dict[str, Any]) -> Path:
    """The train file with some keys changed, mapping by mapping where a key names one with dots."""
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    for place, value in change.items():
        *outer, last = place.split(".")
        inside = content
        for key in outer:
            inside = inside[key]
        inside[last] = value
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def targets(path: Path) -> dict[str, str]:
    return {str(each.target): str(each.source) for each in train_files(load_train(path)).all}


def test_files_keep_their_places_as_seen_from_each_other(folder: Path) -> None:
    """GIVEN a train beside the folder of its line, THEN containers have both beside each other."""
    assert targets(folder / "trains" / "maglev.yaml") == {
        "/srv/milepost/trains/maglev.yaml": str(folder / "trains" / "maglev.yaml"),
        "/srv/milepost/lines/maglev-test-track.yaml": str(folder / "lines" / "maglev-test-track.yaml"),
    }


def test_a_train_and_its_line_may_share_a_folder_and_nothing_else_of_it_is_mounted(folder: Path) -> None:
    """GIVEN both in one folder with a key, THEN containers have the two files, and not the folder."""
    shutil.copy(folder / "lines" / "maglev-test-track.yaml", folder / "line.yaml")
    shutil.copy(folder / "trains" / "maglev.yaml", folder / "mine.yaml")
    (folder / "ca.key").write_text("secret", encoding="utf-8")
    path = changed(folder / "mine.yaml", {"line": "line.yaml"})
    assert sorted(targets(path)) == ["/srv/milepost/line.yaml", "/srv/milepost/mine.yaml"]


def test_a_recording_is_mounted(folder: Path) -> None:
    """GIVEN a unit that replays a recording, THEN containers have it where the train file says."""
    (folder / "logs").mkdir()
    (folder / "logs" / "radar.csv").write_text("t_s,v\n0.0,20.0\n0.5,20.0\n", encoding="utf-8")
    change = {"units.radar.source": "recording", "units.radar.recording": RECORDING}
    path = changed(folder / "trains" / "maglev.yaml", change)
    assert targets(path)["/srv/milepost/logs/radar.csv"] == str(folder / "logs" / "radar.csv")


def test_a_file_that_is_named_by_its_whole_path_is_there_by_it(folder: Path) -> None:
    line = folder / "lines" / "maglev-test-track.yaml"
    path = changed(folder / "trains" / "maglev.yaml", {"line": str(line)})
    assert targets(path) == {"/srv/milepost/maglev.yaml": str(path), str(line): str(line)}


def test_the_geometry_of_a_line_is_mounted(folder: Path) -> None:
    shutil.copy(DEPLOY / "lines" / "airport-maglev.geojson", folder / "points.geojson")
    line = folder / "lines" / "maglev-test-track.yaml"
    line.write_text("line: own\ngeojson: ../points.geojson\n", encoding="utf-8")
    path = changed(folder / "trains" / "maglev.yaml", {"world.motion.profile": [[0.0, 20.0]]})
    assert "/srv/milepost/points.geojson" in targets(path)


def test_a_link_is_mounted_as_what_it_leads_to(folder: Path) -> None:
    """GIVEN a line file that is a symbolic link, THEN containers have its content under the name that the train file says."""
    line = folder / "lines" / "maglev-test-track.yaml"
    line.rename(folder / "real.yaml")
    line.symlink_to(folder / "real.yaml")
    found = targets(folder / "trains" / "maglev.yaml")
    assert found["/srv/milepost/lines/maglev-test-track.yaml"] == str(folder / "real.yaml")


def test_paths_in_the_file_are_those_of_the_working_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a working folder, THEN what is in it is named from there, and what is elsewhere by its whole path."""
    monkeypatch.chdir(folder / "trains")
    text, unreadable = compose(Path("maglev.yaml"), "maglev.yaml", Beside())
    mounts = yaml.safe_load(text)["x-process"]["volumes"]
    assert [each["source"] for each in mounts] == ["./maglev.yaml", str(folder / "lines" / "maglev-test-track.yaml")]
    assert unreadable == []


def test_a_file_that_containers_cannot_read_is_named(folder: Path) -> None:
    line = folder / "lines" / "maglev-test-track.yaml"
    line.chmod(0o600)
    _, unreadable = compose(folder / "trains" / "maglev.yaml", "maglev.yaml", Beside())
    assert unreadable == [line]


def test_a_serial_receiver_has_its_device(tmp_path: Path) -> None:
    """GIVEN a receiver on a serial device, THEN its sensor's container has the device, and no other one has."""
    source = yaml.safe_load((DEPLOY / "trains" / "gnss-ins.yaml").read_text(encoding="utf-8"))
    source["line"] = str(DEPLOY / "lines" / "airport-maglev-open.yaml")
    del source["world"]
    for unit in list(source["units"]):
        if source["units"][unit]["kind"] != "gnss":
            del source["units"][unit]
    (unit,) = source["units"]
    source["units"][unit] |= {"source": "receiver", "receiver": {"protocol": "ubx", "serial": "/dev/ttyACM0"}}
    source["fusion"].pop("shares", None)
    path = tmp_path / "real.yaml"
    path.write_text(yaml.safe_dump(source), encoding="utf-8")
    services = yaml.safe_load(compose(path, "real.yaml", Beside())[0])["services"]
    assert services[f"sensor-{unit}"]["devices"] == ["/dev/ttyACM0:/dev/ttyACM0"]
    assert [name for name, fields in services.items() if "devices" in fields] == [f"sensor-{unit}"]
    assert "world" not in services


@pytest.mark.parametrize("text", ["on", "no", "1", "a b", "x:y", "./a b/$HOME.yaml", "~", "-", "null", "0x1", "é", '"', "#a"])
def test_any_text_comes_back_from_yaml(text: str) -> None:
    assert yaml.safe_load(f"a: {word(text)}") == {"a": text}
    assert yaml.safe_load(flow([text, "b"])) == [text, "b"]
    assert yaml.safe_load(literal(text)) == text.replace("$", "$$")


def test_a_path_above_the_root_stays_in_the_folder(folder: Path) -> None:
    """GIVEN a file that is named through more folders than there are above it, THEN it is still in the containers' folder."""
    line = folder / "lines" / "maglev-test-track.yaml"
    path = changed(folder / "trains" / "maglev.yaml", {"line": "../" * 40 + str(line)[1:]})
    found = train_files(load_train(path))
    assert found.line.source == line
    assert found.line.target == PurePosixPath("/srv/milepost") / str(line)[1:]
