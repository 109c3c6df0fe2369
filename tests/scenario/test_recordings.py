"""Real recordings: a car without satellites, trains whose receivers call false fixes RTK; and the scores made for them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from harness import ROOT

from examples import REMOVED, write_train
from milepost.config.train import Train, load_train
from milepost.config.yaml_files import ConfigError
from milepost.evaluation.plan import make_plan
from milepost.evaluation.recorded_scores import (
    FixesOptions,
    ReacquiredOptions,
    UnitsOptions,
    false_fixes_accepted,
    reacquired_error_m,
    reacquired_outside_interval,
    recorded_scale,
)
from milepost.evaluation.scenario_run import run_plan
from milepost.evaluation.trace import Trace

SCENARIOS = ROOT / "deploy/scenarios"
DATA = ROOT.parent / "shared/data"
GAPS = ("10", "20", "30")

of_a_car = pytest.mark.skipif(not (DATA / "comma2k19").is_dir(), reason="../shared/data/comma2k19, a car's, is not here")
of_trains = pytest.mark.skipif(not (DATA / "brussels").is_dir(), reason="../shared/data/brussels, the train logs, is not here")


def figures(name: str, duration_s: float, comparators: Iterable[str] = ()) -> dict[str, Any]:
    """The scenario's own condition: `fused` and the comparators named, for so long."""
    plan = make_plan(SCENARIOS / f"{name}.yaml")
    case = replace(
        plan.cases[0], compare=("fused",), comparators={rival: plan.cases[0].comparators[rival] for rival in comparators}
    )
    scenario = plan.scenario.model_copy(update={"duration_s": duration_s})
    result: dict[str, Any] = run_plan(replace(plan, scenario=scenario, cases=(case,)), None, lambda done_s: None).result
    return result["estimators"]


@pytest.fixture(scope="module")
def car() -> dict[str, Any]:
    """The car, with its wheels and without."""
    return figures("comma2k19", 55.2, ["imu_only"])


@of_a_car
class TestCarWithoutSatellites:
    def test_its_wheels_carry_it_through_half_a_minute(self, car):
        assert list(car["fused"]["gap_error_m"]) == list(GAPS)
        assert max(car["fused"]["gap_error_m"].values()) < 1.0

    def test_without_wheels_it_knows_that_it_is_far_off(self, car):
        alone, carried = (car["fused"][key] for key in ("gap_error_imu_only_m", "gap_error_m"))
        assert alone == car["imu_only"]["gap_error_m"]
        assert all(10.0 * carried[gap] < alone[gap] < 100.0 for gap in GAPS)

    @pytest.mark.parametrize("estimator", ["fused", "imu_only"])
    def test_the_truth_is_inside_the_interval_throughout(self, car, estimator):
        assert car[estimator]["outside_interval"] == 0.0

    def test_each_wheel_is_learned_to_within_what_it_says(self, car):
        """4 σ, and the scale of each is known to wander; all four read low, which is to be seen."""
        learned, std, late = (np.array(car["fused"][f"wheel_scale{key}"]) for key in ("", "_std", "_truth_late"))
        assert np.all(np.abs(learned - late) < 4.0 * std)
        assert np.all(learned > 3.0 * std)
        assert np.all((np.array(car["fused"]["wheel_scale_truth"]) > 0.005) & (late < 0.012))


@of_trains
class TestFalseFixes:
    """Receivers under ground go on saying RTK; the bridge that stands for the truth there is ours, what is let in is not."""

    def test_no_false_fix_at_a_tunnels_end_counts(self):
        train = figures("brussels-28554", 197.0)["fused"]
        assert train["false_fixes_accepted"] == 0
        assert train["outside_interval"] == 0.0
        # gaps of 3.2, 3.6, 2.4, 6.4 and 15.6 s, carried by radar and odometer
        assert len(train["reacquired_error_m"]) == 5
        assert max(train["reacquired_error_m"]) < 0.2
        assert train["reacquired_outside_interval"] == 0

    def test_no_false_fix_at_a_station_counts(self):
        train = figures("brussels-28573", 165.0, ["credulous"])
        assert train["fused"]["false_fixes_accepted"] == 0
        assert train["fused"]["outside_interval"] == 0.0
        assert train["fused"]["reacquired_outside_interval"] == 0
        # a filter that passes them on: the fuser's hypotheses still hold the truth
        assert train["credulous"]["false_fixes_accepted"] > 20
        assert train["credulous"]["outside_interval"] == 0.0


