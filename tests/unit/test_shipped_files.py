"""Trains and scenarios are found by name, in the working folder first."""

from __future__ import annotations

from pathlib import Path

import pytest

from examples import write_train
from milepost.config.scenario_file import load_scenario
from milepost.config.shipped_files import find_file, names_in, scenario_folder, shipped_folder
from milepost.config.train import load_train
from milepost.config.yaml_files import ConfigError


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(folder: Path, name: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text("{}", encoding="utf-8")
    return path


def test_an_editable_install_finds_the_repositorys_files(root: Path) -> None:
    assert shipped_folder() == root / "deploy"


def test_a_name_is_found_from_any_folder(elsewhere: Path, root: Path) -> None:
    assert find_file(Path("full"), "trains") == root / "deploy/trains/full.yaml"
    assert find_file(Path("odometer-radar"), "scenarios") == root / "deploy/scenarios/odometer-radar.yaml"
    assert scenario_folder() == root / "deploy/scenarios"
    assert load_train(find_file(Path("full"), "trains")).name == "full-1"


def test_the_working_folders_deploy_comes_first(elsewhere: Path) -> None:
    put(elsewhere / "deploy/trains", "full.yaml")
    put(elsewhere / "deploy/trains", "mine.yaml")
    put(elsewhere / "deploy/scenarios", "one.yaml")
    assert find_file(Path("full"), "trains") == Path("deploy/trains/full.yaml")
    assert find_file(Path("mine"), "trains") == Path("deploy/trains/mine.yaml")
    assert find_file(Path("metro"), "trains").parent == shipped_folder() / "trains"
    assert {"mine", "metro"} <= set(names_in("trains"))
    assert scenario_folder() == Path("deploy/scenarios")


def test_a_file_of_that_name_comes_before_all(elsewhere: Path) -> None:
    put(elsewhere, "full")
    assert find_file(Path("full"), "trains") == Path("full")


def test_a_folder_of_that_name_does_not_hide_a_train(elsewhere: Path) -> None:
    (elsewhere / "full").mkdir()
    assert find_file(Path("full"), "trains").name == "full.yaml"


@pytest.mark.parametrize("given", ["missing.yaml", "a/missing", "../full"])
def test_a_path_stays_as_it_is(elsewhere: Path, given: str) -> None:
    assert find_file(Path(given), "trains") == Path(given)


def test_a_scenario_takes_a_train_by_name(elsewhere: Path, root: Path) -> None:
    path = elsewhere / "mine.yaml"
    path.write_text("{scenario: mine, train: metro, duration_s: 1.0}", encoding="utf-8")
    assert load_scenario(path)[0].train == root / "deploy/trains/metro.yaml"


def test_a_scenario_prefers_the_file_beside_it(elsewhere: Path, root: Path) -> None:
    (elsewhere / "metro").symlink_to(root / "deploy/trains/maglev.yaml")
    path = elsewhere / "mine.yaml"
    path.write_text("{scenario: mine, train: metro, duration_s: 1.0}", encoding="utf-8")
    assert load_scenario(path)[1].name == "maglev-1"


@pytest.mark.parametrize(("field", "text"), [("train", "neither a file nor one of the trains"), ("line", "no such file")])
def test_a_name_that_no_file_can_have_is_a_mistake_in_the_file(elsewhere: Path, field: str, text: str) -> None:
    path = elsewhere / "mine.yaml"
    if field == "train":
        path.write_text(f"{{scenario: mine, train: {'a' * 300}, duration_s: 1.0}}", encoding="utf-8")
    else:
        write_train(elsewhere, {"line": "a" * 300})
        path = elsewhere / "train.yaml"
    with pytest.raises(ConfigError, match=text):
        load_scenario(path) if field == "train" else load_train(path)


def test_an_unknown_name_lists_the_known_and_the_nearest(elsewhere: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        find_file(Path("metor"), "trains")
    text = str(caught.value)
    assert text.startswith("metor: neither a file nor one of the trains: beidou-maglev, ")
    assert text.endswith("; did you mean 'metro'?")


@pytest.mark.parametrize(
    ("name", "units"),
    [("loop-radar-balise", {"radar", "loop", "balise-reader"}), ("beidou-ins-radar", {"imu", "gnss", "radar"})],
)
def test_each_device_of_a_source_is_wrong_for_a_minute(name: str, units: set[str]) -> None:
    """Silence is another case; and whatever is wrong, the claims hold the truth inside the interval."""
    scenario, _ = load_scenario(find_file(Path(name), "scenarios"))
    wrong = {variant: file.faults for variant, file in scenario.variants.items() if file.faults}
    minutes = [fault for faults in wrong.values() for fault in faults if fault.for_s == 60.0]
    assert {fault.unit for fault in minutes if fault.kind not in ("drop_out", "missed_balise")} == units
    for variant in wrong:
        claims = [c for c in scenario.claims if c.variant == variant]
        assert [(c.at_most, c.of, c.why) for c in claims if c.key == "outside_interval"] == [(0.0, "worst", "")]
        assert any("position" in c.key for c in claims)
