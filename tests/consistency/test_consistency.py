"""Invariant 4: the published covariance says how wrong the estimate is. NEES and NIS inside their 95 % bounds."""

from __future__ import annotations

import csv
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from milepost.config.fusion_settings import prior
from milepost.config.train import Train, load_train
from milepost.estimation.kalman import predict, update
from milepost.estimation.layout import Layout
from milepost.estimation.motion import full_process_noise, full_transition
from milepost.evaluation.run_log import RunLog
from milepost.offline.run import simulate

pytestmark = pytest.mark.long

MAGLEV = Path("deploy/trains/maglev.yaml")
# the mean of 40 chi-squares of 3 degrees: within 25 % of 3
RUNS = 40
LENGTH_S = 8.0
NO_DRIVER = {"driver_time_s": None}
# fewer epochs than the train file's cost less; readings come as often
PERIOD_MS = 100


def bounds_of_mean(degrees: int, samples: int) -> tuple[float, float]:
    """The central 95 % of the mean of `samples` chi-square variables (Wilson-Hilferty)."""
    k = degrees * samples

    def quantile(z: float) -> float:
        return k * (1.0 - 2.0 / (9.0 * k) + z * (2.0 / (9.0 * k)) ** 0.5) ** 3

    return quantile(-1.96) / samples, quantile(1.96) / samples


def run(train: Train, length_s: float) -> RunLog:
    log = RunLog(train)
    simulate(train, length_s, log.tap, log.keep)
    return log


def nees(log: RunLog, at: int) -> float:
    state, truth = log.settled[at], log.truth[at]
    e = np.array([state.position_m, state.speed_mps, state.acceleration_mps2]) - truth
    P = np.array(state.covariance)
    scale = np.sqrt(np.diag(P))
    return float((e / scale) @ np.linalg.solve(P / np.outer(scale, scale), e / scale))


@pytest.fixture(scope="module")
def monte_carlo() -> list[RunLog]:
    """Forty trains that differ in everything that is random."""
    worlds = ({"seed": 5000 + i, "motion": NO_DRIVER} for i in range(RUNS))
    return [run(load_train(MAGLEV, {"world": world, "fusion": {"period_ms": PERIOD_MS}}), LENGTH_S) for world in worlds]


@pytest.mark.parametrize("at_s", [1.0, 4.0, 7.5])
def test_the_errors_of_forty_trains_are_as_large_as_their_covariances_say(monte_carlo, at_s):
    """Before and after the first balise, at 5 s."""
    values = [nees(log, 1_700_000_000_000_000_000 + round(at_s * 1e9)) for log in monte_carlo]
    low, high = bounds_of_mean(3, len(values))
    assert low < np.mean(values) < high


def test_the_truth_is_inside_every_published_interval(monte_carlo):
    pairs = [(log.live[at], truth) for log in monte_carlo for at, truth in log.truth.items() if at in log.live]
    assert len(pairs) > 0.98 * RUNS * LENGTH_S * 1000 / PERIOD_MS
    assert all(s.position_min_m <= t[0] <= s.position_max_m for s, t in pairs)
    assert all(s.speed_min_mps <= t[1] <= s.speed_max_mps for s, t in pairs)


def innovations(train: Train, log: RunLog) -> dict[str, list[float]]:
    """ν²/S of every observation in one pass of the centralised filter, by unit."""
    p, q = prior(train), train.file.motion_model.jerk_psd_m2ps5
    x, P = Layout().prior(p.mean, p.std)
    ordered = sorted(log.observations, key=lambda o: o[:5])
    at, out = ordered[0].measured_at_ns, {}
    for o in ordered:
        dt = (o.measured_at_ns - at) * 1e-9
        if dt > 0.0:
            x, P = predict(x, P, full_transition(dt, Layout()), full_process_noise(dt, q, Layout()))
        h = np.array(o.row)
        out.setdefault(o.unit, []).append(float((o.value - h @ x) ** 2 / (h @ P @ h + o.variance)))
        x, P = update(x, P, h, o.value, o.variance)
        at = o.measured_at_ns
    return out


def test_every_sensors_innovations_are_as_large_as_predicted(monte_carlo):
    by_unit: dict[str, list[float]] = {}
    for log in monte_carlo:
        for unit, values in innovations(log.train, log).items():
            by_unit.setdefault(unit, []).extend(values)
    assert set(by_unit) == {"radar", "loop", "balise-reader"}
    for unit, values in by_unit.items():
        low, high = bounds_of_mean(1, len(values))
        assert low < np.mean(values) < high, unit


def test_a_wrong_variance_would_be_noticed(monte_carlo):
    """The test above can fail: a radar whose variance is stated ten per cent too small is outside its bounds."""
    values = np.concatenate([innovations(log.train, log)["radar"] for log in monte_carlo]) / 0.9
    low, high = bounds_of_mean(1, len(values))
    assert not low < np.mean(values) < high


def test_gnss_fixes_with_known_noise_are_consistent_too(tmp_path):
    """A recording made here: 2.5 Hz fixes with white noise of 0.1 m on a straight track."""
    rng = np.random.default_rng(5)
    coordinates = [[4.0, 50.0], [4.05, 50.0]]
    (tmp_path / "line.geojson").write_text(json.dumps({"type": "LineString", "coordinates": coordinates}))
    (tmp_path / "line.yaml").write_text("line: straight\ngeojson: line.geojson\n")
    from milepost.track.track import Track

    track, q, dt = Track([(4.0, 50.0), (4.05, 50.0)]), 1e-3, 0.4
    F, Q = full_transition(dt, Layout()), full_process_noise(dt, q, Layout())
    x = np.array([10.0, 15.0, 0.0]) + rng.normal(size=3) * [1.0, 0.5, 0.1]
    rows, begin = [], datetime(2025, 1, 1, tzinfo=UTC)
    for k in range(400):
        latitude, longitude = track.locate(float(x[0] + 0.1 * rng.normal()))
        rows.append([(begin + timedelta(seconds=k * dt)).isoformat(), latitude, longitude, "SOL_COMPUTED", "NARROW_INT"])
        x = F @ x + np.linalg.cholesky(Q) @ rng.normal(size=3)
    with (tmp_path / "log.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_utc", "latitude_deg", "longitude_deg", "solution_status", "position_type"])
        writer.writerows(rows)
    (tmp_path / "train.yaml").write_text(
        "train: t\nline: line.yaml\nmotion_model: {jerk_psd_m2ps5: 1e-3}\n"
        "prior: {position_m: 10, position_std_m: 1.0, speed_mps: 15, speed_std_mps: 0.5, acceleration_std_mps2: 0.1}\n"
        "world: {motion: {kind: recorded, gnss_log: log.csv, fix_std_m: 0.1, jerk_psd_m2ps5: 1e-3}}\n"
        "units: {gnss: {kind: gnss, source: recording, recording: log.csv, position_std_m: {rtk_fixed: 0.1}}}\n"
    )
    train = load_train(tmp_path / "train.yaml")
    values = innovations(train, run(train, 159.0))["gnss"]
    low, high = bounds_of_mean(1, len(values))
    assert len(values) > 390
    assert low < np.mean(values) < high
