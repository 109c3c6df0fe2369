"""A train that has nothing but a GNSS receiver: from a file of NMEA sentences, and simulated with an offset that wanders."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples import REMOVED, write_train
from milepost.config.train import Train, load_train
from milepost.nodes.base import Output
from milepost.offline.run import simulate
from milepost.track.track import Track
from milepost_schemas import FusedState, Truth

pytestmark = pytest.mark.long

POINTS = [(4.5, 50.9), (4.52, 50.905), (4.54, 50.92), (4.55, 50.95)]
GEOMETRY = {"geojson": "l.geojson", "length_m": REMOVED, "balises": []}


def train(folder: Path, gnss: dict[str, Any], **changes: Any) -> Train:
    (folder / "l.geojson").write_text(json.dumps({"type": "LineString", "coordinates": POINTS}), encoding="utf-8")
    alone = {
        "units": {"gnss": {"kind": "gnss", **gnss}},
        "fusion.shares": REMOVED,
        "fusion.period_ms": 100,
        "world.motion.jerk_psd_m2ps5": 1e-4,
        "motion_model.jerk_psd_m2ps5": 1e-4,
        "world.motion.start_m": 500.0,
        "prior.position_m": 500.0,
        **changes,
    }
    return load_train(write_train(folder, alone, GEOMETRY))


def errors(of: Train, duration_s: float) -> list[tuple[Any, Any]]:
    """Error of [s, v, a] and covariance of each settled state."""
    truth: dict[int, Truth] = {}
    states: list[FusedState] = []

    def tap(output: Output, now_ns: int) -> None:
        if isinstance(output.message, Truth):
            truth[output.message.measured_at_ns] = output.message

    simulate(of, duration_s, tap=tap, settled=states.append)
    out = []
    # the last epoch is settled though the world has ended
    for s in (s for s in states if s.measured_at_ns in truth):
        t = truth[s.measured_at_ns]
        e = [s.position_m - t.position_m, s.speed_mps - t.speed_mps, s.acceleration_mps2 - t.acceleration_mps2]
        out.append((np.array(e), np.array(s.covariance)))
    return out


def nmea(of: Train, seconds: int) -> bytes:
    """What a perfect receiver on that train says, five times a second, across midnight."""
    track, motion = Track(POINTS), of.world(float(seconds)).motion
    begin = datetime(2022, 12, 31, 23, 59, 55, tzinfo=UTC)
    out = b""
    for k in range(5 * seconds):
        at, (s, v, _) = begin + timedelta(seconds=0.2 * k), motion.at(0.2 * k)
        place = ",".join(
            f"{int(x):0{digits}d}{x % 1 * 60:010.7f},{side}"
            for x, digits, side in zip(track.locate(s), (2, 3), "NE", strict=True)
        )
        hms = f"{at:%H%M%S}.{at.microsecond // 100_000}"
        for body in (
            f"GNRMC,{hms},A,{place},{v * 3600 / 1852:.4f},{track.heading_deg(s):.3f},{at:%d%m%y},,,R",
            f"GNGGA,{hms},{place},4,15,0.7,50.0,M,46.0,M,1.0,0000",
            f"GNGST,{hms},1.0,,,,0.020,0.020,0.050",
        ):
            checksum = reduce(lambda total, character: total ^ ord(character), body, 0)
            out += f"${body}*{checksum:02X}\r\n".encode()
    return out


def test_a_train_follows_a_recorded_receiver(tmp_path: Path) -> None:
    entry = {"source": "receiver", "receiver": {"protocol": "nmea", "file": "said.nmea"}, "rate_hz": 5.0}
    entry |= {"trust_stated_std": True, "speed_std_mps": 0.05}
    (tmp_path / "said.nmea").write_bytes(b"")
    of = train(tmp_path, entry)
    (tmp_path / "said.nmea").write_bytes(nmea(of, 20))
    followed = errors(of, 19.0)
    assert len(followed) > 180
    for error, covariance in followed[20:]:
        assert abs(error[0]) < 0.03
        assert abs(error[1]) < 0.05
        assert covariance[0, 0] < 0.02**2


def test_a_train_that_knows_its_receivers_offset_is_consistent(tmp_path: Path) -> None:
    """NEES of [s, v, a] at the end of 16 runs: χ² with 48 degrees of freedom over 16, between 1.4 and 5.5 at 99.9 %."""
    entry = {
        "position_std_m": {"differential": 0.3},
        "offset_std_m": {"differential": 1.0},
        "offset_time_s": 10.0,
        "speed_std_mps": 0.1,
        "simulated": {"solution": "differential"},
    }
    change = {"prior.position_std_m": 0.02, "prior.speed_std_mps": 0.02, "prior.acceleration_std_mps2": 0.01}
    change |= {"fusion.period_ms": 500, "world.motion.start_std": [0.02, 0.02, 0.01]}
    squares = []
    for seed in range(16):
        of = train(tmp_path, entry, **change, **{"world.seed": seed})
        error, covariance = errors(of, 12.0)[-1]
        squares.append(float(error @ np.linalg.solve(covariance, error)))
    assert 1.4 < np.mean(squares) < 5.5
