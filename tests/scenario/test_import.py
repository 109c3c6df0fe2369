"""Imported recordings run offline with the real commands, and nearly as well as trains that were made by hand."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness import ROOT

from milepost.config.train import Train, load_train
from milepost.offline.run import simulate
from milepost.recordings.gnss_log import read_gnss_log
from milepost.simulation.recorded_motion import path_motion
from milepost_schemas import FusedState

DATA = ROOT.parent / "shared/data"
TRAINS = ROOT / "deploy/trains"
CAR = DATA / "comma2k19"
LOGS = ("28554", "28573", "28876", "31259")

of_a_car = pytest.mark.skipif(not CAR.is_dir(), reason="../shared/data/comma2k19, a car's, is not here")
of_trains = pytest.mark.skipif(not (DATA / "brussels").is_dir(), reason="../shared/data/brussels, real trains', is not here")
pytestmark = [pytest.mark.slow, pytest.mark.long]


def milepost(*words: str) -> Any:
    """What a command prints as JSON."""
    command = [sys.executable, "-m", "milepost", *words, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def brussels(log: str) -> Path:
    return DATA / f"brussels/log_{log}_gnss.csv"


def states_of(train: Train, until_s: float) -> tuple[np.ndarray, list[FusedState]]:
    """Scenario times and states."""
    states: list[FusedState] = []
    simulate(train, until_s, None, states.append)
    at = np.array([state.measured_at_ns for state in states])
    return (at - at[0]) * 1e-9, states


@of_trains
@pytest.mark.parametrize("log", LOGS)
def test_a_real_log_is_imported_and_evaluated(log: str, tmp_path: Path) -> None:
    """GIVEN the log of a real train WHEN it is imported THEN it runs, and the withheld fixes are inside the interval.

    That says something of 28876 alone: the others go through tunnels, where a receiver alone leaves kilometres of interval.
    """
    said = milepost("import", str(brussels(log)), "--out", str(tmp_path / "own"))
    assert not said["left_out"]
    result = milepost("evaluate", str(tmp_path / "own/scenario.yaml"))
    assert result["estimators"]["fused"]["refresh_hz"] == pytest.approx(10.0, rel=0.05)
    assert result["withheld_fixes"] > 10
    assert result["withheld_outside_interval"] == 0
    if log == "28876":
        assert result["withheld_max_m"] < 2.5
        assert result["estimators"]["fused"]["position_interval_m"] < 3.0


def missed_m(train: Train, spans: Sequence[tuple[float, float]]) -> list[float]:
    """By how much the states of a train miss the RTK fixes of spans, at most."""
    recording, track = train.sensors["gnss"].options.recording, train.line.track
    assert track is not None
    t_s, states = states_of(train, 450.0)
    out = []
    for from_s, to_s in spans:
        worst = 0.0
        for fix in read_gnss_log(recording, lambda fix, a=from_s, b=to_s: fix.solution == "rtk_fixed" and a <= fix.t_s < b):
            state = states[int(np.searchsorted(t_s, fix.t_s + 1e-6)) - 1]
            since = fix.t_s - float(t_s[int(np.searchsorted(t_s, fix.t_s + 1e-6)) - 1])
            moved = since * (state.speed_mps + 0.5 * since * state.acceleration_mps2)
            worst = max(worst, abs(state.position_m + moved - track.project(fix.latitude_deg, fix.longitude_deg).position_m))
        out.append(worst)
    return out


@of_trains
def test_without_fixes_an_imported_train_is_as_good_as_the_one_made_by_hand(tmp_path: Path) -> None:
    """GIVEN spans without fixes WHEN the receiver is all there is THEN both miss them by nearly the same, on their own lines.

    The largest difference is from 330 to 340 s: 0.17 m and by hand 0.04 m.
    """
    spans = [(100.0, 102.0), (150.0, 155.0), (226.0, 236.0), (330.0, 340.0), (400.0, 405.0)]
    withheld = {"withhold_s": [list(span) for span in spans]}
    # what is simulated says nothing, and does not do that often
    silent = {unit: {"withhold_s": [[0.0, 500.0]], "rate_hz": 1.0} for unit in ("radar", "loop")}
    silent["balise-reader"] = {"withhold_s": [[0.0, 500.0]]}
    change = {"units": {**silent, "gnss": withheld}, "fusion": {"shares": "by_accuracy", "period_ms": 100}}
    by_hand = missed_m(load_train(TRAINS / "brussels-28876.yaml", change), spans)
    milepost("import", str(brussels("28876")), "--out", str(tmp_path / "own"))
    ours = missed_m(load_train(tmp_path / "own/train.yaml", {"units": {"gnss": withheld}}), spans)
    for one, other in zip(ours, by_hand, strict=True):
        assert one < 1.1 * other + 0.2, (ours, by_hand)


def errors_of_the_car(train: Train, begins_s: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Errors of position and speed from 5 s on, and epochs with the truth outside; it begins at `begins_s` of the truth."""
    assert train.line.track is not None
    truth = path_motion(CAR / "truth.csv", train.line.track)
    t_s, states = states_of(train, 59.0)
    true = np.array([truth.at(t + begins_s) for t in t_s.tolist()])
    outside = sum(not s.position_min_m <= p <= s.position_max_m for s, p in zip(states, true[:, 0].tolist(), strict=True))
    late = t_s > 5.0
    position = np.array([s.position_m for s in states]) - true[:, 0]
    speed = np.array([s.speed_mps for s in states]) - true[:, 1]
    return position[late], speed[late], outside


@of_a_car
def test_a_car_of_three_logs_is_an_unknown_latency_worse_than_the_one_made_by_hand(tmp_path: Path) -> None:
    """GIVEN receiver, wheels and inertial unit in three logs WHEN they are imported THEN it is close to the one by hand.

    Position, rms: 1.3 m, by hand 0.5 m; most of it is one offset, as the train made by hand knows from the truth how late fixes
    are stamped. Without the mean 0.24 and 0.16 m; speed, rms, 0.10 and 0.05 m/s.
    """
    said = milepost(
        "import", *(str(CAR / f"{name}.csv") for name in ("gnss", "wheel_speed", "imu")), "--out", str(tmp_path / "own")
    )
    assert len(said["units"]) == 6
    train = load_train(tmp_path / "own/train.yaml")
    begins_s = train.sensors["imu"].options.recording.time.zero_s
    position, speed, outside = errors_of_the_car(train, begins_s)
    by_hand = load_train(TRAINS / "comma2k19.yaml", {"world": None, "fusion": {"period_ms": 100}})
    position_by_hand, speed_by_hand, _ = errors_of_the_car(by_hand, 0.0)
    assert outside == 0
    assert np.std(position) < 2.0 * np.std(position_by_hand)
    assert math.sqrt(np.mean(position**2)) < math.sqrt(np.mean(position_by_hand**2)) + 1.0
    assert math.sqrt(np.mean(speed**2)) < 2.5 * math.sqrt(np.mean(speed_by_hand**2))


@of_trains
def test_a_line_of_ones_own_takes_the_place_of_the_track(tmp_path: Path) -> None:
    line = ROOT / "deploy/lines/brussels-28876.yaml"
    said = milepost("import", str(brussels("28876")), "--line", str(line), "--out", str(tmp_path / "own"))
    assert said["line_rms_m"] == pytest.approx(2.0, abs=0.1)
    assert milepost("evaluate", str(tmp_path / "own/scenario.yaml"))["withheld_outside_interval"] == 0
