"""Seeded noise that is a function of (seed, label, index): a restarted process draws what it would have drawn."""

from __future__ import annotations

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
            self._values = block_rng(self._seed, self._label, block).standard_normal(BLOCK).tolist()
            self._block = block
        return self._values[place]


def standard_normal(seed: int, label: str, size: int) -> NDArray[np.float64]:
    """A few standard normal numbers for one purpose."""
    return block_rng(seed, label, 0).standard_normal(size)
