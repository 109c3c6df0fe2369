"""The unrolled kernel for one private state against the general one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from milepost.estimation.estimator import kernel_for
from milepost.estimation.kalman import ArrayKernel
from milepost.estimation.layout import Layout, PrivateState
from milepost.estimation.scalar_private import PrivateScalarKernel

finite = st.floats(-50.0, 50.0)
taus = st.sampled_from([math.inf, 900.0, 0.5])


def layout(tau: float, scales: bool = False) -> Layout:
    return Layout((("unit", (PrivateState("bias", 0.0, 1.0, tau, 1e-3, scales),)),))


def kernels(tau: float, q: float, scales: bool = False) -> tuple[PrivateScalarKernel, ArrayKernel]:
    kernel = kernel_for(layout(tau, scales), q)
    assert isinstance(kernel, PrivateScalarKernel)
    return kernel, ArrayKernel(layout(tau, scales), q)


def belief(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, 4)) * 10.0 ** rng.uniform(-3, 2, size=(4, 1))
    return rng.normal(size=4) * 20.0, root @ root.T + 1e-9 * np.eye(4)


def same(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray], of: np.ndarray, within: float) -> None:
    scale = np.sqrt(np.diag(of))
    np.testing.assert_allclose(a[1] / np.outer(scale, scale), b[1] / np.outer(scale, scale), atol=within)
    np.testing.assert_allclose((a[0] - b[0]) / scale, 0.0, atol=1e3 * within)


@settings(deadline=None, max_examples=200)
@given(
    seed=st.integers(0, 2**32 - 1),
    tau=taus,
    dt=st.floats(0.0, 10.0),
    row=st.tuples(finite, finite, finite, finite),
    z=finite,
    R=st.floats(1e-6, 1e3),
    q=st.floats(1e-8, 10.0),
    scales=st.booleans(),
)
def test_its_steps_compute_what_the_general_ones_do(seed, tau, dt, row, z, R, q, scales):
    scalar, general = kernels(tau, q, scales)
    mean, covariance = belief(seed)
    before = general.advance(general.pack(mean, covariance), dt)
    a = scalar.update(scalar.advance(scalar.pack(mean, covariance), dt), row, z, R)
    b = general.update(before, row, z, R)
    same(scalar.unpack(a), general.unpack(b), before[1], 1e-9)


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.01, 1.0))
def test_its_share_of_feedback_is_the_general_kernels(seed, share):
    scalar, general = kernels(math.inf, 1.0)
    mean, covariance = belief(seed)
    a = scalar.shared(mean.tolist(), covariance.tolist(), share)
    b = general.shared(mean, covariance, share)
    same(scalar.unpack(a), general.unpack(b), b[1], 1e-9)


def test_feedback_with_a_singular_common_block_is_an_error():
    scalar, _ = kernels(math.inf, 1.0)
    with pytest.raises(np.linalg.LinAlgError):
        scalar.shared([0.0] * 4, np.diag([1.0, 0.0, 1.0, 1.0]).tolist(), 0.5)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), R=st.floats(1e-8, 1.0))
def test_covariances_stay_positive_through_hard_steps(seed, R):
    rng = np.random.default_rng(seed)
    kernel, _ = kernels(900.0, 1e-6)
    state = kernel.pack(np.zeros(4), np.diag([1e6, 1e4, 1.0, 1e-2]))
    rows = [(1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, -20.0), (0.0, 0.0, 1.0, 1.0)]
    for _ in range(1000):
        state = kernel.update(kernel.advance(state, rng.uniform(0.0, 0.02)), rows[rng.integers(3)], rng.normal(), R)
    P = kernel.unpack(state)[1]
    scale = np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > 0.0


def test_its_lists_are_the_same_numbers_as_its_arrays():
    kernel, _ = kernels(math.inf, 1.0)
    state = kernel.pack(*belief(1))
    mean, covariance = kernel.lists(state)
    assert mean == kernel.unpack(state)[0].tolist()
    assert covariance == kernel.unpack(state)[1].tolist()
