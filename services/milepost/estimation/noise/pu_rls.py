"""PU-RLS: least squares whose forgetting follows an error model that a particle swarm tunes, with an unscented gain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..layout import Array
from ..scalar import ScalarKernel
from .learner import Flags, Judged, Seen, kept_where
from .rls import MAX_USEFUL_VARIANCE, Parabola, inflation, linear_gain_terms
from .swarm import Particles, Swarm
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

    def weight(self, q: Array) -> Array:
        """ω."""
        return (self.degrees + 1.0) / (self.degrees + q)

    def forgetting(self, q: Array, shortest: Array, sensitivity: Array) -> Array:
        """λ for λ_min and ρ."""
        damped = self.degrees * q / (self.degrees + q)
        return np.asarray(shortest + (self.longest - shortest) * 2.0 ** (-sensitivity * damped))


@dataclass(frozen=True)
class Tuning:
    """The swarm's limits: `particles` · (`generations` + 1) runs over `window` readings, at every `every`-th reading."""

    particles: int = 6
    generations: int = 2
    window: int = 16
    every: int = 10
    seed: int = 1


def gain_terms(mean: Array, covariance: Array, observe: Callable[[Array], Array]) -> tuple[Array, Array, Array]:
    """The unscented terms; the linear ones, which they equal here, where rounding has left a P that has no root."""
    try:
        return unscented_gain_terms(mean, covariance, observe)
    except np.linalg.LinAlgError:
        return linear_gain_terms(mean, covariance, observe)


class Window(NamedTuple):
    """The last readings of m smoothers, `filled` (m) of k: `steps` (m, k, 11) of dt, z and the scalars of w and P before."""

    steps: Array
    filled: Array

    def extended(self, dt_s: float, value: Array, before: Parabola, where: Flags) -> Window:
        """With one reading more `where` (m) it counts."""
        (p00, p01, p02), (_, p11, p12), (_, _, p22) = before.P.transpose(1, 2, 0)
        columns = (dt_s, value, *before.w.T, p00, p01, p02, p11, p12, p22)
        last = np.stack(np.broadcast_arrays(*columns), axis=1)[:, None]
        longer = np.concatenate([np.broadcast_to(self.steps, (len(last), *self.steps.shape[1:]))[:, 1:], last], axis=1)
        filled = np.minimum(self.filled + 1, self.steps.shape[1])
        window: Window = kept_where(~where, self, Window(longer, filled))
        return window


class Tuned(NamedTuple):
    """The memory of m smoothers: σ², mean precision, weight and number of readings (m); λ_min and ρ, the best so far (m, 2)."""

    parabola: Parabola
    scale: Array
    precision: Array
    weight: Array
    readings: Array
    best: Array
    window: Window
    particles: Particles


