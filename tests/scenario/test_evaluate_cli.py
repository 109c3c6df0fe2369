"""`milepost evaluate` as somebody types it: what it prints, what it writes, and that a seed is a seed."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from harness import MAGLEV, ROOT

from examples import REMOVED, write_train

pytestmark = pytest.mark.long

ESTIMATORS = ["fused", "federated", "centralised", "loop_only"]
FIGURES = ["position_rms_m", "position_max_m", "position_final_m", "speed_rms_mps", "speed_max_mps", "nees_mean"]
DURATION_S = 3.0
SEED = 5


def evaluate(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "milepost", "evaluate", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


def scenario_file(folder: Path, **fields: Any) -> Path:
    told = {"scenario": "short", "train": str(MAGLEV), "duration_s": DURATION_S, "seed": SEED, "alone": ["loop"], **fields}
    path = folder / "short.yaml"
    path.write_text(json.dumps(told), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scenario_file(tmp_path_factory.mktemp("scenario"))


@pytest.fixture(scope="module")
def printed(short: Path) -> str:
    """Standard output of one evaluation as JSON."""
    done = evaluate(short, "--json")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


@pytest.fixture(scope="module")
def another(short: Path) -> dict[str, Any]:
    """The same scenario on the next seed."""
    return json.loads(evaluate(short, "--json", "--seed", SEED + 1).stdout)


@pytest.fixture(scope="module")
def three_runs(short: Path) -> dict[str, Any]:
    return json.loads(evaluate(short, "--json", "--runs", 3).stdout)


def test_json_is_exactly_one_object_with_every_estimator_and_figure(printed):
    assert len(printed.splitlines()) == 1
    result = json.loads(printed)
    assert (result["scenario"], result["seed"], result["duration_s"]) == ("short", SEED, DURATION_S)
    assert list(result["estimators"]) == ESTIMATORS
    for figures in result["estimators"].values():
        assert list(figures) == FIGURES
        assert all(isinstance(value, float) and value > 0.0 for value in figures.values())
        assert figures["position_rms_m"] <= figures["position_max_m"]
        assert figures["position_final_m"] <= figures["position_max_m"]


def test_the_same_seed_prints_the_same_bytes(printed, short):
    assert evaluate(short, "--json", "--seed", SEED).stdout == printed


def test_another_seed_is_another_train(printed, another):
    first = json.loads(printed)
    assert another["seed"] == SEED + 1
    for name in ESTIMATORS:
        assert another["estimators"][name]["position_rms_m"] != first["estimators"][name]["position_rms_m"]


def test_several_runs_count_seeds_up_and_give_the_median_and_the_worst(printed, another, short, three_runs):
    third = json.loads(evaluate(short, "--json", "--seed", SEED + 2).stdout)
    runs = [json.loads(printed), another, third]
    assert (three_runs["runs"], three_runs["seed"]) == (3, SEED)
    assert list(three_runs["estimators"]) == ESTIMATORS
    for name, figures in three_runs["estimators"].items():
        assert list(figures) == [*FIGURES, "worst"]
        for key in FIGURES:
            values = [run["estimators"][name][key] for run in runs]
            assert figures[key] == statistics.median(values)
            assert figures["worst"][key] == max(values)


def test_without_json_it_is_a_table_with_every_estimator(short, printed):
    out = evaluate(short).stdout
    fused = json.loads(printed)["estimators"]["fused"]
    row = next(line for line in out.splitlines() if line.startswith("fused "))
    assert [float(word) for word in row.split()[1:]] == [pytest.approx(fused[key], abs=5.1e-6) for key in FIGURES]
    assert all(any(line.startswith(name) for line in out.splitlines()) for name in ESTIMATORS)


def test_plot_and_record_change_no_figure(short, tmp_path, printed):
    pytest.importorskip("matplotlib")
    recording = tmp_path / "messages.jsonl"
    done = evaluate(short, "--json", "--plot", tmp_path / "errors.png", "--record", recording)
    assert done.returncode == 0, done.stderr
    assert done.stdout == printed
    picture = (tmp_path / "errors.png").read_bytes()
    assert picture.startswith(b"\x89PNG\r\n\x1a\n")
    assert picture.endswith(b"IEND\xaeB`\x82")
    lines = [json.loads(line) for line in recording.read_text(encoding="utf-8").splitlines()]
    assert all(set(line) == {"key", "received_at_ns", "payload"} for line in lines)
    states = [line for line in lines if line["key"] == "milepost/v1/maglev-1/state"]
    assert len(states) == pytest.approx(DURATION_S * 50, abs=2)


@pytest.mark.parametrize(
    ("fields", "options", "said"),
    [
        ({"alone": ["nobody"]}, [], "alone: nobody has no filter"),
        ({"train": "none.yaml"}, [], "none.yaml"),
        ({}, ["--record", "none/messages.jsonl"], "its folder does not exist"),
        ({}, ["--record", "tests"], "is a folder"),
    ],
    ids=["alone", "train", "record", "folder"],
)
def test_an_invalid_option_is_one_line_and_exit_code_2(tmp_path, fields, options, said):
    done = evaluate(scenario_file(tmp_path, **fields), "--json", *options)
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert said in done.stderr


def test_an_invalid_truth_is_one_line_and_exit_code_2(tmp_path):
    """A path that runs back on itself, as the line and as the truth."""
    places = [*range(40), *reversed(range(39))]
    rows = "\n".join(f"{k},{6378137.0},0.0,{10.0 * z},0.0,0.0,10.0" for k, z in enumerate(places))
    header = "t_s,ecef_x_m,ecef_y_m,ecef_z_m,ecef_vx_mps,ecef_vy_mps,ecef_vz_mps"
    (tmp_path / "path.csv").write_text(f"{header}\n{rows}", encoding="utf-8")
    motion = {"kind": "recorded_path", "path_csv": "path.csv"}
    train = write_train(tmp_path, {"world.motion": motion}, {"path_csv": "path.csv", "length_m": REMOVED})
    done = evaluate(scenario_file(tmp_path, train=str(train)))
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "train.yaml: world.motion.path_csv: " in done.stderr
    assert "path.csv: line 2 (0 s): the chainage is ambiguous: 0 m and " in done.stderr
