"""Recordings without a truth: a train file without `world` runs to their end, and `evaluate` says what it does not score."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from harness import ROOT

from examples import RECORDED_ODOMETER, REMOVED, write_train
from milepost.config.roles import processes
from milepost.config.scenario_file import load_scenario
from milepost.config.train import load_train
from milepost.config.yaml_files import ConfigError
from milepost.evaluation.plan import make_plan
from milepost.evaluation.scenario_run import NOT_SCORED, run_plan
from milepost.nodes.base import Output
from milepost.offline.run import simulate
from milepost_schemas import FusedState, Truth

DATA = ROOT.parent / "shared/data"
TRAINS = ROOT / "deploy/trains"
FIGURES = ["stated_position_std_m", "stated_speed_std_mps", "position_interval_m", "speed_interval_mps", "refresh_hz"]
LIVE = {"kind": "gnss", "source": "receiver", "receiver": {"protocol": "nmea", "tcp": "127.0.0.1:1"}}

of_a_car = pytest.mark.skipif(not (DATA / "comma2k19").is_dir(), reason="../shared/data/comma2k19, a car's, is not here")
of_a_train = pytest.mark.skipif(not (DATA / "brussels").is_dir(), reason="../shared/data/brussels, the train logs, is not here")


def recorded_train(folder: Path, **units: dict[str, Any]) -> Path:
    """A train file with recordings and no world."""
    (folder / "wheel.csv").write_text("t,v\n" + "\n".join(f"{0.1 * k:.1f},10.0" for k in range(201)), encoding="utf-8")
    changes = {"world": REMOVED, "fusion": {}, "units": {"odometer": RECORDED_ODOMETER, **units}, "prior.speed_mps": 10.0}
    geometry = {"geojson": "l.geojson", "length_m": REMOVED}
    (folder / "l.geojson").write_text('{"type": "LineString", "coordinates": [[4.5, 50.9], [4.6, 50.9]]}', encoding="utf-8")
    return write_train(folder, changes, geometry)


def absolute(value: Any) -> Any:
    """A deployed file's paths, for a copy of it in another folder."""
    if isinstance(value, dict):
        return {key: absolute(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [absolute(inner) for inner in value]
    return str((TRAINS / value).resolve()) if isinstance(value, str) and value.startswith("../") else value


def without_world(folder: Path, name: str, *units: str) -> Path:
    """A deployed train without its world, and with these of its units alone where any are named."""
    train = absolute(yaml.safe_load((TRAINS / f"{name}.yaml").read_text(encoding="utf-8")))
    del train["world"]
    train["fusion"]["shares"] = "by_accuracy"
    train["units"] = {unit: entry for unit, entry in train["units"].items() if not units or unit in units}
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(train, sort_keys=False), encoding="utf-8")
    return path


def scenario(folder: Path, train: Path, duration_s: float, **fields: Any) -> Path:
    path = folder / "scenario.yaml"
    content = {"scenario": "untrue", "train": str(train), "duration_s": duration_s, "compare": ["fused", "centralised"]}
    path.write_text(yaml.safe_dump(content | fields), encoding="utf-8")
    return path


def figures(path: Path) -> dict[str, Any]:
    return run_plan(make_plan(path), None, lambda done_s: None).result


def refusal(path: Path) -> str:
    with pytest.raises(ConfigError) as refused:
        make_plan(path)
    text = str(refused.value)
    assert len(text.splitlines()) == 1
    return text


class TestTrain:
    def test_it_has_scenario_time_and_a_process_that_owns_it(self, tmp_path):
        train = load_train(recorded_train(tmp_path))
        assert train.has_scenario_time
        assert train.recorded_end_s == 20.0
        assert "world" in [process.name for process in processes(train)]

    @pytest.mark.parametrize(("duration_s", "ends_s"), [(1000.0, 20.0), (5.0, 5.0)])
    def test_it_runs_to_the_end_of_its_recordings_or_its_duration(self, tmp_path, duration_s, ends_s):
        states: list[FusedState] = []
        truths: list[Truth] = []

        def tap(output: Output, now_ns: int) -> None:
            if isinstance(output.message, Truth):
                truths.append(output.message)

        simulate(load_train(recorded_train(tmp_path)), duration_s, tap, states.append)
        assert truths == []
        assert len(states) == pytest.approx(50 * ends_s, abs=5)
        assert states[-1].speed_mps == pytest.approx(10.0, abs=0.2)

    def test_a_live_receiver_cannot_stand_beside_a_recording(self, tmp_path):
        with pytest.raises(ConfigError, match=r"units\.gnss\.receiver: .*recording"):
            load_train(recorded_train(tmp_path, gnss=LIVE))

    def test_a_simulated_unit_still_needs_a_world(self, tmp_path):
        train = load_train(recorded_train(tmp_path, radar={"kind": "doppler_radar"}))
        with pytest.raises(ConfigError, match=r"units\.radar: .*world"):
            simulate(train, 1.0)

    def test_a_train_with_neither_world_nor_recording_has_no_scenario(self, tmp_path):
        path = recorded_train(tmp_path)
        train = yaml.safe_load(path.read_text(encoding="utf-8"))
        train["units"] = {"gnss": LIVE}
        path.write_text(yaml.safe_dump(train), encoding="utf-8")
        assert "has neither a `world` nor a recording" in refusal(scenario(tmp_path, path, 5.0))

    def test_a_scenarios_seed_invents_no_world(self, tmp_path):
        _, train = load_scenario(scenario(tmp_path, recorded_train(tmp_path), 5.0), seed=7)
        assert train.file.world is None


class TestEvaluation:
    def test_it_prints_what_is_scored_and_one_line_of_what_is_not(self, tmp_path):
        path = scenario(tmp_path, recorded_train(tmp_path), 10.0)
        command = [sys.executable, "-m", "milepost", "evaluate", str(path)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
        lines = done.stdout.splitlines()
        assert lines.count("no truth: position and speed errors are not scored") == 1
        assert lines[1].split() == FIGURES
        fused, centralised = (
            next(line.split() for line in lines if line.startswith(name)) for name in ("fused", "centralised")
        )
        assert len(fused) == len(centralised) == 6
        assert centralised[3:] == ["-", "-", "-"]
        assert any(line.startswith("fused_minus_centralised_max_sigma: ") for line in lines)
        assert not any("rms" in line or "fused_over" in line for line in lines)

    def test_several_runs_and_the_report_say_it_too(self, tmp_path):
        pytest.importorskip("matplotlib")
        path = scenario(tmp_path, recorded_train(tmp_path), 4.0)
        command = [sys.executable, "-m", "milepost", "evaluate", str(path), "--runs", "2", "--jobs", "1", "--json"]
        report = tmp_path / "report"
        done = subprocess.run([*command, "--report", str(report)], capture_output=True, text=True, timeout=60, check=True)
        assert json.loads(done.stdout)["not_scored"] == NOT_SCORED
        assert NOT_SCORED in (report / "index.html").read_text(encoding="utf-8")
        assert not list(report.glob("*.errors.png"))

    def test_a_picture_of_errors_is_refused_before_the_work(self, tmp_path):
        pytest.importorskip("matplotlib")
        path = scenario(tmp_path, recorded_train(tmp_path), 1000.0)
        command = [sys.executable, "-m", "milepost", "evaluate", str(path), "--plot", str(tmp_path / "e.png")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 2
        assert len(done.stderr.splitlines()) == 1
        assert "--plot: errors need a truth" in done.stderr

    @pytest.mark.parametrize(
        ("fields", "says"),
        [
            ({"scores": {"outside_interval": None}}, "scores.outside_interval: needs a truth, and "),
            ({"scores": {"subset_041_position": None}}, "scores.subset_041_position: needs a truth, and "),
            ({"scores": {"m": {"score": "position_max_m"}}}, "scores.m: needs a truth, and "),
            ({"claims": [{"key": "position_max_m", "source": "B", "says": "-"}]}, "claims.0.key: position_max_m needs a truth"),
            ({"claims": [{"key": "fused_over_centralised", "source": "B", "says": "-"}]}, "claims.0.key: fused_over"),
            ({"scores": {"refresh_hz": None}, "windows": {"w": "creep"}}, None),
            ({"claims": [{"key": "position_interval_m", "source": "B", "says": "-", "at_most": 9.0}]}, None),
        ],
    )
    def test_scores_and_claims_that_need_a_truth_are_refused(self, tmp_path, fields, says):
        path = scenario(tmp_path, recorded_train(tmp_path), 5.0, **fields)
        if says is None:
            make_plan(path)
        else:
            assert says in refusal(path)

    def test_estimators_with_and_without_a_truth_are_not_compared(self, tmp_path):
        motion = {"kind": "white_jerk", "profile": [[0.0, 10.0]], "jerk_psd_m2ps5": 0.0}
        fields = {"estimators": {"true": {"change": {"world": {"motion": motion}}}}}
        assert "estimators.true.change.world: " in refusal(scenario(tmp_path, recorded_train(tmp_path), 5.0, **fields))

    def test_a_run_that_ends_before_the_first_state_is_one_line(self, tmp_path):
        late = {"units": {"odometer": {"withhold_s": [[0.0, 1.0]]}}}
        with pytest.raises(ConfigError, match="duration_s: the run ends before there is a state"):
            figures(scenario(tmp_path, recorded_train(tmp_path), 0.5, change=late))

    def test_a_withheld_fix_before_the_first_state_is_one_line(self, tmp_path):
        rows = "\n".join(f"{k},50.9,{4.5 + k / 7031.0}" for k in range(20))
        (tmp_path / "fixes.csv").write_text(f"t,lat,lon\n{rows}", encoding="utf-8")
        columns = {"latitude_deg": {"column": "lat", "unit": "deg"}, "longitude_deg": {"column": "lon", "unit": "deg"}}
        recording = {"file": "fixes.csv", "time": {"column": "t"}, "columns": columns, "constants": {"solution": "rtk_fixed"}}
        gnss = {"kind": "gnss", "source": "recording", "rate_hz": 1.0, "recording": recording}
        train = recorded_train(tmp_path, gnss=gnss)
        change = {"units": {unit: {"withhold_s": [[0.0, 5.0]]} for unit in ("odometer", "gnss")}}
        withheld = {"unit": "gnss", "from_s": 2.0, "to_s": 4.0}
        with pytest.raises(ConfigError, match=r"withheld: there is no state at the withheld fix of 2 s"):
            figures(scenario(tmp_path, train, 9.0, change=change, withheld=withheld))


@of_a_car
def test_a_car_without_truth_is_compared_with_withheld_fixes(tmp_path):
    """Ten seconds of single fixes withheld; the figure is within what the receiver's own errors make of it."""
    withheld = {"unit": "gnss", "from_s": 20.0, "to_s": 30.0, "solution": "single"}
    change = {"units": {"gnss": {"withhold_s": [[20.0, 30.0]]}}}
    score = {"unit": "gnss", "untrusted_s": [], "solution": "single"}
    scores = {"reacquired_error_m": score, "reacquired_outside_interval": score, "refresh_hz": None}
    path = scenario(tmp_path, without_world(tmp_path, "comma2k19"), 40.0, withheld=withheld, change=change, scores=scores)
    result = figures(path)
    fused = result["estimators"]["fused"]
    assert result["not_scored"] == NOT_SCORED
    assert result["withheld_fixes"] == 96
    assert result["withheld_max_m"] < 3.0
    assert len(fused["reacquired_error_m"]) == 1
    assert fused["reacquired_error_m"][0] < 3.0
    assert fused["reacquired_outside_interval"] == 0
    assert fused["refresh_hz"] == pytest.approx(50.0, abs=0.5)
    # it must hold while the only receiver, or all wheels at once, may be wrong
    assert 0.0 < fused["position_interval_m"] < 60.0
    assert result["fused_minus_centralised_max_sigma"] < 0.1


@of_a_train
def test_a_train_log_alone_runs_without_a_world(tmp_path):
    """The receiver by itself, ten seconds of its fixes withheld, 20 of them RTK: carried by speed and acceleration alone."""
    change = {"units": {"gnss": {"withhold_s": [[50.0, 60.0]]}}}
    withheld = {"unit": "gnss", "from_s": 50.0, "to_s": 60.0}
    path = scenario(tmp_path, without_world(tmp_path, "brussels-28876", "gnss"), 80.0, withheld=withheld, change=change)
    result = figures(path)
    assert result["withheld_fixes"] == 20
    assert result["withheld_outside_interval"] == 0
    assert result["fused_minus_centralised_max_sigma"] < 1e-6
