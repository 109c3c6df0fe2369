"""The check that a matrix is a covariance."""

from __future__ import annotations


def check_covariance(matrix: list[list[float]]) -> list[list[float]]:
    """Accept a covariance P (n x n) only if it is square, symmetric and positive semi-definite.

    A Cholesky factorisation of the matrix scaled to a unit diagonal, so that metres next to radians do not
    matter; pivots down to -1e-9 pass as rounding. Raises ValueError otherwise.
    """
    n = len(matrix)
    if n == 0 or any([len(row) != n for row in matrix]):  # noqa: C419 (a list is faster than a generator here)
        raise ValueError("a covariance must be square and not empty")
    if _clearly_definite_3x3(matrix) if n == 3 else _clearly_definite(matrix):
        return matrix
    root = []
    for i in range(n):
        variance = matrix[i][i]
        if variance < 0.0:
            raise ValueError("a covariance cannot have a negative variance")
        root.append(variance**0.5)
    factor: list[list[float]] = []
    for i, row in enumerate(matrix):
        done: list[float] = []
        for j in range(i):
            size = root[i] * root[j]
            if abs(row[j] - matrix[j][i]) > 1e-9 * size:
                raise ValueError("a covariance must be symmetric")
            rest = row[j] / size if size else _zero(row[j])
            above = factor[j]
            for k in range(j):
                rest -= done[k] * above[k]
            pivot = above[j]
            done.append(rest / pivot if pivot > 1e-6 else 0.0)
            # where the pivot vanishes nothing can be divided by it, and the remainder must vanish too
            if pivot <= 1e-6 and abs(rest) > 2e-6:
                raise ValueError("a covariance must be positive semi-definite")
        left = 1.0 if root[i] else 0.0
        for value in done:
            left -= value * value
        # written with `not`, so that a nan from an overflow is refused
        if not left >= -1e-9:
            raise ValueError("a covariance must be positive semi-definite")
        done.append(left**0.5 if left > 0.0 else 0.0)
        factor.append(done)
    return matrix


def _zero(value: float) -> float:
    if value != 0.0:
        raise ValueError("a covariance must be positive semi-definite")
    return 0.0


def _clearly_definite_3x3(matrix: list[list[float]]) -> bool:
    """The usual case, three states and far from singular, by Sylvester's criterion; other matrices are factorised."""
    (p00, p01, p02), (p10, p11, p12), (p20, p21, p22) = matrix
    if not (p01 == p10 and p02 == p20 and p12 == p21 and p00 > 0.0 and p11 > 0.0 and p22 > 0.0):
        return False
    minor = p00 * p11 - p01 * p01
    determinant = p22 * minor - p00 * p12 * p12 - p11 * p02 * p02 + 2.0 * p01 * p02 * p12
    # the minors over their values without correlation; a nan fails both comparisons
    return minor > 1e-12 * p00 * p11 > 0.0 and determinant > 1e-12 * p00 * p11 * p22 > 0.0


def _clearly_definite(matrix: list[list[float]]) -> bool:
    """The usual case of more states: symmetric to rounding, and no pivot near 0, so that nothing needs to be scaled."""
    factor: list[list[float]] = []
    inverse_pivots: list[float] = []
    for i, row in enumerate(matrix):
        done: list[float] = []
        variance = left = row[i]
        for j, above in enumerate(factor):
            rest = row[j]
            asymmetry = rest - matrix[j][i]
            if asymmetry * asymmetry > 1e-20 * variance * matrix[j][j]:
                return False
            for a, b in zip(done, above):  # noqa: B905 (`above` has one entry more, and `strict` costs time)
                rest -= a * b
            value = rest * inverse_pivots[j]
            left -= value * value
            done.append(value)
        # written with `not`, so that a nan from an overflow is not accepted
        if not left > 1e-9 * variance > 0.0:
            return False
        inverse_pivots.append(left**-0.5)
        factor.append(done)
    return True
