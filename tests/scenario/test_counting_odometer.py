"""An odometer that only counts its pulses, at speeds of about one and of many pulses a period."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from test_one_after_another import ROOT, suffered

pytestmark = pytest.mark.long


def counting(folder: Path, speed_mps: float) -> Path:
    """The train `regional` at a steady speed; its front odometer counts in periods of 20 ms."""
    train = yaml.safe_load((ROOT / "deploy/trains/regional.yaml").read_text(encoding="utf-8"))
    train["line"] = str(ROOT / "deploy/trains" / train["line"])
    train["motion_model"] = {"jerk_psd_m2ps5": 0.01}
    train["prior"] |= {"speed_mps": speed_mps}
    train["world"]["motion"] |= {"profile": [[0.0, speed_mps]], "driver_time_s": 30.0, "jerk_psd_m2ps5": 1e-4}
    train["units"]["odometer-front"] |= {"rate_hz": 50.0, "timer_s": None, "diameter_m": 0.9}
    path = folder / "train.yaml"
    path.write_text(yaml.safe_dump(train), encoding="utf-8")
    return path


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("speed_mps", [1.6, 5.0, 20.0])
def test_an_honest_one_stays_in_use(tmp_path: Path, speed_mps: float, seed: int) -> None:
    """GIVEN a train at a steady speed, an odometer of which counts fifty times a second THEN nobody is excluded."""
    journey = suffered(60.0, seed=seed, file=counting(tmp_path, speed_mps))
    excluded = {each.unit: each.reason for state in journey.live.values() for each in state.excluded if each.kind != "silent"}
    assert excluded == {}
    assert journey.outside() == []
