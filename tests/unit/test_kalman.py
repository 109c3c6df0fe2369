"""The filter's steps by hand, and the unrolled kernel against the general one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from milepost.estimation.kalman import ArrayKernel, predict, update
from milepost.estimation.layout import Layout, PrivateState
from milepost.estimation.motion import full_process_noise, full_transition, process_noise, transition
from milepost.estimation.scalar import ScalarKernel

finite = st.floats(-50.0, 50.0)


def belief(rng: np.random.Generator, n: int = 3) -> tuple[np.ndarray, np.ndarray]:
    root = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-3, 2, size=(n, 1))
    return rng.normal(size=n) * 20.0, root @ root.T + 1e-12 * np.eye(n)


def test_prediction_moves_the_state_as_by_hand():
    x, P = predict(np.array([10.0, 20.0, 2.0]), np.diag([1.0, 4.0, 9.0]), transition(2.0), process_noise(2.0, 3.0))
    np.testing.assert_allclose(x, [10.0 + 40.0 + 4.0, 24.0, 2.0])
    # P00 = 1 + 4·2² + 9·(2²/2)², plus q T⁵/20 = 3·32/20
    assert P[0, 0] == pytest.approx(1.0 + 16.0 + 36.0 + 4.8)
    assert P[1, 1] == pytest.approx(4.0 + 36.0 + 3.0 * 8.0 / 3.0)
    assert P[0, 2] == pytest.approx(9.0 * 2.0 + 3.0 * 8.0 / 6.0)
    assert P[2, 2] == pytest.approx(9.0 + 6.0)


def test_an_update_with_equal_variances_meets_in_the_middle():
    x, P = update(np.array([0.0, 20.0, 0.0]), np.diag([1.0, 4.0, 1.0]), np.array([0.0, 1.0, 0.0]), 24.0, 4.0)
    np.testing.assert_allclose(x, [0.0, 22.0, 0.0])
    np.testing.assert_allclose(P, np.diag([1.0, 2.0, 1.0]))


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), first=st.floats(1e-4, 10.0), second=st.floats(1e-4, 10.0))
def test_process_noise_composes_whatever_the_steps(seed, first, second):
    layout = Layout((("u", (PrivateState("bias", 0.0, 1.0, 900.0, 1e-3), PrivateState("scale", 0.0, 1.0, noise_psd=1e-4))),))
    F1, F2 = full_transition(first, layout), full_transition(second, layout)
    Q1, Q2 = full_process_noise(first, 2.0, layout), full_process_noise(second, 2.0, layout)
    np.testing.assert_allclose(F2 @ F1, full_transition(first + second, layout), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(F2 @ Q1 @ F2.T + Q2, full_process_noise(first + second, 2.0, layout), rtol=1e-9, atol=1e-15)


@settings(deadline=None, max_examples=200)
@given(
    seed=st.integers(0, 2**32 - 1),
    dt=st.floats(0.0, 10.0),
    row=st.tuples(finite, finite, finite),
    z=finite,
    R=st.floats(1e-6, 1e3),
    q=st.floats(1e-8, 10.0),
)
def test_the_scalar_kernel_computes_what_the_general_one_does(seed, dt, row, z, R, q):
    mean, covariance = belief(np.random.default_rng(seed))
    scalar, general = ScalarKernel(q), ArrayKernel(Layout(), q)
    a = scalar.update(scalar.advance(scalar.pack(mean, covariance), dt), row, z, R)
    b = general.update(general.advance(general.pack(mean, covariance), dt), row, z, R)
    (x_a, P_a), (x_b, P_b) = scalar.unpack(a), general.unpack(b)
    before = general.advance(general.pack(mean, covariance), dt)[1]
    scale = np.sqrt(np.diag(before))
    np.testing.assert_allclose(P_a / np.outer(scale, scale), P_b / np.outer(scale, scale), atol=1e-9)
    np.testing.assert_allclose((x_a - x_b) / scale, 0.0, atol=1e-6)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), R=st.floats(1e-8, 1.0))
def test_covariances_stay_positive_through_a_thousand_hard_steps(seed, R):
    """Very sure observations of a very unsure state, where the short form P - K S Kᵀ goes negative."""
    rng = np.random.default_rng(seed)
    kernel = ScalarKernel(1e-6)
    state = kernel.pack(np.zeros(3), np.diag([1e6, 1e4, 1.0]))
    rows = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    for _ in range(1000):
        state = kernel.update(kernel.advance(state, rng.uniform(0.0, 0.02)), rows[rng.integers(3)], rng.normal(), R)
    P = kernel.unpack(state)[1]
    scale = np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > 0.0


def test_lists_for_messages_are_the_same_numbers_as_the_arrays():
    mean, covariance = belief(np.random.default_rng(1))
    for kernel in (ScalarKernel(1.0), ArrayKernel(Layout(), 1.0)):
        state = kernel.pack(mean, covariance)
        m, P = kernel.lists(state)
        assert m == kernel.unpack(state)[0].tolist()
        assert kernel.unpack(state)[1].tolist() == P
