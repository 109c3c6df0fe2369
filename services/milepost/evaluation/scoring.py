"""How good an estimator was: errors against the truth, consistency, and fixes that it never saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from milepost.estimation.track import Line
from milepost.simulation.recording import RecordedFix
from milepost_schemas import FusedState

Array = NDArray[np.float64]
Estimates = Mapping[int, tuple[Any, Any]]


def score(estimates: Estimates, truth: Mapping[int, Sequence[float]], start_ns: int, speed_after_s: float) -> dict[str, float]:
    """Root mean square, maximum and final errors of one estimator over all epochs that it and the truth share.

    `estimates`: epoch → mean (3), covariance (3, 3); `truth`: epoch → [s, v, a]. Speed counts from `speed_after_s` on.
    `nees_mean` is the mean of e P⁻¹ eᵀ over [s, v, a]: 3 for a consistent estimator.
    """
    epochs = sorted(set(estimates) & set(truth))
    if not epochs:
        raise ValueError("no epoch has both an estimate and a truth")
    errors = np.array([np.asarray(estimates[k][0])[:3] - np.asarray(truth[k]) for k in epochs])
    covariances = np.array([np.asarray(estimates[k][1])[:3, :3] for k in epochs])
    scale = np.sqrt(np.einsum("kii->ki", covariances))
    normal = covariances / (scale[:, :, None] * scale[:, None, :])
    e = errors / scale
    nees = np.einsum("ki,ki->k", e, np.linalg.solve(normal, e[:, :, None])[:, :, 0])
    late = np.array([(k - start_ns) * 1e-9 >= speed_after_s for k in epochs])
    speed = errors[late, 1] if late.any() else errors[:, 1]
    return {
        "position_rms_m": float(np.sqrt(np.mean(errors[:, 0] ** 2))),
        "position_max_m": float(np.abs(errors[:, 0]).max()),
        "position_final_m": float(abs(errors[-1, 0])),
        "speed_rms_mps": float(np.sqrt(np.mean(speed**2))),
        "speed_max_mps": float(np.abs(speed).max()),
        "nees_mean": float(np.mean(nees)),
    }


def largest_difference_in_sigmas(ours: Estimates, reference: Estimates) -> float:
    """The largest difference of two estimators' states, in the reference's standard deviations."""
    shared = sorted(set(ours) & set(reference))
    difference = np.array([np.asarray(ours[k][0])[:3] - np.asarray(reference[k][0])[:3] for k in shared])
    sigma = np.sqrt(np.array([np.diag(np.asarray(reference[k][1]))[:3] for k in shared]))
    return float(np.abs(difference / sigma).max())


def score_withheld(
    states: Mapping[int, FusedState], fixes: Sequence[RecordedFix], line: Line, start_ns: int, period_ns: int
) -> dict[str, float | int]:
    """Withheld fixes against the state: the epoch before each, carried to its time by its own speed and acceleration."""
    if line.track is None:
        raise ValueError("withheld fixes need a line with geometry")
    worst, outside = 0.0, 0
    for fix in fixes:
        at = start_ns + round(fix.t_s * 1e9)
        state = states[at // period_ns * period_ns]
        t = (at - state.measured_at_ns) * 1e-9
        moved = t * (state.speed_mps + 0.5 * t * state.acceleration_mps2)
        position = line.track.project(fix.latitude_deg, fix.longitude_deg).position_m
        worst = max(worst, abs(state.position_m + moved - position))
        outside += not state.position_min_m <= position - moved <= state.position_max_m
    return {"withheld_fixes": len(fixes), "withheld_max_m": worst, "withheld_outside_interval": outside}
