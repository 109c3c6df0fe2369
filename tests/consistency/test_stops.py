"""Invariant 4 through stops and reversals, where radars are deaf and pulses say neither direction nor much of the speed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from milepost.config.train import load_train
from milepost.evaluation.run_log import RunLog
from milepost.offline.run import OFFLINE_START_NS, simulate

pytestmark = [pytest.mark.slow, pytest.mark.long]
SEEDS = range(10)
STRETCHES = 2  # in each run: two stops, or two reversals, so far apart that their errors are independent
FULL = Path("deploy/trains/full.yaml")
UNITS = {"radar-front": {}, "loop": {}, "odometer-front": {}, "balise-reader": {}}
LINE = {"line": "l", "length_m": 2000.0, "balises": {"every_m": 20.0, "from_m": 20.0, "location_accuracy_m": 0.05}}
# the changes of acceleration take 5 s, which the filter's jerk of 0.01 m²/s⁵ allows for
TWO_STOPS = [[0.0, 5.0], [3.0, 5.0], [13.0, 0.0], [33.0, 0.0], [43.0, 5.0], [45.0, 5.0], [55.0, 0.0], [75.0, 0.0], [80.0, 2.0]]
REVERSALS = [
    [0.0, 4.0],
    [3.0, 4.0],
    [11.0, 0.0],
    [15.0, -1.5],
    [25.0, -1.5],
    [33.0, 1.5],
    [40.0, 0.0],
    [50.0, 0.0],
    [55.0, -1.0],
]
# the full train's world, where nobody holds the brake: it creeps and rolls by some 0.3 m/s where it should stand
CREEPS = {"jerk_psd_m2ps5": 1e-5, "driver_time_s": 60.0, "start_std": [0.5, 0.1, 0.0]}
BRAKED = {"jerk_psd_m2ps5": 0.0, "start_std": [0.5, 0.0, 0.0]}
CASES: dict[str, tuple[list[list[float]], dict[str, Any]]] = {
    "two stops": (TWO_STOPS, BRAKED),
    "two stops, brakes off": (TWO_STOPS, CREEPS),
    "reversals": (REVERSALS, BRAKED),
    "reversals, brakes off": (REVERSALS, CREEPS),
}


def bounds_of_mean(degrees: int, samples: int) -> tuple[float, float]:
    """The central 95 % of the mean of `samples` chi-square variables (Wilson-Hilferty)."""
    k = degrees * samples
    low, high = (k * (1.0 - 2.0 / (9.0 * k) + z * (2.0 / (9.0 * k)) ** 0.5) ** 3 for z in (-1.96, 1.96))
    return low / samples, high / samples


class Run:
    """Errors, covariances and intervals at every epoch of a train of radar, loop, odometer and balises."""

    def __init__(self, folder: Path, profile: list[list[float]], motion: dict[str, Any], seed: int, jerk_psd: float) -> None:
        file = yaml.safe_load(FULL.read_text(encoding="utf-8"))
        file["line"] = "line.yaml"
        file["fusion"] |= {"period_ms": 100}
        file["motion_model"]["jerk_psd_m2ps5"] = jerk_psd
        file["prior"]["speed_mps"] = profile[0][1]
        file["units"] = {unit: {**file["units"][unit], "rate_hz": 10.0} for unit in UNITS if unit != "balise-reader"}
        file["units"]["balise-reader"] = {"kind": "balise_reader"}
        white = {"kind": "white_jerk", "start_m": 100.0, "corner_s": 5.0, "profile": profile}
        file["world"] = {"seed": seed, "motion": {**white, **motion}}
        (folder / "line.yaml").write_text(yaml.safe_dump(LINE), encoding="utf-8")
        (folder / "train.yaml").write_text(yaml.safe_dump(file), encoding="utf-8")
        train = load_train(folder / "train.yaml")
        log = RunLog(train)
        simulate(train, profile[-1][0], log.tap, log.keep)
        self.times = sorted(set(log.settled) & set(log.truth))
        states = [log.settled[at] for at in self.times]
        self.truth = np.array([log.truth[at] for at in self.times])
        errors = np.array([(s.position_m, s.speed_mps, s.acceleration_mps2) for s in states]) - self.truth
        P = np.array([s.covariance for s in states])
        scale = np.sqrt(np.einsum("kii->ki", P))
        self.errors = errors / scale
        normal = P / (scale[:, :, None] * scale[:, None, :])
        self.nees = np.einsum("ki,ki->k", self.errors, np.linalg.solve(normal, self.errors[:, :, None])[:, :, 0])
        reach = np.array([(s.position_min_m, s.position_max_m, s.speed_min_mps, s.speed_max_mps) for s in states])
        s, v = self.truth[:, 0], self.truth[:, 1]
        self.inside = (reach[:, 0] <= s) & (s <= reach[:, 1]) & (reach[:, 2] <= v) & (v <= reach[:, 3])
        self.speed_std = scale[:, 1]
        self.unused = {(e.unit, e.reason) for state in log.live.values() for e in state.excluded}

    def nees_at(self, at_s: float) -> float:
        return float(self.nees[self.times.index(OFFLINE_START_NS + round(at_s * 1e9))])


@pytest.fixture(scope="module", params=sorted(CASES))
def runs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    """Ten trains."""
    folder = tmp_path_factory.mktemp("stops")
    return [Run(folder, *CASES[request.param], seed, 0.01) for seed in SEEDS]


def test_the_truth_is_inside_the_interval_at_every_epoch(runs: list[Run]) -> None:
    assert [seed for seed, run in zip(SEEDS, runs, strict=True) if not run.inside.all()] == []


def test_the_errors_are_no_larger_than_stated(runs: list[Run]) -> None:
    """Over the runs, and where they stand or creep: the mean of 20 chi-squares of 3 degrees, two a run, 95 %.

    There is no lower bound: between its corners the train runs more smoothly than the filter's jerk allows for.
    """
    high = bounds_of_mean(3, STRETCHES * len(runs))[1]
    assert np.mean([run.nees.mean() for run in runs]) < high
    assert np.concatenate([run.nees[np.abs(run.truth[:, 1]) < 0.3] for run in runs]).mean() < high


def test_the_speed_at_standstill_stays_known(runs: list[Run]) -> None:
    """A pulse of 27 mm is due within 0.27 s at 0.1 m/s: that none comes says as much, for as long as it lasts."""
    slow = np.concatenate([run.speed_std[np.abs(run.truth[:, 1]) < 0.05] for run in runs])
    assert slow.max() < 0.15


def test_a_loop_that_works_stays_in_use(runs: list[Run]) -> None:
    """Where no pulse is due it says little, and at times nothing of the direction: that is no fault."""
    assert {why for run in runs for unit, why in run.unused if unit == "loop"} == set()


@pytest.mark.parametrize("at_s", [5.0, 10.0, 15.0, 20.0])
def test_a_train_that_wanders_about_standstill_is_known_as_well_as_stated(wanders: list[Run], at_s: float) -> None:
    """The filter's own model, some three reversals a run: both bounds of 95 %."""
    low, high = bounds_of_mean(3, len(wanders))
    assert low < np.mean([run.nees_at(at_s) for run in wanders]) < high


@pytest.fixture(scope="module")
def wanders(tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    """Forty trains that nobody drives."""
    folder = tmp_path_factory.mktemp("wanders")
    motion = {"jerk_psd_m2ps5": 1e-4, "driver_time_s": None, "start_std": [0.5, 0.1, 0.05]}
    return [Run(folder, [[0.0, 0.0], [20.5, 0.0]], motion, seed, 1e-4) for seed in range(40)]
