"""Motion between knots of [s, v, a], and the generation of the knots for a simulated train."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from milepost.estimation.motion import process_noise, transition

from .noise import block_rng, standard_normal

KNOT_S = 0.01
BLOCK_KNOTS = 1000
BLOCK_S = KNOT_S * BLOCK_KNOTS
Kinematics = tuple[float, float, float]


class Motion(Protocol):
    """Position, speed and acceleration as functions of scenario time, from 0 to `end_s`."""

    end_s: float

    def at(self, t_s: float) -> Kinematics: ...


def quintics(dt_s: NDArray[np.float64], knots: NDArray[np.float64]) -> list[list[float]]:
    """The polynomials c₀..c₅ of s(τ), 0 ≤ τ ≤ dt, through neighbouring knots [s, v, a].

    The quintic through both ends' position, speed and acceleration is the conditional mean of a white-jerk path
    between them: the exact interpolation. dt_s (n-1), knots (n, 3).
    """
    s0, v0, a0 = knots[:-1].T
    s1, v1, a1 = knots[1:].T
    T = dt_s
    d = s1 - s0 - v0 * T - 0.5 * a0 * T**2
    e = (v1 - v0 - a0 * T) * T
    f = (a1 - a0) * T**2
    c3 = (10.0 * d - 4.0 * e + 0.5 * f) / T**3
    c4 = (-15.0 * d + 7.0 * e - f) / T**4
    c5 = (6.0 * d - 3.0 * e + 0.5 * f) / T**5
    rows: list[list[float]] = np.column_stack([s0, v0, 0.5 * a0, c3, c4, c5]).tolist()
    return rows


def evaluate(c: Sequence[float], t: float) -> Kinematics:
    """Position, speed and acceleration of a quintic at τ = t."""
    c0, c1, c2, c3, c4, c5 = c
    s = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
    v = c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))
    a = 2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5))
    return s, v, a


class KnotMotion:
    """Motion through given knots: times (n), increasing, and [s, v, a] (n, 3)."""

    def __init__(self, times_s: NDArray[np.float64], knots: NDArray[np.float64]) -> None:
        self._times: list[float] = times_s.tolist()
        self._quintics = quintics(np.diff(times_s), knots)
        self.end_s = self._times[-1]

    def at(self, t_s: float) -> Kinematics:
        """[s, v, a] at a time; beyond the ends the outermost polynomial's end is held."""
        t = min(max(t_s, self._times[0]), self._times[-1])
        i = min(bisect_right(self._times, t) - 1, len(self._quintics) - 1)
        return evaluate(self._quintics[i], t - self._times[i])


class Profile:
    """The driver's target speed: straight lines between (time, speed) corners, held before and after them.

    `corner_s` w: how long a change of acceleration takes. The speed is then the moving average of the straight lines over
    ±w/2, v(t) = [S(t + w/2) - S(t - w/2)]/w with S their integral: the jerk is Δa/w in a corner and 0 elsewhere.
    """

    def __init__(self, corners: Sequence[tuple[float, float]], start_m: float, corner_s: float = 0.0) -> None:
        self._t = [t for t, _ in corners]
        self._v = [v for _, v in corners]
        self._a = [(v1 - v0) / (t1 - t0) for (t0, v0), (t1, v1) in pairwise(corners)] + [0.0]
        self._s, self._sum = [start_m], [0.0]
        for (t0, _), (t1, _) in pairwise(corners):
            total, s, _, _ = self._from(len(self._s) - 1, t1 - t0)
            self._s.append(s)
            self._sum.append(total)
        self._corner_s = corner_s
        self._shift_m = 0.0
        self._shift_m = start_m - self.at(0.0)[0] if corner_s else 0.0

    def at(self, t_s: float) -> Kinematics:
        """The target position, speed and acceleration."""
        w = self._corner_s
        if not w:
            return self._sharp(t_s)[1:]
        total0, s0, v0, _ = self._sharp(t_s - 0.5 * w)
        total1, s1, v1, _ = self._sharp(t_s + 0.5 * w)
        return (total1 - total0) / w + self._shift_m, (s1 - s0) / w, (v1 - v0) / w

    def _sharp(self, t_s: float) -> tuple[float, float, float, float]:
        """∫s dt, s, v and a of the straight lines."""
        if t_s < self._t[0]:
            tau, s, v = t_s - self._t[0], self._s[0], self._v[0]
            return tau * (s + 0.5 * v * tau), s + v * tau, v, 0.0
        i = bisect_right(self._t, t_s) - 1
        return self._from(i, t_s - self._t[i])

    def _from(self, i: int, tau: float) -> tuple[float, float, float, float]:
        s, v, a = self._s[i], self._v[i], self._a[i]
        total = self._sum[i] + tau * (s + tau * (0.5 * v + a * tau / 6.0))
        return total, s + tau * (v + 0.5 * a * tau), v + a * tau, a

    def reaches(self, position_m: float) -> float:
        """The time at which a position is reached; infinite if never."""
        low, high = 0.0, max(self._t[-1], 1.0)
        while self.at(high)[0] < position_m:
            low, high = high, 2.0 * high
            if high > 1e7:
                return math.inf
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.at(middle)[0] < position_m else (low, middle)
        return high


