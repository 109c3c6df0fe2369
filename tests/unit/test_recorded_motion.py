"""Motions that recordings show: a path in earth-centred metres, a GNSS log of which not all is trusted."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from examples import REMOVED, write_train
from milepost.config.line_file import load_line
from milepost.config.train import load_train
from milepost.simulation.recorded_motion import path_motion


def test_a_recorded_path_becomes_a_motion_along_its_line(tmp_path: Path) -> None:
    """Due north on the equator's meridian 0 at 10 m/s, then 12: chainage and speed are those of the file."""
    rows = ["t_s,ecef_x_m,ecef_y_m,ecef_z_m,ecef_vx_mps,ecef_vy_mps,ecef_vz_mps"]
    z = 0.0
    for k in range(60):
        v = 10.0 if k < 30 else 12.0
        rows.append(f"{100.0 + k},{6378137.0},0.0,{z},0.0,0.0,{v}")
        z += v
    path = tmp_path / "path.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    (tmp_path / "line.yaml").write_text("line: path\npath_csv: path.csv\n", encoding="utf-8")
    motion = path_motion(path, load_line(tmp_path / "line.yaml").track)
    assert motion.end_s == 59.0
    assert motion.at(10.0)[:2] == pytest.approx((100.0, 10.0), abs=1e-3)
    assert motion.at(45.0)[:2] == pytest.approx((300.0 + 15 * 12.0, 12.0), abs=1e-3)


def test_fixes_that_are_not_trusted_show_no_motion(tmp_path: Path) -> None:
    """A log whose middle calls itself RTK and stands still: without those spans the train rolls on at 10 m/s."""
    start = datetime(2022, 2, 25, tzinfo=UTC)
    rows = ["time_utc,latitude_deg,longitude_deg,position_type"]
    for k in range(100):
        travelled = 200.0 if 20 <= k < 80 else 10.0 * k
        stamp = (start + timedelta(seconds=k)).isoformat()
        rows.append(f"{stamp},50.9,{4.5 + travelled / 70310.0:.9f},NARROW_INT")
    (tmp_path / "log.csv").write_text("\n".join(rows), encoding="utf-8")
    (tmp_path / "l.geojson").write_text('{"type": "LineString", "coordinates": [[4.5, 50.9], [4.6, 50.9]]}', encoding="utf-8")
    motion = {"kind": "recorded", "gnss_log": "log.csv", "untrusted_s": [[20.0, 80.0]]}
    train = load_train(write_train(tmp_path, {"world.motion": motion}, {"geojson": "l.geojson", "length_m": REMOVED}))
    s, v, _ = train.world().motion.at(50.0)
    assert s == pytest.approx(500.0, abs=1.0)
    assert v == pytest.approx(10.0, abs=0.1)
