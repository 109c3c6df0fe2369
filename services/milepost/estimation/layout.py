"""The order of the states: the common states [s, v, a], then a block of private states for each unit."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COMMON = ("position_m", "speed_mps", "acceleration_mps2")
N_COMMON = len(COMMON)
PLACES_OF_COMMON = (0, 1, 2)


@dataclass(frozen=True, slots=True)
class PrivateState:
    """A state that only one unit observes, such as a scale or a bias: first-order Markov p' = -p/τ + w, w of density q.

    `prior_mean`, `prior_std`: in the state's own unit. `time_constant_s` τ: infinite makes it a random walk.
    `noise_psd` q: in unit²/s. `scales_motion`: its unit reads the motion over 1 + p, see `gaussian.stretched`.
    """

    name: str
    prior_mean: float
    prior_std: float
    time_constant_s: float = math.inf
    noise_psd: float = 0.0
    scales_motion: bool = False


@dataclass(frozen=True)
class Layout:
    """The order of all states: [s, v, a, block of unit 1, block of unit 2, ...].

    `private`: all private states, in order; `dimension` n; `names`: the common ones, then `unit.state`; `indices`: for each
    unit with a block, the places of [s, v, a, its own]; `scales`: the place of each unit's state that scales the motion;
    `changing`: the private states that are not constants, each with its place; `identity` (n, n).
    """

    blocks: tuple[tuple[str, tuple[PrivateState, ...]], ...] = ()
    private: tuple[PrivateState, ...] = field(init=False, repr=False, compare=False)
    dimension: int = field(init=False, repr=False, compare=False)
    names: list[str] = field(init=False, repr=False, compare=False)
    indices: dict[str, tuple[int, ...]] = field(init=False, repr=False, compare=False)
    scales: dict[str, int] = field(init=False, repr=False, compare=False)
    changing: tuple[tuple[int, PrivateState], ...] = field(init=False, repr=False, compare=False)
    identity: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        places: dict[str, tuple[int, ...]] = {}
        scales: dict[str, int] = {}
        names = list(COMMON)
        for unit, states in self.blocks:
            scales.update((unit, len(names) + place) for place, state in enumerate(states) if state.scales_motion)
            places[unit] = (0, 1, 2, *range(len(names), len(names) + len(states)))
            names += [f"{unit}.{state.name}" for state in states]
        private = tuple(state for _, states in self.blocks for state in states)
        constant = [state.time_constant_s == math.inf and state.noise_psd == 0.0 for state in private]
        changing = tuple((i, s) for i, (s, c) in enumerate(zip(private, constant, strict=True), N_COMMON) if not c)
        object.__setattr__(self, "private", private)
        object.__setattr__(self, "changing", changing)
        object.__setattr__(self, "dimension", len(names))
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "identity", np.eye(len(names)))
        object.__setattr__(self, "indices", places)
        object.__setattr__(self, "scales", scales)

    def only(self, units: Iterable[str]) -> Layout:
        """The layout that holds the blocks of these units alone."""
        wanted = set(units)
        return Layout(tuple(block for block in self.blocks if block[0] in wanted))

    def lift(self, unit: str, row: tuple[float, ...]) -> tuple[float, ...]:
        """A row h over [s, v, a, own private] as a row over all states. Raises ValueError where the size does not fit."""
        places = self.indices.get(unit, PLACES_OF_COMMON)
        if len(row) != len(places):
            raise ValueError(f"{unit}: a row has {len(places)} entries here, not {len(row)}")
        if len(row) == self.dimension:
            return row
        full = [0.0] * self.dimension
        for place, value in zip(places, row, strict=True):
            full[place] = value
        return tuple(full)

    def prior(self, common_mean: Array, common_std: Array) -> tuple[Array, Array]:
        """The prior over all states: mean (n), covariance (n x n, diagonal)."""
        mean = np.array([*common_mean, *(state.prior_mean for state in self.private)], dtype=float)
        std = np.array([*common_std, *(state.prior_std for state in self.private)], dtype=float)
        return mean, np.diag(std**2)