class SwarmTunedSmoother:
    """PU-RLS as a pre-filter: smoothed readings z' with the effective variance R_eff.

    A local parabola (see `rls.Parabola`) whose gain uses the unscented P x and whose λ and ω follow `ForgettingModel`;
    the swarm chooses (λ_min, ρ) for the least J = Σ η^(n-i) δ_i q_i of one-step errors over the window [C (7); η fixed,
    because with the candidate's own λ as the weight a short memory would always seem best].
    σ² is the scale of Student's t: mean of ω e²/(1 + V_yy). A reading of weight ω has the information
    ω (ν + 1)/((ν + 3) σ²) (Student's Fisher information; ω averages one), and smoothing only spreads information over the
    readings of its memory: 1/R_eff is its mean with the same λ, which is R(1 + 2Σρ_k) for readings of different R.
    Source: C (1)-(12), of which (2), (8)-(10), (12) are lost: a reconstruction.
    """

    needs_belief: ClassVar[bool] = False
    DECAY = 0.95

    def __init__(self, memory: int, model: ForgettingModel, tuning: Tuning) -> None:
        self._memory, self._model, self._tuning = float(memory), model, tuning
        self._swarm = Swarm((0.7, 0.0), (model.longest, 2.0), tuning.particles, tuning.seed)

    def begin(self, variance: Array) -> Tuned:
        """σ² is the stated R; λ_min 0.9, ρ 0.2."""
        m = len(variance)
        zeros, count = np.zeros(m), np.zeros(m, dtype=int)
        best, window = np.tile((0.9, 0.2), (m, 1)), Window(np.zeros((m, self._tuning.window, 11)), count)
        return Tuned(Parabola.begin(m), variance, zeros, zeros, count, best, window, self._swarm.begin(m))

    def take(self, memory: Tuned, dt_s: float, seen: Seen) -> tuple[Judged, Tuned]:
        """The smoothed reading and R_eff."""
        before, (parabola, lost) = memory.parabola, memory.parabola.advanced(dt_s)
        window = memory.window._replace(filled=np.where(lost, 0, memory.window.filled))
        predicted = parabola.predicted(gain_terms)
        useful = predicted.variance < MAX_USEFUL_VARIANCE
        square = (seen.value - predicted.value) ** 2 / (1.0 + predicted.variance)
        q = np.where(useful, square / memory.scale, 1.0)
        weight, factor = self._model.weight(q), self._model.forgetting(q, *memory.best.T)
        parabola = parabola.taught(predicted, seen.value, factor, weight)
        n = np.where(useful, np.minimum(memory.weight + 1.0, self._memory), memory.weight)
        step = (weight * square - memory.scale) / np.maximum(n, 2.0)
        scale = np.where(useful, memory.scale + step, memory.scale)
        gain = np.maximum(1.0 - factor, 1.0 / (n + 1.0))
        precision = memory.precision + gain * (weight / scale - memory.precision)
        window = window.extended(dt_s, seen.value, before, useful)
        after = Tuned(parabola, scale, precision, n, memory.readings + useful, memory.best, window, memory.particles)
        after = self._tuned(after, useful)
        return Judged(parabola.w[:, 0], self._variance(after)), after

    def judge(self, memory: Tuned, seen: Seen) -> Judged:
        """The reading unchanged, with R_eff."""
        return Judged(seen.value, self._variance(memory))

    def _variance(self, memory: Tuned) -> Array:
        fisher = (self._model.degrees + 3.0) / (self._model.degrees + 1.0)
        return inflation(memory.weight, self._memory) * fisher / np.maximum(memory.precision, 1e-12)

    def _tuned(self, memory: Tuned, useful: Flags) -> Tuned:
        """With the λ_min and ρ that suit the window best, where it is their turn."""
        turn = memory.readings // self._tuning.every
        due = useful & (memory.readings % self._tuning.every == 0) & (memory.window.filled == self._tuning.window)
        if not due.any():
            return memory
        # the generations grow with n as in the source, but up to a limit
        generations = np.minimum(turn, self._tuning.generations)
        best, particles = self._swarm.search(memory.particles, lambda p: self._cost(memory, p), turn, generations)
        tuned: Tuned = kept_where(~due, memory, memory._replace(best=best, particles=particles))
        return tuned

    def _cost(self, memory: Tuned, places: Array) -> Array:
        """J (m, particles) of λ_min and ρ at places (m, particles, 2)."""
        shortest, sensitivity = places[..., 0], places[..., 1]
        steps = memory.window.steps.transpose(1, 2, 0)[..., None]
        scale, cost = memory.scale[:, None], np.zeros(places.shape[:-1])
        state: Any = tuple(steps[0, 2:])
        with np.errstate(all="ignore"):
            for dt_s, value in steps[:, :2]:
                s, v, a, *P = STILL.advance(state, dt_s)
                q = (value - s) ** 2 / ((1.0 + P[0]) * scale)
                weight: Any = self._model.weight(q)
                cost = self.DECAY * cost + weight * q
                factor = self._model.forgetting(q, shortest, sensitivity)
                state = (s, v, a, *(p / factor for p in P))
                state = STILL.update(state, LEVEL, value, 1.0 / weight)
            return np.where(np.isfinite(cost), cost, np.inf)
