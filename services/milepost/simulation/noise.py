"""Seeded noise as a function of (seed, label, index): a restarted process draws the same numbers."""

from __future__ import annotations

import math
import zlib

import numpy as np
from numpy.typing import NDArray

BLOCK = 512


def block_rng(seed: int, label: str, block: int) -> np.random.Generator:
    """The generator of one block of noise."""
    return np.random.default_rng([seed, zlib.crc32(label.encode()), block])


class WhiteNoise:
    """Standard normal numbers by index."""

    def __init__(self, seed: int, label: str) -> None:
        self._seed, self._label = seed, label
        self._block = -1
        self._values: list[float] = []

    def __getitem__(self, index: int) -> float:
        block, place = divmod(index, BLOCK)
        if block != self._block:
            self._values = self._draw(block_rng(self._seed, self._label, block)).tolist()
            self._block = block
        return self._values[place]

    def _draw(self, rng: np.random.Generator) -> NDArray[np.float64]:
        return rng.standard_normal(BLOCK)


class UniformNoise(WhiteNoise):
    """Uniform numbers in [0, 1) by index."""

    def _draw(self, rng: np.random.Generator) -> NDArray[np.float64]:
        return rng.random(BLOCK)


class MarkovNoise:
    """A stationary first-order Markov process of unit variance by index, Δ apart: x ← e^(-Δ/τ) x + √(1 - e^(-2Δ/τ)) w."""

    def __init__(self, seed: int, label: str, step_s: float, time_constant_s: float) -> None:
        self._seed, self._label = seed, label
        self._keep = math.exp(-step_s / time_constant_s)
        self._drive = math.sqrt(-math.expm1(-2.0 * step_s / time_constant_s))
        # the last value before each block: blocks are made in order, each from the end of the one before it
        self._ends = [float(standard_normal(seed, f"{label}.start", 1)[0])]
        self._block = -1
        self._values: list[float] = []

    def __getitem__(self, index: int) -> float:
        block, place = divmod(index, BLOCK)
        if block != self._block:
            while len(self._ends) <= block:
                self._ends.append(self._make(len(self._ends) - 1)[-1])
            self._values, self._block = self._make(block), block
        return self._values[place]

    def _make(self, block: int) -> list[float]:
        keep, drive, x = self._keep, self._drive, self._ends[block]
        out = []
        for w in block_rng(self._seed, self._label, block).standard_normal(BLOCK).tolist():
            x = keep * x + drive * w
            out.append(x)
        return out


class WalkNoise(MarkovNoise):
    """The sum of standard normal numbers up to an index: a random walk from 0."""

    def __init__(self, seed: int, label: str) -> None:
        super().__init__(seed, label, 1.0, math.inf)
        self._drive = 1.0
        self._ends = [0.0]


def standard_normal(seed: int, label: str, size: int) -> NDArray[np.float64]:
    """A few standard normal numbers for one purpose."""
    return block_rng(seed, label, 0).standard_normal(size)
