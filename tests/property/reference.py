"""A centralised Kalman filter written on its own, from the textbook, over explicit matrices: the witness."""

from __future__ import annotations

import numpy as np


def exponential(matrix: np.ndarray) -> np.ndarray:
    """exp(M), by scaling, its series and squaring."""
    squarings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300)))) + 4)
    small = matrix / 2.0**squarings
    out = term = np.eye(len(matrix))
    for n in range(1, 20):
        term = term @ small / n
        out = out + term
    for _ in range(squarings):
        out = out @ out
    return out


def motion(dt: float, q: float, private: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """F and Q by Van Loan's method on the continuous model. `private`: (time constant, noise density) of each."""
    n = 3 + len(private)
    A = np.zeros((n, n))
    A[0, 1] = A[1, 2] = 1.0
    G = np.zeros((n, n))
    G[2, 2] = q
    for i, (tau, density) in enumerate(private, 3):
        A[i, i] = 0.0 if np.isinf(tau) else -1.0 / tau
        G[i, i] = density
    big = np.zeros((2 * n, 2 * n))
    big[:n, :n], big[:n, n:], big[n:, n:] = -A, G, A.T
    E = exponential(big * dt)
    F = E[n:, n:].T
    return F, F @ E[:n, n:]


def filter_all(observations, epochs, x, P, q, private=()):
    """Sorted observations (t, h, z, R); the estimate at every epoch, all in seconds from the first observation."""
    observations = sorted(observations, key=lambda o: o[0])
    t, out, place = observations[0][0], [], 0

    def carry(x, P, dt):
        if dt == 0.0:
            return x, P
        F, Q = motion(dt, q, private)
        return F @ x, F @ P @ F.T + Q

    for epoch in epochs:
        while place < len(observations) and observations[place][0] <= epoch:
            at, h, z, R = observations[place]
            x, P = carry(x, P, at - t)
            t = at
            h = np.asarray(h, dtype=float)[None, :]
            S = h @ P @ h.T + R
            K = P @ h.T / S
            x = x + (K * (z - h @ x)).ravel()
            I_KH = np.eye(len(x)) - K @ h
            P = I_KH @ P @ I_KH.T + K @ K.T * R
            place += 1
        out.append(carry(x, P, epoch - t))
    return out
