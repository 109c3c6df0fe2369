"""`check_covariance` agrees with numpy's eigenvalues on what a covariance is."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from milepost_schemas.message import check_covariance

Array = NDArray[np.float64]

sizes = st.integers(1, 8)
seeds = st.integers(0, 2**32 - 1)
# standard deviations of one matrix, from micrometres to thousands of kilometres
scales = st.lists(st.sampled_from([1e-6, 1e-3, 1.0, 30.0, 1e3, 1e6]), min_size=8, max_size=8)


def accepts(matrix: Array | list[list[float]]) -> bool:
    rows = matrix.tolist() if isinstance(matrix, np.ndarray) else matrix
    try:
        assert check_covariance(rows) is rows
    except ValueError:
        return False
    return True


def with_eigenvalues(eigenvalues: list[float], seed: int) -> Array:
    """A symmetric matrix with these eigenvalues, in random directions."""
    n = len(eigenvalues)
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((n, n)))
    matrix = (q * np.array(eigenvalues)) @ q.T
    return 0.5 * (matrix + matrix.T)


def scaled(matrix: Array, std: list[float]) -> Array:
    d = np.array(std[: len(matrix)])
    out = matrix * np.outer(d, d)
    return 0.5 * (out + out.T)


def smallest_eigenvalue_of_correlation(matrix: Array) -> float:
    root = np.sqrt(np.diag(matrix))
    return float(np.linalg.eigvalsh(matrix / np.outer(root, root)).min())


@settings(max_examples=100)
@given(n=sizes, seed=seeds, std=scales, exponents=st.lists(st.floats(-14.0, 0.0), min_size=8, max_size=8))
def test_a_positive_definite_matrix_passes_at_any_scaling(n: int, seed: int, std: list[float], exponents: list[float]) -> None:
    assert accepts(scaled(with_eigenvalues([10.0**e for e in exponents[:n]], seed), std))


@settings(max_examples=100)
@given(n=st.integers(2, 8), rank=st.integers(1, 7), seed=seeds, std=scales)
def test_a_singular_matrix_passes(n: int, rank: int, seed: int, std: list[float]) -> None:
    eigenvalues = [1.0] * min(rank, n) + [0.0] * (n - min(rank, n))
    assert accepts(scaled(with_eigenvalues(eigenvalues, seed), std))


@settings(max_examples=100)
@given(n=st.integers(2, 8), seed=seeds, std=scales, exponent=st.floats(-3.0, 0.0))
def test_a_negative_eigenvalue_is_refused_at_any_scaling(n: int, seed: int, std: list[float], exponent: float) -> None:
    matrix = with_eigenvalues([1.0] * (n - 1) + [-(10.0**exponent)], seed)
    assume(np.diag(matrix).min() > 0.0 and smallest_eigenvalue_of_correlation(matrix) < -1e-4)
    assert not accepts(scaled(matrix, std))


@settings(max_examples=250)
@given(
    n=st.integers(2, 5),
    std=scales,
    data=st.data(),
)
def test_it_agrees_with_numpy_on_symmetric_matrices(n: int, std: list[float], data: st.DataObject) -> None:
    correlation = np.eye(n)
    for i in range(n):
        for j in range(i):
            correlation[i, j] = correlation[j, i] = data.draw(
                st.sampled_from([0.0, 0.5, -0.5, 0.9, -0.9, 0.999, 1.0, -1.0]) | st.floats(-1.1, 1.1)
            )
    smallest = float(np.linalg.eigvalsh(correlation).min())
    verdict = accepts(scaled(correlation, std))
    # in the strip between, as wide as the documented rounding, either answer is right
    if smallest > 1e-9:
        assert verdict
    if smallest < -3e-6 * n:
        assert not verdict


@pytest.mark.parametrize("dt_s", [1e-3, 0.01, 0.1, 1.0, 10.0, 60.0])
@pytest.mark.parametrize("jerk_psd", [1e-9, 1e-6, 1e-2, 1.0])
def test_a_filters_covariance_passes(dt_s: float, jerk_psd: float) -> None:
    from milepost.estimation.motion import process_noise, transition

    P = np.diag([0.02**2, 0.1**2, 0.01**2])
    for step in range(300):
        F = transition(dt_s)
        P = F @ P @ F.T + process_noise(dt_s, jerk_psd)
        h = np.eye(3)[step % 2]
        k = P @ h / (h @ P @ h + 0.04)
        P = P - np.outer(k, h @ P)
        P = 0.5 * (P + P.T)
        assert accepts(P)


def test_a_zero_variance_passes_alone_and_with_zero_covariances() -> None:
    assert accepts([[0.0]])
    assert accepts([[0.0, 0.0], [0.0, 0.0]])
    assert accepts([[4.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]])


@pytest.mark.parametrize("value", [1e-300, 1e-12, 1.0])
def test_a_zero_variance_with_a_covariance_is_refused(value: float) -> None:
    assert not accepts([[0.0, value], [value, 1.0]])
    assert not accepts([[1.0, value], [value, 0.0]])


@pytest.mark.parametrize("at", [0, 1, 2])
def test_a_negative_variance_is_refused_wherever_it_stands(at: int) -> None:
    matrix = np.eye(3)
    matrix[at, at] = -1e-12
    assert not accepts(matrix)


@pytest.mark.parametrize("matrix", [[], [[]], [[1.0, 0.0]], [[1.0], [0.0]], [[1.0, 0.0], [0.0]], [[1.0, 0.0], [0.0, 1.0, 0.0]]])
def test_a_matrix_that_is_not_square_is_refused(matrix: list[list[float]]) -> None:
    assert not accepts(matrix)


@settings(max_examples=80)
@given(n=st.integers(2, 6), seed=seeds, std=scales, data=st.data())
def test_asymmetry_is_refused_above_rounding_and_passes_below(n: int, seed: int, std: list[float], data: st.DataObject) -> None:
    matrix = scaled(with_eigenvalues([1.0, *[0.5] * (n - 1)], seed), std)
    i, j = data.draw(st.permutations(range(n)))[:2]
    size = math.sqrt(matrix[i, i] * matrix[j, j])
    rounding, wrong = matrix.copy(), matrix.copy()
    rounding[i, j] += 1e-12 * size
    wrong[i, j] += 1e-6 * size
    assert accepts(rounding)
    assert not accepts(wrong)


@pytest.mark.parametrize("std", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_correlation_may_pass_one_by_rounding_and_no_more(std: float, sign: float) -> None:
    for excess, sound in ((0.0, True), (1e-10, True), (1e-8, False), (1e-4, False)):
        shared = sign * std * 3.0 * (1.0 + excess)
        assert accepts([[std**2, shared], [shared, 9.0]]) == sound


@pytest.mark.parametrize("seed", range(20))
def test_the_order_of_the_states_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    order = rng.permutation(4)
    sound = scaled(with_eigenvalues([1.0, 0.1, 1e-3, 0.0], seed), [1e6, 1e-6, 1.0, 1e3])
    unsound = scaled(with_eigenvalues([1.0, 0.5, 0.5, -0.05], seed), [1e6, 1e-6, 1.0, 1e3])
    assert accepts(sound[np.ix_(order, order)])
    assert not accepts(unsound[np.ix_(order, order)])


@pytest.mark.parametrize("huge", [1e30, 1e200, 1e308])
def test_a_covariance_that_overflows_is_refused(huge: float) -> None:
    assert not accepts([[1e-10, huge], [huge, 1e-10]])
    assert not accepts([[1e-10, 0.0, huge], [0.0, 1e-10, 0.0], [huge, 0.0, 1e-10]])
    assert not accepts([[1e-300, 0.0, huge], [0.0, 1.0, huge], [huge, huge, 1.0]])
    assert not accepts([[1.0, 0.0, 0.0, huge], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-huge, 0.0, 0.0, 1.0]])
