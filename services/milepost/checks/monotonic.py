"""OC-7244: how far the safe rear and the safe front of a train advance beyond the distance that it travelled."""

from __future__ import annotations

import numpy as np

from .published import Array, Flags


def steps_beyond_travelled_m(t_s: Array, speed_mps: Array, heading: Array, bounds: Array, reset: Flags) -> Array:
    """Δ_k = h (b_k - b_{k-1}) - max(0, h ∫v dt) at each epoch k, m, for the rear and the front (K, 2).

    `t_s` and `speed_mps` (K): the epochs and the estimated speeds v, whose integral from epoch k-1 to k (trapezoid) is the
    estimated travelled distance. h: the direction of travel at k-1, ±1 from `heading` (K); where that is 0 (standstill,
    unknown), the last direction before. `bounds` (K, ≥ 2): b is the lower one for the rear of a train that runs forward and for
    the front of one that runs backward, the upper one otherwise. NaN at the first epoch, where no direction is known yet,
    and where an announced `reset` (K) moved the state. Source: OC-7244 of OCORA's LOC-OB.
    """
    out = np.full((len(t_s), 2), np.nan)
    h = last_direction(heading)[:-1]
    travelled = np.maximum(0.0, h * 0.5 * (speed_mps[1:] + speed_mps[:-1]) * np.diff(t_s))
    advance = h[:, None] * np.diff(bounds[:, :2], axis=0)
    rear_first = np.where(h[:, None] > 0.0, advance, advance[:, ::-1])
    out[1:] = np.where((h == 0.0)[:, None] | reset[1:, None], np.nan, rear_first - travelled[:, None])
    return out


def last_direction(heading: Array) -> Array:
    """`heading` (K) with each 0 replaced by the last value before it that is not; 0 where there is none."""
    known = np.maximum.accumulate(np.where(heading != 0.0, np.arange(len(heading)), -1))
    return np.where(known < 0, 0.0, heading[known])
