"""Invariant 1: synchronous, linear, no private states, feedback every epoch: federated = (12)-(17) = centralised."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from invented import HORIZON_NS, NS_PER_S, PRIOR, T0, Plain, Q, drive, filter_of, fuser_of, sensors
from reference import filter_all

from milepost.estimation.estimator import Estimator
from milepost.estimation.layout import Layout
from milepost.estimation.observation import Observation
from milepost.fusion.federated.combination import fuse, share_out

ROWS = [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.3, 1.0, 0.2)]


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    weights=st.lists(st.floats(0.05, 1.0), min_size=1, max_size=5),
    epochs=st.integers(1, 40),
    period_ms=st.sampled_from([5, 10, 20, 100, 1000]),
)
def test_the_sources_rule_equals_the_centralised_filter_to_1e_9(seed, weights, epochs, period_ms):
    rng = np.random.default_rng(seed)
    shares = [w / sum(weights) for w in weights]
    rows = [ROWS[i] for i in rng.integers(0, len(ROWS), len(shares))]
    filters = [Estimator(Layout(), Q, PRIOR, HORIZON_NS, share) for share in shares]
    all_observations, fused, times = [], [], []
    for k in range(epochs):
        at = T0 + k * period_ms * 1_000_000
        times.append((at - T0) / NS_PER_S)
        beliefs = []
        for i, local in enumerate(filters):
            z, R = float(rows[i] @ np.array([20.0 * times[-1], 20.0, 0.0]) + rng.normal()), float(rng.uniform(0.01, 1.0))
            local.insert(Observation(at, i, k, "x", 0, f"u{i}", rows[i], z, R), at)
            all_observations.append((times[-1], rows[i], z, R))
            beliefs.append(local.state_at(at))
        x, P = fuse(beliefs)
        fused.append((x, P))
        for local, share in zip(filters, shares, strict=True):
            assert local.accept_feedback(at, x, P, share)
    expected = filter_all(all_observations, times, PRIOR.mean, np.diag(PRIOR.std**2), Q)
    for (x, P), (x_c, P_c) in zip(fused, expected, strict=True):
        sigma = np.sqrt(np.diag(P_c))
        np.testing.assert_allclose(x, x_c, rtol=1e-9, atol=1e-9)
        assert np.max(np.abs(P - P_c) / np.outer(sigma, sigma)) < 1e-9


def test_two_beliefs_are_weighted_by_their_information_as_by_hand():
    # P1 = I, P2 = I/3: P_g = I/4, x_g = (x1 + 3 x2)/4
    x, P = fuse([(np.array([4.0, 0.0, 0.0]), np.eye(3)), (np.array([0.0, 8.0, 4.0]), np.eye(3) / 3.0)])
    np.testing.assert_allclose(x, [1.0, 6.0, 3.0], rtol=1e-14)
    np.testing.assert_allclose(P, np.eye(3) / 4.0, rtol=1e-14)


def test_fusing_nothing_is_an_error():
    with pytest.raises(ValueError, match="belief"):
        fuse([])


@given(
    shares=st.dictionaries(st.sampled_from("abcdef"), st.floats(0.0, 1.0), min_size=1),
    reporting=st.lists(st.sampled_from("abcdef"), unique=True, min_size=1),
)
def test_the_shares_of_the_reporting_units_always_sum_to_one(shares, reporting):
    out = share_out(shares, reporting)
    assert set(out) == set(reporting)
    assert sum(out.values()) == pytest.approx(1.0, abs=1e-12)


def test_a_silent_units_share_goes_to_the_others_in_proportion():
    assert share_out({"a": 0.5, "b": 0.25, "c": 0.25}, ["b", "c"]) == {"b": 0.5, "c": 0.5}


def test_synchronous_federated_nodes_equal_the_centralised_filter():
    """The same through the real nodes: readings on the epochs, feedback delivered at once."""
    units = sensors(Plain)
    fuser, local = fuser_of(units, "federated"), filter_of(units, "plain")
    readings, _ = drive(7, units, 2.0, 50.0)
    observations, got = [], {}
    for k, r in enumerate(readings[:80]):
        at = T0 + k * 20_000_000
        r = r.model_copy(update={"measured_at_ns": at, "published_at_ns": at})
        observations.append((k * 0.02, (0.0, 1.0, 0.0), r.speed_mps, r.speed_variance_m2ps2))
        for estimate in local.step(r, at):
            for output in fuser.step(estimate.message, at):
                if output.stream == "state":
                    got[output.message.measured_at_ns] = output.message
                elif output.stream == "feedback":
                    list(local.step(output.message, at))
    times = [k * 0.02 for k in range(80)]
    expected = filter_all(observations, times, PRIOR.mean, np.diag(PRIOR.std**2), Q)
    assert len(got) == 80
    for k, (x, P) in enumerate(expected):
        state = got[T0 + k * 20_000_000]
        sigma = np.sqrt(np.diag(P))
        assert np.max(np.abs(np.array([state.position_m, state.speed_mps, state.acceleration_mps2]) - x) / sigma) < 1e-9
