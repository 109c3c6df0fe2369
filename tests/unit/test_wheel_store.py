"""A kept calibration: back as it was, or refused with the reason; never counted twice; on disk whole or not at all."""

from __future__ import annotations

import json
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples import head, sensor, straight_line
from milepost.estimation.estimator import Prior
from milepost.estimation.filters import FILTERS
from milepost.estimation.filters.base import FilterSetup
from milepost.estimation.layout import Layout
from milepost.nodes.filter import FilterNode
from milepost.runtime.calibration_store import WRITE_EVERY_NS, CalibrationStore, calibration_store_for
from milepost.sensors.odometer.calibration import DAY_NS, Calibration, as_knowledge, from_bytes, to_bytes
from milepost_schemas import Estimate, Event, Feedback, Gaussian, SpeedReading

NOW = 1_700_000_000 * 10**9
KEPT = Calibration("odo", 0.81, 0.0568, 5e-4, NOW - DAY_NS)


def knowledge(kept: Calibration, **changed: Any) -> tuple[float, float]:
    asked = {"unit": "odo", "told_diameter_m": 0.81, "prior_std": 0.06, "now_ns": NOW, **changed}
    return as_knowledge(kept, **asked)


def test_a_calibration_reads_back_as_written() -> None:
    assert from_bytes(to_bytes(KEPT)) == KEPT


def test_prior_and_stored_calibration_give_the_calibration_plus_wear() -> None:
    """σ² = 2 (5e-4)² + (2e-4)² a day later; information adds: 1/σ² = 1/σ₀² + 1/R, and κ/σ² = z/R."""
    z, R = knowledge(KEPT)
    together = 1.0 / (1.0 / 0.06**2 + 1.0 / R)
    assert together == pytest.approx(2.0 * 5e-4**2 + 2e-4**2)
    assert together * z / R == pytest.approx(0.0568)


