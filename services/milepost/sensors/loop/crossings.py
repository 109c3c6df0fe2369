"""The loop as it lies along the track: where it crosses, and where an antenna sees nothing of that."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from milepost.estimation.layout import Array
from milepost.simulation.noise import BLOCK, WhiteNoise, block_rng


class Crossings:
    """Where the loop crosses: crossing k lies at k p + Σ errors of the pitches before it, a fixed property of the track."""

    def __init__(self, seed: int, unit: str, pitch_m: float, pitch_std_m: float) -> None:
        self._seed, self._unit, self._pitch, self._std = seed, unit, pitch_m, pitch_std_m
        self._block_starts = [0.0]
        self._block = -1
        self._positions: list[float] = []

    def position(self, k: int) -> float:
        """The position of crossing k ≥ 0; crossings below 0 lie on the bare pitch."""
        if k < 0:
            return k * self._pitch
        block, place = divmod(k, BLOCK)
        if block != self._block:
            while len(self._block_starts) <= block:
                n = len(self._block_starts) - 1
                self._block_starts.append(self._block_starts[n] + float(self._pitches(n).sum()))
            starts = np.concatenate([[0.0], np.cumsum(self._pitches(block)[:-1])])
            self._positions = (self._block_starts[block] + starts).tolist()
            self._block = block
        return self._positions[place]

    def _pitches(self, block: int) -> Array:
        return self._pitch + self._std * block_rng(self._seed, self._unit, block).standard_normal(BLOCK)

    def last_before(self, position_m: float) -> int:
        """The number of the last crossing at or before a position."""
        k = math.floor(position_m / self._pitch)
        while self.position(k) > position_m:
            k -= 1
        while self.position(k + 1) <= position_m:
            k += 1
        return k


class Unseen:
    """Which crossings an antenna does not see: none in the joints [j E, j E + L), j ≥ 1, and each other with probability q.

    `label` names the antenna: two of them miss different crossings, but lack the same joints.
    """

    def __init__(
        self, seed: int, label: str, pitch_m: float, missed: float, joint_every_m: float | None, joint_m: float
    ) -> None:
        self._pitch, self._joint_every, self._joint = pitch_m, joint_every_m, joint_m
        self._noise = WhiteNoise(seed, f"{label}.missed")
        self._below = NormalDist().inv_cdf(missed) if missed > 0.0 else -math.inf
        self._never = missed == 0.0 and joint_every_m is None

    def __contains__(self, k: int) -> bool:
        if self._never or k < 0:
            return False
        if self._joint_every is not None:
            joint, into = divmod(k * self._pitch + 1e-9, self._joint_every)
            if joint >= 1.0 and into < self._joint:
                return True
        return self._noise[k] < self._below
