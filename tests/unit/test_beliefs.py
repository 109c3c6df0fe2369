"""Many beliefs in one array, and what is taken back of them."""

from __future__ import annotations

import numpy as np
import pytest

from banks import Ride, reader, scaled_layout, speedometer, wheel
from milepost.estimation.beliefs import Beliefs, joined
from milepost.fusion.recovery import forgotten

X = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
P = np.array([np.diag([10.0, 20.0, 30.0]), [[7.0, 0.1, 0.2], [0.1, 8.0, 0.3], [0.2, 0.3, 9.0]]])


def test_joined_holds_the_covariance_beside_the_mean_on_both_sides() -> None:
    np.testing.assert_array_equal(
        joined(X, P)[:, :, 1],
        [[7.0, 0.1, 0.2, 4.0], [0.1, 8.0, 0.3, 5.0], [0.2, 0.3, 9.0, 6.0], [4.0, 5.0, 6.0, 0.0]],
    )


def test_a_unit_sees_its_own_states() -> None:
    seen = Beliefs(joined(X, P), (0, 2))
    assert seen.mean(1).tolist() == [3.0, 6.0]
    assert seen.covariance(0, 1).tolist() == [0.0, 0.2]
    mean, covariance = seen.of(1)
    assert (mean.tolist(), covariance.tolist()) == ([4.0, 6.0], [[7.0, 0.2], [0.2, 9.0]])


def test_what_is_forgotten_of_a_unit_is_its_prior_and_nothing_else_changes() -> None:
    """GIVEN a wheel whose diameter was learned WHEN two rows forget it THEN it is the prior there, correlated with nothing."""
    ride = Ride([speedometer("radar"), wheel(), reader()], scaled_layout())
    bank = list(ride.moments(20.0))[-1].bank
    rows = np.zeros(len(bank.alive), dtype=bool)
    rows[[0, 2]] = True
    after = forgotten(bank, rows, slice(3, 4), np.array([0.02]), np.array([0.07]), 7.0)
    for row, forgets in enumerate(rows):
        if not forgets:
            np.testing.assert_array_equal(after.beliefs[:, :, row], bank.beliefs[:, :, row])
            continue
        assert after.x[row].tolist() == [*bank.x[row, :3], 0.02]
        np.testing.assert_array_equal(after.P[row, :3, :3], bank.P[row, :3, :3])
        assert after.P[row, 3].tolist() == pytest.approx([0.0, 0.0, 0.0, 1e-4])
        np.testing.assert_array_equal(after.beliefs[:, :, row], after.beliefs[:, :, row].T)


def test_what_is_taken_of_beliefs_leaves_them_alone() -> None:
    B = joined(X, P)
    before = B.copy()
    mean, covariance = Beliefs(B, (0, 1, 2)).of(0)
    mean[:], covariance[:] = 0.0, 0.0
    np.testing.assert_array_equal(B, before)
