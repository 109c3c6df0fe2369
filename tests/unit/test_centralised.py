"""The centralised filter over readings, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from milepost.estimation.centralised import Reading, centralised
from milepost.estimation.estimator import Prior
from milepost.estimation.layout import Layout, PrivateState

S = 1_000_000_000
STILL = Prior(np.array([0.0, 10.0, 0.0]), np.array([1.0, 1e-9, 1e-9]))
SCALE = Layout((("wheel", (PrivateState("scale", 0.0, 0.1),)),))


def reading(at_s: float, observe, unit: str = "wheel") -> Reading:
    return Reading(round(at_s * S), 0, round(at_s * 10), "i", unit, observe)


def fix(value: float) -> object:
    return lambda mean, covariance: [((1.0, 0.0, 0.0), value, 1.0)]


def test_two_fixes_in_any_order_are_averaged_at_their_times():
    """Prior variance 1 at 0 m, a fix of 2 m at once: 1 m, variance 1/2. A second on: 11 m; a fix of 12.5 m: 11.5 m, 1/3."""
    readings = [reading(2.0, fix(12.5), "g"), reading(1.0, fix(2.0), "g")]
    out = {at: (x, P) for at, x, P in centralised(readings, [S, 2 * S, 3 * S], Layout(), 1e-12, STILL)}
    assert out[S][0][0] == pytest.approx(1.0)
    assert out[2 * S][0][0] == pytest.approx(11.5)
    assert out[2 * S][1][0, 0] == pytest.approx(1.0 / 3.0)
    assert out[3 * S][0][0] == pytest.approx(21.5)


def test_a_reading_is_linearised_at_the_belief_from_all_earlier_readings():
    """A wheel z = (1 + κ) v at v = 10 m/s, known: κ = 0.1 after z = 11 with a variance that says nothing else."""
    seen = []

    def observe(mean, covariance):
        seen.append((float(mean[0]), float(mean[3]), covariance.shape))
        return [((0.0, 1.0 + mean[3], 0.0, mean[1]), 11.0 + mean[3] * mean[1], 1.0)]

    # κ's variance 0.01 and h = 10: S = 2, K = 0.05; so κ = 0.05 after the first, and its variance 0.005
    last = list(centralised([reading(1.0, observe), reading(2.0, observe)], [2 * S], SCALE, 1e-12, STILL))[-1]
    assert seen[0] == (0.0, 0.0, (4, 4))
    assert seen[1][:2] == pytest.approx((10.0, 0.05), abs=1e-6)
    # z - h x = 11.5 - (1.05 · 10 + 10 · 0.05) = 0.5; S = 1.5, K = 0.05/1.5
    assert last[1][3] == pytest.approx(0.05 + 0.05 / 1.5 * 0.5, abs=1e-6)


def test_a_unit_without_private_states_sees_the_common_ones_alone():
    sizes = []

    def observe(mean, covariance):
        sizes.append((mean.shape, covariance.shape))
        return []

    list(centralised([reading(1.0, observe, "radar")], [S], SCALE, 1e-6, STILL))
    assert sizes == [((3,), (3, 3))]


def test_the_prior_sits_at_the_given_time():
    readings = [reading(0.5, lambda mean, covariance: []), reading(2.0, fix(10.0), "g")]
    out = list(centralised(readings, [S // 2, S, 2 * S], Layout(), 1e-12, STILL, begins_ns=S))
    assert [at for at, _, _ in out] == [S, 2 * S]
    assert out[0][1][0] == 0.0
    assert out[1][1][0] == pytest.approx(10.0)