# a degree of longitude at latitude 50.9, m
DEGREE_M = 70310.0


def logged_train(folder: Path, of: Callable[[int], tuple[float, str]], seconds: int) -> Train:
    """A train whose receiver says once a second what `of` tells: how far along the line it is, and its word for it."""
    start = datetime(2022, 2, 25, tzinfo=UTC)
    rows = ["time_utc,latitude_deg,longitude_deg,position_type"]
    for k in range(seconds):
        position_m, word = of(k)
        rows.append(f"{(start + timedelta(seconds=k)).isoformat()},50.9,{4.5 + position_m / DEGREE_M:.10f},{word}")
    (folder / "log.csv").write_text("\n".join(rows), encoding="utf-8")
    (folder / "l.geojson").write_text('{"type": "LineString", "coordinates": [[4.5, 50.9], [4.6, 50.9]]}', encoding="utf-8")
    gnss = {"kind": "gnss", "source": "recording", "recording": "log.csv"}
    return load_train(write_train(folder, {"units.gnss": gnss}, {"geojson": "l.geojson", "length_m": REMOVED}))


def state_off_by(metres: float, until_s: float, half_width_m: float = 1.0) -> Trace:
    """Epochs each 0.2 s of a train at 10 m/s whose state is that far ahead."""
    t = np.arange(0.0, until_s, 0.2)
    truth = np.column_stack([10.0 * t, np.full_like(t, 10.0), np.zeros_like(t)])
    s, v = truth[:, 0] + metres, truth[:, 1]
    bounds = np.column_stack([s - half_width_m, s + half_width_m, v - 1.0, v + 1.0])
    return Trace(t, np.column_stack([s, v, truth[:, 2]]), np.tile(np.eye(3), (len(t), 1, 1)), truth, bounds)


def coasting(k: int) -> tuple[float, str]:
    """RTK at 10 m/s with two gaps, [10, 15) and [30, 40); at 20 s an RTK fix 500 m off, called false."""
    away = 500.0 if k == 20 else 0.0
    return 10.0 * k + away, "PROPAGATED" if 10 <= k < 15 or 30 <= k < 40 else "NARROW_INT"


def test_the_first_fix_after_each_gap_is_compared(tmp_path):
    train = logged_train(tmp_path, coasting, 50)
    options = ReacquiredOptions(unit="gnss", untrusted_s=[[19.5, 20.5]], longer_than_s=2.5)
    # metres of longitude are good to a thousandth here
    assert reacquired_error_m(state_off_by(0.5, 49.0), train, options) == pytest.approx([0.5, 0.5], abs=0.4)
    one, other = (np.array(reacquired_error_m(state_off_by(d, 49.0), train, options)) for d in (-50.0, -51.5))
    assert other - one == pytest.approx(1.5)


def test_a_fix_beyond_the_interval_is_counted(tmp_path):
    train = logged_train(tmp_path, coasting, 50)
    options = ReacquiredOptions(unit="gnss", untrusted_s=[[19.5, 20.5]], longer_than_s=2.5)
    assert reacquired_outside_interval(state_off_by(0.0, 49.0), train, options) == 0
    assert reacquired_outside_interval(state_off_by(3.0, 49.0), train, options) == 2
    assert len(reacquired_error_m(state_off_by(0.0, 38.0), train, options)) == 1


