"""Feedback's arithmetic: the common block replaced or divided, the private states following."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from milepost.estimation.gaussian import inflate_common, replace_common, stretched


def belief(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    return rng.normal(size=n), root @ root.T + 0.1 * np.eye(n)


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(3, 8), share=st.floats(0.01, 1.0))
def test_dividing_the_common_block_keeps_the_private_states_conditional_belief(seed, n, share):
    mean, P = belief(seed, n)
    out = inflate_common(mean, P, share)
    np.testing.assert_allclose(out[:3, :3], P[:3, :3] / share)

    def conditional(M):
        return M[3:, 3:] - M[3:, :3] @ np.linalg.solve(M[:3, :3], M[:3, 3:])

    np.testing.assert_allclose(conditional(out), conditional(P), atol=1e-9)
    np.testing.assert_allclose(np.linalg.solve(out[:3, :3], out[:3, 3:]), np.linalg.solve(P[:3, :3], P[:3, 3:]), atol=1e-9)
    assert np.linalg.eigvalsh(out).min() > -1e-9


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(4, 8))
def test_replacing_the_common_belief_equals_bayes_rule_for_what_it_adds(seed, n):
    """An observation of common states alone, taken before or through the replaced marginal, gives the same joint belief."""
    mean, P = belief(seed, n)
    H = np.hstack([np.eye(3), np.zeros((3, n - 3))])
    R = np.diag([0.5, 0.2, 0.1])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    x, joint = mean + K @ (np.ones(3) - H @ mean), P - K @ H @ P
    got_x, got_P = replace_common(mean, P, x[:3], joint[:3, :3])
    np.testing.assert_allclose(got_x, x, atol=1e-9)
    np.testing.assert_allclose(got_P, joint, atol=1e-9)


@pytest.mark.parametrize("share", [0.0, -0.1, 1.1, float("nan")])
def test_a_share_outside_zero_to_one_is_an_error(share):
    with pytest.raises(ValueError, match="share"):
        inflate_common(np.zeros(3), np.eye(3), share)


def test_what_readings_of_a_scaled_motion_cannot_tell_apart_stays_so_when_the_mean_moves():
    """By hand: at κ = 0.25 and (v, a) = (10, 1), δκ = 1 comes with δv = 8 and δa = 0.8; at (15, 2) with 12 and 1.6."""
    before, after = np.array([0.0, 10.0, 1.0, 0.25]), np.array([0.5, 15.0, 2.0, 0.25])
    direction, moved = np.array([0.0, 8.0, 0.8, 1.0]), np.array([0.4, 12.0, 1.6, 1.0])
    np.testing.assert_allclose(stretched(before, after, np.outer(direction, direction), 3), np.outer(moved, moved), rtol=1e-14)


def test_a_state_that_is_known_is_not_stretched():
    P = np.diag([1.0, 2.0, 3.0, 0.0])
    np.testing.assert_array_equal(stretched(np.zeros(4), np.array([1.0, 2.0, 3.0, 0.0]), P, 3), P)