class WhiteJerkMotion:
    """A seeded white-jerk path around a profile, on knots every 10 ms, as in the estimator's motion model.

    The deviation d = [δs, δv, δa] from the profile follows d' = [δv, δa, -u + w], w white of density `jerk_psd` (m²/s⁵).
    The driver u = δs/τ³ + 3 δv/τ² + 3 δa/τ steers back with a triple pole at -1/τ (`driver_time_s`; None: no driver),
    so that a long run stays bounded; τ is far longer than a filter's memory and does not disturb it.
    `start_std` (3): the spread of [s, v, a] at time 0 about the profile.
    """

    def __init__(
        self,
        profile: Profile,
        end_s: float,
        jerk_psd: float,
        driver_time_s: float | None,
        start_std: Sequence[float],
        seed: int,
    ) -> None:
        self.end_s = end_s
        self._profile = profile
        self._seed = seed
        self._F = _steered(driver_time_s)
        Q = process_noise(KNOT_S, jerk_psd)
        self._root = np.linalg.cholesky(Q) if jerk_psd > 0.0 else np.zeros((3, 3))
        self._starts: list[list[float]] = [(standard_normal(seed, "start", 3) * np.asarray(start_std)).tolist()]
        self._blocks: dict[int, list[list[float]]] = {}

    def at(self, t_s: float) -> Kinematics:
        """[s, v, a] at a scenario time ≥ 0."""
        block = int(t_s / BLOCK_S)
        rows = self._blocks.get(block)
        if rows is None:
            rows = self._block(block)
        tau = t_s - block * BLOCK_S
        i = min(int(tau / KNOT_S), BLOCK_KNOTS - 1)
        return evaluate(rows[i], tau - i * KNOT_S)

    def _block(self, block: int) -> list[list[float]]:
        while len(self._starts) <= block:
            self._starts.append(self._deviations(len(self._starts) - 1)[-1])
        reference = [self._profile.at(block * BLOCK_S + i * KNOT_S) for i in range(BLOCK_KNOTS + 1)]
        knots = np.array(self._deviations(block)) + np.array(reference)
        rows = quintics(np.full(BLOCK_KNOTS, KNOT_S), knots)
        if len(self._blocks) >= 4:
            del self._blocks[min(self._blocks)]
        self._blocks[block] = rows
        return rows

    def _deviations(self, block: int) -> list[list[float]]:
        noise = (block_rng(self._seed, "jerk", block).standard_normal((BLOCK_KNOTS, 3)) @ self._root.T).tolist()
        (f00, f01, f02), (f10, f11, f12), (f20, f21, f22) = self._F.tolist()
        s, v, a = self._starts[block]
        out = [[s, v, a]]
        for w0, w1, w2 in noise:
            s, v, a = (
                f00 * s + f01 * v + f02 * a + w0,
                f10 * s + f11 * v + f12 * a + w1,
                f20 * s + f21 * v + f22 * a + w2,
            )
            out.append([s, v, a])
        return out


def _steered(driver_time_s: float | None) -> NDArray[np.float64]:
    if driver_time_s is None:
        return transition(KNOT_S)
    k = 1.0 / driver_time_s
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(k**3), -3.0 * k**2, -3.0 * k]]) * KNOT_S
    F, term = np.eye(3), np.eye(3)
    for n in range(1, 12):
        term = term @ A / n
        F = F + term
    return F


def when_at(motion: Motion, position_m: float, from_s: float, to_s: float) -> float | None:
    """The time in [from_s, to_s] at which the train passes a position going forward; None if it does not."""
    low, high = from_s, to_s
    if motion.at(low)[0] > position_m or motion.at(high)[0] < position_m:
        return None
    t = low
    s, v, _ = motion.at(t)
    for _ in range(60):
        # Newton's step where it stays inside the bracket, halving where it does not
        t = t + (position_m - s) / v if v > 1e-6 else 0.5 * (low + high)
        if not low <= t <= high:
            t = 0.5 * (low + high)
        s, v, _ = motion.at(t)
        if abs(s - position_m) < 1e-10:
            break
        low, high = (t, high) if s < position_m else (low, t)
    return t
