"""PU-RLS: least squares whose forgetting follows an error model that a particle swarm tunes, with an unscented gain."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from ..layout import Array
from ..scalar import ScalarKernel, Scalars
from .rls import MAX_USEFUL_VARIANCE, SETTLING, LocalParabola
from .swarm import Swarm
from .unscented import unscented_gain_terms

STILL = ScalarKernel(0.0)
LEVEL = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class ForgettingModel:
    """The forgetting factor and a reading's weight from its error.

    With q = e²/S the squared error in units of its expected variance: δ = ν/(ν + q), the share of the reading that is
    signal, 1 where it agrees with what was filtered before; ω = (1 + 1/ν) δ, its weight, which is Student's t with ν
    degrees of freedom; λ = λ_min + (λ_max - λ_min) 2^(-ρ δ q): long memory while stationary, short while not.
    Source: C (8), lost: a reconstruction from its description; that δ damps the error of a noisy reading is ours, for
    without it one outlier empties the memory and is then followed. λ_max < 1 bounds the parabola's lag.
    """

    degrees: float = 4.0
    longest: float = 0.93

    def weight(self, q: float) -> float:
        """ω."""
        return (self.degrees + 1.0) / (self.degrees + q)

    def forgetting(self, q: float, shortest: float, sensitivity: float) -> float:
        """λ for λ_min and ρ."""
        damped = self.degrees * q / (self.degrees + q)
        return float(shortest + (self.longest - shortest) * 2.0 ** (-sensitivity * damped))


@dataclass(frozen=True)
class Tuning:
    """The swarm's limits: `particles` · (`generations` + 1) runs over `window` readings, at every `every`-th reading."""

    particles: int = 6
    generations: int = 2
    window: int = 16
    every: int = 10
    seed: int = 1


class SwarmTunedSmoother:
    """PU-RLS as a pre-filter: smoothed readings z' with the effective variance R_eff.

    A local parabola (see `rls.LocalParabola`) whose gain uses the unscented P x and whose λ and ω follow `ForgettingModel`;
    the swarm chooses (λ_min, ρ) for the least J = Σ η^(n-i) δ_i q_i of one-step errors over the window [C (7); η fixed,
    because with the candidate's own λ as the weight a short memory would always seem best].
    σ² is the scale of Student's t: mean of ω e²/(1 + V_yy). A reading of weight ω has the information
    ω (ν + 1)/((ν + 3) σ²) (Student's Fisher information; ω averages one), and smoothing only spreads information over the
    readings of its memory: 1/R_eff is its mean with the same λ, which is R(1 + 2Σρ_k) for readings of different R.
    Source: C (1)-(12), of which (2), (8)-(10), (12) are lost: a reconstruction.
    """

    DECAY = 0.95

    def __init__(self, start: float, memory: int, model: ForgettingModel, tuning: Tuning) -> None:
        self._model = model
        self._tuning = tuning
        self._swarm = Swarm((0.7, 0.0), (model.longest, 2.0), tuning.particles, tuning.seed)
        self._memory = float(memory)
        self._weight = 0.0
        self._scale = start
        self._precision = 0.0
        self._count = 0
        self._parabola = LocalParabola(unscented_gain_terms)
        self._window: deque[tuple[float, float, Scalars]] = deque(maxlen=tuning.window)
        self.shortest, self.sensitivity = 0.9, 0.2

    @property
    def evaluations(self) -> int:
        """How many runs over a window the swarm has made."""
        return self._swarm.evaluations

    @property
    def variance(self) -> float:
        """R_eff of a reading now."""
        return self._inflation() * self._fisher() / max(self._precision, 1e-12)

    def step(self, dt_s: float, value: float) -> tuple[float, float]:
        """A reading z, `dt_s` after the last: z' and R_eff."""
        parabola = self._parabola
        before = STILL.pack(parabola.w, parabola.P)
        if parabola.advance(dt_s):
            self._window.clear()
        predicted = parabola.predicted()
        useful = predicted.variance < MAX_USEFUL_VARIANCE
        square = (value - predicted.value) ** 2 / (1.0 + predicted.variance)
        q = square / self._scale if useful else 1.0
        weight, factor = self._model.weight(q), self._model.forgetting(q, self.shortest, self.sensitivity)
        smoothed = parabola.learn(predicted, value, factor, weight)
        if useful:
            self._window.append((dt_s, value, before))
            self._weight = min(self._weight + 1.0, self._memory)
            self._scale += (weight * square - self._scale) / max(self._weight, 2.0)
            self._tune()
        gain = max(1.0 - factor, 1.0 / (self._weight + 1.0))
        self._precision += gain * (weight / self._scale - self._precision)
        return smoothed, self.variance

    def _fisher(self) -> float:
        return (self._model.degrees + 3.0) / (self._model.degrees + 1.0)

    def _inflation(self) -> float:
        if self._weight < SETTLING:
            return 1.0 + SETTLING - self._weight
        n = self._weight if self._weight < self._memory else 2.0 * self._memory
        return (n + 2.0) / n

    def _tune(self) -> None:
        self._count += 1
        if self._count % self._tuning.every == 0 and len(self._window) == self._tuning.window:
            # the generations grow with n as in the source, but up to a limit
            generations = min(self._count // self._tuning.every, self._tuning.generations)
            self.shortest, self.sensitivity = self._swarm.minimise(self._cost, generations).tolist()

    def _cost(self, place: Array) -> float:
        shortest, sensitivity = place.tolist()
        state, cost = self._window[0][2], 0.0
        for dt_s, value, _ in self._window:
            s, v, a, *P = STILL.advance(state, dt_s)
            q = (value - s) ** 2 / ((1.0 + P[0]) * self._scale)
            weight = self._model.weight(q)
            cost = self.DECAY * cost + weight * q
            factor = self._model.forgetting(q, shortest, sensitivity)
            state = STILL.update((s, v, a, *(p / factor for p in P)), LEVEL, value, 1.0 / weight)  # type: ignore[arg-type]
        return cost if np.isfinite(cost) else float("inf")
