"""The `simulated` block: what a simulated device does, apart from what it states and its filter believes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from examples import all_readings, sensor, straight_line, surveyed_line, world
from milepost.recordings.measured import Measured
from milepost.sensors import SENSORS

STILL = [(0.0, 20.0)]


def readings(kind: str, **options: Any) -> list[Measured]:
    on = surveyed_line() if kind == "gnss" else straight_line()
    return all_readings(sensor(kind, on, **options).open(world(STILL, end_s=40.0, line=on), 0.0))


def speeds(kind: str, **options: Any) -> np.ndarray:
    return np.array([m.fields["speed_mps"] for m in readings(kind, **options)])


@pytest.mark.parametrize("kind", sorted(SENSORS))
def test_every_simulated_sensor_has_a_simulated_block(kind: str) -> None:
    assert "simulated" in SENSORS[kind].options_model.model_fields


@pytest.mark.parametrize("kind", ["doppler_radar", "janus_radar"])
def test_a_radar_noisier_than_it_states(kind: str) -> None:
    """R = 0.01 stated, 0.25 in truth, of one beam; two beams halve both."""
    share = 1.0 if kind == "doppler_radar" else 0.5
    said = readings(kind, rate_hz=50.0, speed_variance_m2ps2=0.01, simulated={"speed_variance_m2ps2": 0.25})
    assert [m.fields["speed_variance_m2ps2"] for m in said] == pytest.approx([0.01 * share] * len(said))
    assert np.var([m.fields["speed_mps"] for m in said]) == pytest.approx(0.25 * share, rel=0.15)


def test_a_radar_mounted_otherwise_than_believed() -> None:
    """1° nose up at 45° makes one beam read cos 1° + sin 1° = 1.0173 times the speed."""
    said = speeds("doppler_radar", speed_variance_m2ps2=1e-12, simulated={"mounting_pitch_deg": 1.0})
    assert said == pytest.approx(20.0 * 1.0173, rel=1e-4)


def test_an_inertial_unit_with_a_larger_bias_than_believed() -> None:
    quiet = {"noise_density_mps2_rthz": 1e-9, "bias_std_mps2": 0.001}
    plain = [m.fields["specific_force_mps2"][0] for m in readings("imu", **quiet)]
    worse = [m.fields["specific_force_mps2"][0] for m in readings("imu", **quiet, simulated={"bias_std_mps2": 0.1})]
    assert np.array(worse) == pytest.approx(100.0 * np.array(plain), abs=1e-5)


def test_a_balise_reader_that_is_later_and_worse_than_it_states() -> None:
    options = {"read_std_m": 0.02, "latency_s": 0.01}
    plain = readings("balise_reader", **options)
    worse = readings("balise_reader", **options, simulated={"read_std_m": 0.2})
    assert {m.fields["reader_variance_m2"] for m in worse} == {0.0004}
    at = [m.measured_s for m in plain]
    off = np.array([m.measured_s - 5.0 * (i + 1) for i, m in enumerate(worse)])
    assert off == pytest.approx(10.0 * (np.array(at) - 5.0 * np.arange(1, len(at) + 1)), abs=1e-6)


def test_what_is_not_given_is_as_believed() -> None:
    for kind in ("doppler_radar", "janus_radar", "imu", "balise_reader"):
        assert readings(kind) == readings(kind, simulated={})