def test_fixes_are_taken_by_the_units_own_column_map(tmp_path):
    """The same gaps in own columns, on a clock that is 3 s behind: the fix after each gap is 30 m further than at its time."""
    rows = "\n".join(
        f"{k - 3},50.9,{4.5 + position_m / DEGREE_M:.10f},{'ok' if word == 'NARROW_INT' else 'bad'}"
        for k, (position_m, word) in enumerate(map(coasting, range(50)))
    )
    train = logged_train(tmp_path, coasting, 50)
    (tmp_path / "own.csv").write_text(f"t,lat,lon,word\n{rows}", encoding="utf-8")
    recording = {
        "file": "own.csv",
        "time": {"column": "t", "zero_at": 0.0},
        "columns": {
            "latitude_deg": {"column": "lat", "unit": "deg"},
            "longitude_deg": {"column": "lon", "unit": "deg"},
            "solution": {"column": "word", "values": {"ok": "rtk_fixed", "bad": "propagated"}},
        },
    }
    train = load_train(train.path, {"units": {"gnss": {"recording": recording}}})
    options = ReacquiredOptions(unit="gnss", untrusted_s=[[16.5, 17.5]], longer_than_s=2.5)
    assert reacquired_error_m(state_off_by(30.0, 46.0), train, options) == pytest.approx([0.0, 0.0], abs=0.5)


def test_fixes_withheld_from_the_filter_are_a_gap(tmp_path):
    train = logged_train(tmp_path, lambda k: (10.0 * k, "NARROW_INT"), 50)
    train = load_train(train.path, {"units": {"gnss": {"withhold_s": [[20.0, 30.0]]}}})
    options = ReacquiredOptions(unit="gnss", untrusted_s=[])
    assert reacquired_error_m(state_off_by(4.0, 49.0), train, options) == pytest.approx([4.0], abs=0.4)


@pytest.mark.parametrize(
    ("scores", "says"),
    [
        ({"reacquired_error_m": {"unit": "radar", "untrusted_s": []}}, "reacquired_error_m.unit: radar has no recording"),
        ({"false_fixes_accepted": {"unit": "nobody", "untrusted_s": []}}, "false_fixes_accepted.unit: nobody has no recording"),
        ({"recorded_scale": {"units": ["gnss"]}}, "recorded_scale.units: gnss records no speed_reading"),
    ],
)
def test_a_score_of_a_recording_that_is_not_there_is_one_line(tmp_path, scores, says):
    train = logged_train(tmp_path, coasting, 50)
    scenario = {"scenario": "s", "train": str(train.path), "duration_s": 5.0, "scores": scores}
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(scenario), encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        make_plan(tmp_path / "s.yaml")
    assert says in str(refused.value)


def test_false_fixes_are_counted_by_when_they_were_true(tmp_path):
    train = logged_train(tmp_path, coasting, 50)
    options = FixesOptions(unit="gnss", untrusted_s=[[19.5, 20.5]])
    trace = state_off_by(0.0, 49.0)
    assert false_fixes_accepted(trace, train, options) is None
    counted = {"gnss": np.array([18.0, 19.0, 20.0, 21.0]), "radar": np.array([20.0])}
    assert false_fixes_accepted(replace(trace, counted=counted), train, options) == 1


def test_a_wheels_recorded_scale_is_way_over_reading(tmp_path):
    """It shows 8 m/s for 10: the scale is 0.25."""
    (tmp_path / "wheel.csv").write_text("t,v\n" + "\n".join(f"{0.1 * k:.1f},8.0" for k in range(90)), encoding="utf-8")
    recording = {
        "file": "wheel.csv",
        "time": {"column": "t", "zero_at": 0.0},
        "columns": {"speed_mps": {"column": "v", "unit": "m/s"}},
        "constants": {"speed_variance_m2ps2": 0.01},
    }
    wheel = {"kind": "odometer", "source": "recording", "recording": recording}
    train = load_train(write_train(tmp_path, {"units.wheel": wheel}))
    (scale,) = recorded_scale(state_off_by(0.0, 9.0), train, UnitsOptions(units=["wheel"]))
    assert math.isclose(scale, 0.25)