def test_an_older_calibration_has_a_larger_variance() -> None:
    variances = [knowledge(replace(KEPT, saved_at_ns=NOW - days * DAY_NS))[1] for days in (0, 1, 10, 89)]
    assert variances == sorted(variances)
    assert variances[-1] == pytest.approx((89 * 2e-4) ** 2, rel=0.15)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"unit": "odo-2"}, "of odo-2"),
        ({"told_diameter_m": 0.85}, "nominal diameter is 850 mm, not 810"),
        ({"saved_at_ns": NOW - 91 * DAY_NS}, "91 days old"),
        ({"saved_at_ns": NOW + 120 * 10**9}, "future"),
        ({"scale": 0.31}, "1061.1 mm is not plausible"),
        ({"scale": -0.31}, "558.9 mm is not plausible"),
        ({"scale_std": 0.06}, "no better than the prior"),
        ({"scale_std": 0.0, "saved_at_ns": NOW}, "no better than the prior"),
    ],
)
def test_an_implausible_calibration_is_refused(change: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        knowledge(replace(KEPT, **change))


def test_a_clock_set_back_by_seconds_does_not_refuse_a_calibration() -> None:
    assert knowledge(replace(KEPT, saved_at_ns=NOW + 5 * 10**9))[0] > 0.0


def signed(**fields: Any) -> bytes:
    """A file with a right checksum, whatever it says."""
    checksum = zlib.crc32(json.dumps(fields, sort_keys=True).encode())
    return json.dumps({**fields, "crc32": checksum}, sort_keys=True).encode()


GOOD = {"unit": "odo", "told_diameter_m": 0.81, "scale": 0.0568, "scale_std": 5e-4, "saved_at_ns": NOW}


@pytest.mark.parametrize(
    "kept",
    [
        b"",
        b"\x00\xff" * 40,
        b"[" * 100_000,
        b"[]",
        b"{}",
        to_bytes(KEPT)[:-7],
        to_bytes(KEPT).replace(b"0.0568", b"0.0569"),
        to_bytes(KEPT).replace(b'"crc32": ', b'"crc32": 1'),
        signed(**{**GOOD, "scale": float("nan")}),
        signed(**{**GOOD, "scale_std": "small"}),
        signed(**{**GOOD, "saved_at_ns": None}),
        signed(**{**GOOD, "more": 1}),
        signed(unit="odo"),
    ],
)
def test_a_corrupt_file_is_refused(kept: bytes) -> None:
    with pytest.raises(ValueError, match=r"not a calibration|checksum"):
        from_bytes(kept)


# in a filter -------------------------------------------------------------------------------------------------------------


def node(nominal_m: float = 0.81, kind: str = "kalman") -> FilterNode:
    odometer = sensor("odometer", straight_line(), "odo", diameter_m=nominal_m, scale_std=0.06)
    layout = Layout((("odo", odometer.private_states),))
    prior = Prior(np.array([0.0, 20.0, 0.0]), np.array([1.0, 1.0, 0.1]))
    row = FILTERS[kind]
    local = row(FilterSetup(layout, 1e-3, prior, 5 * 10**9), row.options_model())
    return FilterNode("metro-1", "a1b2c3d4", odometer, local, 0, True)


def reading(sequence: int, speed_mps: float = 19.0) -> SpeedReading:
    at = NOW + sequence * 100_000_000
    fields = {"speed_mps": speed_mps, "speed_variance_m2ps2": 0.0025, "interval_s": 0.1}
    return SpeedReading(**head("odo", sequence=sequence, measured_at_ns=at, published_at_ns=at), **fields)


def take(to: FilterNode, sequence: int) -> Estimate:
    outputs = list(to.step(reading(sequence), NOW + sequence * 100_000_000))
    (estimate,) = [o.message for o in outputs if isinstance(o.message, Estimate)]
    return estimate


def events(outputs: Any) -> list[tuple[str, str]]:
    return [(o.message.severity, o.message.code) for o in outputs if isinstance(o.message, Event)]


def test_a_stored_calibration_counts_once_with_the_first_reading() -> None:
    cold = node()
    assert events(cold.restore(to_bytes(KEPT), NOW)) == [("info", "calibration_restored")]
    first, second = take(cold, 1), take(cold, 2)
    assert [o.row for o in first.observations[1:]] == [[0.0, 0.0, 0.0, 1.0]]
    assert [o.component for o in first.observations] == [0, 100]
    assert len(second.observations) == 1
    assert first.belief.mean[3] == pytest.approx(0.0568, abs=1e-3)
    assert first.belief.covariance[3][3] ** 0.5 < 8e-4


@pytest.mark.parametrize("kind", sorted(FILTERS))
def test_a_stored_calibration_enters_unchanged_with_every_filter(kind: str) -> None:
    cold = node(kind=kind)
    list(cold.restore(to_bytes(KEPT), NOW))
    plain = node()
    list(plain.restore(to_bytes(KEPT), NOW))
    assert take(cold, 1).observations[1] == take(plain, 1).observations[1]


def test_an_unusable_file_is_an_event_and_the_prior_is_used() -> None:
    cold = node()
    (output,) = cold.restore(to_bytes(replace(KEPT, unit="other")), NOW)
    assert isinstance(output.message, Event)
    assert output.message.code == "calibration_unusable"
    assert "it is of other" in output.message.text
    assert len(take(cold, 1).observations) == 1


def test_the_stored_calibration_is_the_learned_one() -> None:
    warm = node()
    assert warm.snapshot() is None
    list(warm.restore(to_bytes(KEPT), NOW))
    for sequence in range(1, 5):
        take(warm, sequence)
    kept = warm.snapshot()
    assert kept is not None
    again = from_bytes(kept)
    assert (again.unit, again.told_diameter_m, again.saved_at_ns) == ("odo", 0.81, NOW + 400_000_000)
    assert again.scale == pytest.approx(0.0568, abs=2e-3)
    assert 1e-4 < again.scale_std < 8e-4


def told(sequence: int, share: float) -> Feedback:
    """Feedback that agrees with the readings, and gives the unit a share."""
    at = NOW + sequence * 100_000_000
    states = ["position_m", "speed_mps", "acceleration_mps2", "odo.scale"]
    variances = np.diag([1.0, 1e-4, 1e-2, 1e-6])
    fused = Gaussian(states=states, mean=[2.0 * sequence, 20.0, 0.0, 0.0568], covariance=variances.tolist())
    stamps = {"sequence": sequence, "measured_at_ns": at, "published_at_ns": at}
    bounds = {"position_min_m": -9.0, "position_max_m": 9e3, "speed_min_mps": 0.0, "speed_max_mps": 90.0}
    return Feedback(**head("fuser", **stamps), fused=fused, shares={"odo": share} if share else {}, **bounds)


def test_what_a_unit_that_is_out_of_use_learns_is_not_kept() -> None:
    """A wheel that lies for long learns its lie beside the exclusion: it would begin the next run with it."""
    warm = node()
    kept = []
    for sequence, share in enumerate((0.5, 0.5, 0.0, 0.0, 0.5), start=1):
        take(warm, sequence)
        assert list(warm.step(told(sequence, share), NOW + sequence * 100_000_000)) == []
        kept.append(warm.snapshot() is not None)
    assert kept == [True, True, False, False, True]


# on disk -----------------------------------------------------------------------------------------------------------------


def test_a_calibration_survives_a_cold_start_through_the_disk(tmp_path: Path) -> None:
    state = tmp_path / "state"
    warm = node()
    list(warm.restore(to_bytes(KEPT), NOW))
    take(warm, 1)
    store = calibration_store_for(warm, "metro-1", state)
    assert store is not None
    assert list(store.restore(NOW)) == []
    store.write()
    assert [path.name for path in state.iterdir()] == ["metro-1.odo.json"]
    cold = node()
    again = calibration_store_for(cold, "metro-1", state)
    assert again is not None
    assert events(again.restore(NOW + 10**9)) == [("info", "calibration_restored")]
    assert take(cold, 2).belief.mean[3] == pytest.approx(0.0568, abs=2e-3)


def test_the_file_is_replaced_every_five_seconds(tmp_path: Path) -> None:
    warm = node()
    take(warm, 1)
    store = CalibrationStore(warm, tmp_path / "k.json")
    written = []
    for second in range(12):
        store.once_a_second(NOW + second * 10**9)
        written.append((tmp_path / "k.json").stat().st_ino)
    assert WRITE_EVERY_NS == 5 * 10**9
    assert [written[i] != written[i - 1] for i in range(1, 12)] == [i in (5, 10) for i in range(1, 12)]
    assert len(list(tmp_path.iterdir())) == 1


def test_a_write_error_is_reported_once_and_does_not_stop_the_filter(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    warm = node()
    take(warm, 1)
    (tmp_path / "file").write_text("in the way")
    store = CalibrationStore(warm, tmp_path / "file" / "k.json")
    store.write()
    store.write()
    assert len([r for r in caplog.records if "not kept" in r.message]) == 1
    assert list(store.restore(NOW)) == []


def test_without_a_folder_nothing_is_stored() -> None:
    assert calibration_store_for(node(), "metro-1", None) is None
