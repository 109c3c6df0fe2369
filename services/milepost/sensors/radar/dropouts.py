"""Drop-outs of a sensor: at random times, or at known places."""

from __future__ import annotations

from milepost.simulation.noise import block_rng

# a block is this many mean durations long: a stretch from before the block before is still on with probability e^-100
BLOCK_DURATIONS = 100.0


class Dropouts:
    """Random drop-outs: they begin as a Poisson process, and their durations are exponential.

    `rate_hz` of beginnings λ, `mean_s` duration D: the device is silent for the share 1 - exp(-λ D) of all time. A function of
    (seed, label, time), stationary from time 0 on.
    """

    def __init__(self, seed: int, label: str, rate_hz: float, mean_s: float) -> None:
        self._seed, self._label = seed, f"{label}.dropouts"
        self._rate, self._mean = rate_hz, mean_s
        self._length_s = BLOCK_DURATIONS * mean_s
        self._block = -1
        self._stretches: list[tuple[float, float]] = []

    def at(self, t_s: float) -> bool:
        """Whether the device is silent at a scenario time ≥ 0."""
        if self._rate == 0.0:
            return False
        block = int(t_s // self._length_s) + 1
        if block != self._block:
            self._stretches, self._block = self._make(block - 1) + self._make(block), block
        return any(begin <= t_s < end for begin, end in self._stretches)

    def _make(self, block: int) -> list[tuple[float, float]]:
        rng = block_rng(self._seed, self._label, block)
        count = int(rng.poisson(self._rate * self._length_s))
        begins = (block - 1 + rng.random(count)) * self._length_s
        return list(zip(begins.tolist(), (begins + rng.exponential(self._mean, count)).tolist(), strict=True))


def within(position_m: float, spans_m: list[list[float]]) -> bool:
    """Whether a position lies in one of the spans [from, to)."""
    return any(begin <= position_m < end for begin, end in spans_m)
