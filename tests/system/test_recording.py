"""A recording without a truth, live: nobody invents a world, and everything ends where the recording does."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from conftest import free_port
from examples import RECORDED_ODOMETER, REMOVED, write_train


def test_a_recording_without_a_world_is_replayed_to_its_end(tmp_path: Path) -> None:
    """GIVEN three seconds of an odometer, WHEN they are over, THEN all processes have ended and there was no truth."""
    (tmp_path / "wheel.csv").write_text("t,v\n" + "\n".join(f"{0.1 * k:.1f},10.0" for k in range(31)), encoding="utf-8")
    train = write_train(
        tmp_path, {"world": REMOVED, "fusion": {}, "units": {"odometer": RECORDED_ODOMETER}, "prior.speed_mps": 10.0}
    )
    report = tmp_path / "report.json"
    command = [sys.executable, "-m", "milepost", "up", "--headless", "--train", str(train), "--report", str(report)]
    done = subprocess.run([*command, "--listen", f"tcp/127.0.0.1:{free_port()}"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    found = json.loads(report.read_text())
    # listeners outlive the end by 0.2 s
    assert 130 <= found["states"] <= 165
    assert found["truth"] is None
