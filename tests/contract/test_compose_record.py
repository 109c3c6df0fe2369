"""compose.record.yaml adds a recorder, confined as all containers are, and changes only whom `world` waits for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]


def services(file: str) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = yaml.safe_load((ROOT / file).read_text(encoding="utf-8"))["services"]
    return found


OPEN, RECORDED = services("compose.yaml"), services("compose.record.yaml")
FOLDER = "/var/lib/milepost/recordings"


def test_it_adds_one_container_and_lets_world_wait_for_it() -> None:
    assert sorted(RECORDED) == ["recorder", "world"]
    assert RECORDED["world"] == {"command": [*OPEN["world"]["command"], "--await", "recorder"]}


def test_the_recorder_is_confined_as_a_process_of_the_train_is() -> None:
    same = {key: value for key, value in RECORDED["recorder"].items() if key not in ("command", "volumes")}
    assert same == {key: value for key, value in OPEN["balise"].items() if key not in ("command", "volumes")}


def test_only_its_recordings_are_writable() -> None:
    assert RECORDED["recorder"]["command"] == ["run", "recorder", "--record", FOLDER]
    files = OPEN["balise"]["volumes"]
    assert RECORDED["recorder"]["volumes"] == [*files, f"${{MILEPOST_RECORDINGS:-recordings}}:{FOLDER}"]
    assert all(each["read_only"] for each in files)


def test_the_image_has_the_library_and_a_folder_that_its_user_can_write() -> None:
    image = (ROOT / "deploy" / "Dockerfile").read_text(encoding="utf-8")
    assert 'extras["record"]' in image
    assert f"install -d -o 10001 -g 10001 /var/lib/milepost {FOLDER}" in image
