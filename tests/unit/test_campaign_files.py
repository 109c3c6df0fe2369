"""Campaign files become cells; files of results keep what is finished; what is wrong is one line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from milepost.campaign import fingerprint
from milepost.campaign.campaign_file import load_campaign
from milepost.campaign.cells import Cell, cells
from milepost.campaign.fingerprint import code_fingerprint, train_fingerprint
from milepost.campaign.results_file import results_file
from milepost.campaign.task import run_task
from milepost.config.shipped_files import find_file, names_in
from milepost.config.yaml_files import ConfigError

BIAS = {"label": "bias", "kind": "bias", "options": {"size": 1.0}, "streams": ["speed_reading"]}
WRONG = {"label": "wrong balise", "kind": "wrong_balise"}
TINY: dict[str, Any] = {
    "campaign": "tiny",
    "runs": 2,
    "trains": {"maglev": {"train": "maglev", "duration_s": 2.0, "onset_s": 1.0}},
    "faults": [BIAS, WRONG],
}


def planned(folder: Path, asked_runs: int | None = None, seed: int | None = None, **fields: Any) -> list[Cell]:
    path = folder / "tiny.yaml"
    path.write_text(
        json.dumps({name: value for name, value in {**TINY, **fields}.items() if value is not None}), encoding="utf-8"
    )
    return cells(path, load_campaign(path), asked_runs, seed)


def test_every_fault_has_a_cell_for_each_unit_it_fits(tmp_path: Path) -> None:
    found = planned(tmp_path)
    assert [(cell.fault, cell.units) for cell in found] == [
        ("bias", ("radar",)),
        ("bias", ("loop",)),
        ("wrong balise", ("balise-reader",)),
    ]
    assert [task.seed for task in found[0].tasks] == [1, 2]
    assert [task.seed for task in planned(tmp_path, asked_runs=3, seed=7)[0].tasks] == [7, 8, 9]
    assert found[0].tasks[0].faults == ({"unit": "radar", "kind": "bias", "from_s": 1.0, "for_s": None, "size": 1.0},)


def test_without_faults_there_is_a_cell_for_each_train(tmp_path: Path) -> None:
    (cell,) = planned(tmp_path, faults=[])
    assert (cell.units, cell.fault, len(cell.tasks)) == ((), "no fault", 2)


def test_pairs_draw_faults_and_onsets_that_stay_the_same(tmp_path: Path) -> None:
    train = {**TINY["trains"]["maglev"], "onset_s": 0.5, "onset_spread_s": 1.0}
    more = {
        "pairs": True,
        "draws": 8,
        "runs": None,
        "trains": {"maglev": train},
        "faults": [BIAS, {**BIAS, "label": "b", "kind": "stuck", "options": {}}, WRONG],
    }
    found = planned(tmp_path, **more)
    assert [cell.units for cell in found] == [("radar", "loop"), ("radar", "balise-reader"), ("loop", "balise-reader")]
    assert found == planned(tmp_path, **more)
    tasks = found[0].tasks
    assert len({task.labels for task in tasks}) > 1
    assert len({task.key for task in tasks}) == 8
    onsets = [fault["from_s"] for task in tasks for fault in task.faults]
    assert all(0.5 <= onset <= 1.5 for onset in onsets)
    assert len(set(onsets)) == len(onsets)


@pytest.mark.parametrize("name", ["single-faults", "pairs", "fault-free"])
def test_every_shipped_campaign_can_be_planned(name: str) -> None:
    path = find_file(Path(name), "campaigns")
    try:
        found = cells(path, load_campaign(path), None, None)
    except ConfigError as error:
        if "no such file" not in str(error):
            raise
        pytest.skip("needs recordings")
    assert name in names_in("campaigns")
    assert all(cell.tasks for cell in found)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"trains": {}}, "trains: "),
        (
            {"trains": {"a": {"train": "metor", "duration_s": 1.0}}},
            "trains.a.train: metor: neither a file nor one of the trains",
        ),
        (
            {"trains": {"a": {"train": "maglev", "duration_s": 1.0, "onset_s": 1.0}}},
            "trains.a: onset_s and onset_spread_s must",
        ),
        (
            {"trains": {"a": {"train": "maglev", "duration_s": 1.0, "change": {"fusion": {"rule": "magic"}}}}},
            "trains.a.change: ",
        ),
        ({"faults": [{**BIAS, "kind": "bais"}]}, "faults.0.kind: must be one of bias, "),
        ({"faults": [{**BIAS, "options": {"sise": 1.0}}]}, "faults.0.options: sise: not an option of bias, which has size"),
        ({"faults": [{**BIAS, "streams": ["speed"]}]}, "faults.0.streams.0: must be one of "),
        ({"faults": [{**BIAS, "sensors": ["radra"]}]}, "faults.0.sensors: must be one of "),
        ({"faults": [{**BIAS, "units": ["radra"]}]}, "faults.0.units: must be one of radar, loop, balise-reader"),
        ({"faults": [{**WRONG, "units": ["radar"]}]}, "faults.0.units: radar of maglev: wrong_balise does not fit"),
        ({"faults": [{**BIAS, "streams": ["position_reading"]}]}, "faults.0: fits no unit of any train"),
        ({"faults": [{**BIAS, "trains": ["metro"]}]}, "faults.0.trains: must be one of maglev"),
        ({"faults": [BIAS, BIAS]}, "faults.1.label: another fault is called 'bias'"),
        ({"pairs": True, "runs": None, "faults": []}, "pairs: true requires faults to draw from"),
        ({"pairs": True, "draws": 2}, "runs: with pairs: true, draws says"),
        ({"draws": 2}, "draws requires pairs: true"),
        ({"pairs": True, "runs": None, "faults": [WRONG]}, "pairs: no train has two units"),
    ],
    ids=lambda value: value[:30] if isinstance(value, str) else "",
)
def test_a_mistake_in_a_campaign_names_file_and_field(tmp_path: Path, fields: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        planned(tmp_path, **fields)
    assert str(refused.value).startswith(f"{tmp_path / 'tiny.yaml'}: ")
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_key_tells_runs_apart_wherever_the_train_file_lies(tmp_path: Path, root: Path) -> None:
    first = planned(tmp_path)[0].tasks[0]
    longer = {"maglev": {**TINY["trains"]["maglev"], "duration_s": 3.0}}
    here = {"maglev": {**TINY["trains"]["maglev"], "train": str(root / "deploy/trains/maglev.yaml")}}
    assert planned(tmp_path, trains=longer)[0].tasks[0].key != first.key
    assert planned(tmp_path, trains=here)[0].tasks[0].key == first.key


def test_a_trains_fingerprint_changes_with_its_lines_geometry(tmp_path: Path) -> None:
    for name, text in (("train.yaml", "line: line.yaml\n"), ("line.yaml", "geojson: track.geojson\n"), ("track.geojson", "{}")):
        (tmp_path / name).write_text(text, encoding="utf-8")
    before = train_fingerprint(tmp_path / "train.yaml")
    (tmp_path / "track.geojson").write_text("[]", encoding="utf-8")
    train_fingerprint.cache_clear()
    assert train_fingerprint(tmp_path / "train.yaml") != before


def test_the_codes_fingerprint_changes_with_pythons_version(monkeypatch: pytest.MonkeyPatch) -> None:
    here = code_fingerprint.__wrapped__()
    assert here == code_fingerprint()
    monkeypatch.setattr(fingerprint, "PYTHON", (3, 99))
    assert code_fingerprint.__wrapped__() != here


@pytest.mark.parametrize("other", ["code", "inputs"])
def test_a_run_with_other_code_or_files_is_refused(tmp_path: Path, other: str) -> None:
    task = replace(planned(tmp_path)[0].tasks[0], **{other: "another"})
    with pytest.raises(ConfigError, match="a worker has another version"):
        run_task(task, lambda done_s: None)


def test_finished_runs_are_found_again_but_not_a_torn_one(tmp_path: Path) -> None:
    first, second = planned(tmp_path)[0].tasks
    path = tmp_path / "sub/runs.jsonl"
    with results_file(path) as results:
        assert results is not None
        results.add(first, {"epochs": 1, "share": 0.1})
        results.add(second, {"epochs": 2})
    whole = path.read_bytes()
    path.write_bytes(whole[:-5])
    with results_file(path) as results:
        assert results is not None
        assert (results.get(first), results.get(second)) == ({"epochs": 1, "share": 0.1}, None)
        results.add(second, {"epochs": 2})
    assert path.read_bytes() == whole


def test_a_file_of_results_belongs_to_one_campaign_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    with results_file(path), pytest.raises(ConfigError, match="is in use by another campaign"), results_file(path):
        pass


def test_a_line_that_is_no_result_is_named(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    path.write_text('{"key": "a", "figures": {}}\nnonsense\n', encoding="utf-8")
    with pytest.raises(ConfigError, match="line 2: not a result of a campaign"), results_file(path):
        pass


def test_a_run_whose_train_is_not_here_is_refused(tmp_path: Path) -> None:
    task = replace(planned(tmp_path)[0].tasks[0], file=str(tmp_path / "absent.yaml"))
    with pytest.raises(ConfigError, match=r"absent\.yaml: a worker has no such file"):
        run_task(task, lambda done_s: None)
