"""THE TABLE OF SCORES: figures that a scenario may request beside the basic ones, each a function of one estimator's trace."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field

from milepost.checks.figures import figures
from milepost.checks.requirements import CHECKS
from milepost.config.train import Train
from milepost.recordings.options import STRICT, Span

from .recorded_scores import (
    FixesOptions,
    ReacquiredOptions,
    UnitsOptions,
    false_fixes_accepted,
    reacquired_error_m,
    reacquired_outside_interval,
    recorded_scale,
)
from .trace import Array, Trace

Figure = float | list[float] | dict[str, float]
MPS_TO_KMH = 3.6
BASIC = ("position_rms_m", "position_max_m", "position_final_m", "speed_rms_mps", "speed_max_mps", "nees_mean")


class NoOptions(BaseModel):
    """A score without options."""

    model_config = STRICT


class UnitOptions(BaseModel):
    """A score of one unit, at distances from the start of the run."""

    model_config = STRICT
    unit: str
    at_m: list[Annotated[float, Field(gt=0.0)]]


class StatesOptions(BaseModel):
    """A score of private states, `unit.state`."""

    model_config = STRICT
    states: list[str]


class GapsOptions(BaseModel):
    """A score for each named span."""

    model_config = STRICT
    gaps: dict[str, Span]


@dataclass(frozen=True)
class Score:
    """A row: what it computes (None where the estimator has no such thing), its options, and what it needs.

    `more_is_better`: the least of many seeds is the worst. `needs_truth`: it compares the states with the true ones.
    """

    compute: Callable[[Trace, Train, Any], Figure | None]
    options: type[BaseModel] = NoOptions
    more_is_better: bool = False
    needs_truth: bool = True


def basic(trace: Trace, speed_after_s: float) -> dict[str, float]:
    """Root mean square, maximum and final errors; speed counts from `speed_after_s` on.

    `nees_mean` is the mean of e P⁻¹ eᵀ over [s, v, a]: 3 for a consistent estimator. Without a truth: what the estimator
    states of its own errors, and how often it publishes.
    """
    if trace.truth is None:
        found = {key: BASIC_WITHOUT_TRUTH[key](trace) for key in BASIC_WITHOUT_TRUTH}
        return {key: figure for key, figure in found.items() if figure is not None}
    late = trace.t_s >= speed_after_s
    speed = trace.errors[late, 1] if late.any() else trace.errors[:, 1]
    position = np.abs(trace.errors[:, 0])
    figures = (_rms(position), position.max(), position[-1], _rms(speed), np.abs(speed).max(), nees_mean(trace))
    return {key: float(figure) for key, figure in zip(BASIC, figures, strict=True)}


def nees_mean(trace: Trace) -> float:
    """The mean of e P⁻¹ eᵀ over [s, v, a]."""
    scale = np.sqrt(np.einsum("kii->ki", trace.covariance))
    normal = trace.covariance / (scale[:, :, None] * scale[:, None, :])
    e = trace.errors / scale
    return float(np.mean(np.einsum("ki,ki->k", e, np.linalg.solve(normal, e[:, :, None])[:, :, 0])))


def outside_interval(trace: Trace) -> float | None:
    """The fraction of the epochs at which the true position or speed is outside its published interval."""
    if trace.bounds is None:
        return None
    s, v, (low, high, slow, fast) = trace.true_states[:, 0], trace.true_states[:, 1], trace.bounds.T
    return float(np.mean((s < low) | (s > high) | (v < slow) | (v > fast)))


def mean_interval(trace: Trace, low: int) -> float | None:
    """The mean width of a published interval whose lower bound is this column of `bounds`."""
    return None if trace.bounds is None else float(np.mean(trace.bounds[:, low + 1] - trace.bounds[:, low]))


def mean_stated_std(trace: Trace, state: int) -> float:
    """The mean standard deviation that the estimator states of a state."""
    return float(np.mean(np.sqrt(trace.covariance[:, state, state])))


def refresh_hz(trace: Trace) -> float | None:
    """Live states per second, from the first to the last."""
    if trace.sent_s is None or len(trace.sent_s) < 2:
        return None
    return float((len(trace.sent_s) - 1) / (trace.sent_s[-1] - trace.sent_s[0]))


def longest_gap_s(trace: Trace) -> float | None:
    """The longest time between two live states."""
    if trace.sent_s is None or len(trace.sent_s) < 2:
        return None
    return float(np.diff(trace.sent_s).max())


def diameter_error_percent_at_m(trace: Trace, train: Train, options: UnitOptions) -> dict[str, float] | None:
    """The error of the estimated wheel diameter, nominal · (1 + κ̂), in percent of the true one, at distances travelled."""
    scale = trace.private.get(f"{options.unit}.scale")
    if scale is None:
        return None
    true = true_diameter_m(train, options.unit, trace.t_s)
    if true is None:
        return None
    off = 100.0 * np.abs(estimated_diameter_m(train, options.unit, scale) / true - 1.0)
    travelled = trace.travelled_m
    places = {f"{at:g}": int(np.argmax(travelled >= at)) for at in options.at_m if travelled[-1] >= at}
    return {at: float(off[place]) for at, place in places.items()}


def estimated_diameter_m(train: Train, unit: str, scale: Array) -> Array:
    """The diameter at a scale κ: 1 + κ times the diameter in the odometer's options."""
    nominal_m: float = _odometer(train, unit).diameter_m
    return nominal_m * (1.0 + scale)


def true_diameter_m(train: Train, unit: str, t_s: Array) -> Array | None:
    """The simulated wheel's diameter, wear included; None where it is drawn."""
    wheel = _odometer(train, unit).simulated
    return None if wheel.diameter_m is None else wheel.diameter_m - wheel.wear_mps * t_s


def _odometer(train: Train, unit: str) -> Any:
    return train.sensors[unit].options


def gap_error_m(trace: Trace, train: Train, options: GapsOptions) -> dict[str, float]:  # noqa: ARG001
    """The growth of the position error over each gap in the run: |error at its end - error at its start|."""
    first, last = trace.t_s[0], trace.t_s[-1]
    gaps = {name: span for name, span in options.gaps.items() if first <= span[0] and span[1] <= last}
    at = {name: np.interp(span, trace.t_s, trace.errors[:, 0]) for name, span in gaps.items()}
    return {name: float(abs(end - begin)) for name, (begin, end) in at.items()}


def private_at_end(trace: Trace, train: Train, options: StatesOptions) -> list[float] | None:  # noqa: ARG001
    """The private states at the end."""
    if not all(name in trace.private for name in options.states):
        return None
    return [float(trace.private[name][-1]) for name in options.states]


def private_std_at_end(trace: Trace, train: Train, options: StatesOptions) -> list[float] | None:  # noqa: ARG001
    """The standard deviations that the estimator states of the private states at the end."""
    if not all(name in trace.private_std for name in options.states):
        return None
    return [float(trace.private_std[name][-1]) for name in options.states]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _of_errors(column: int, compute: Callable[[Array], Any], factor: float = 1.0) -> Score:
    return Score(lambda trace, train, options: factor * float(compute(trace.errors[:, column])))  # noqa: ARG005


def _of_trace(compute: Callable[[Trace], Figure | None], more_is_better: bool = False, needs_truth: bool = True) -> Score:
    return Score(lambda trace, train, options: compute(trace), NoOptions, more_is_better, needs_truth)  # noqa: ARG005


def _of_check(name: str) -> Score:
    return Score(lambda trace, train, options: figures(name, trace))  # noqa: ARG005


def _mean_size(e: Array) -> float:
    return float(np.mean(np.abs(e)))


def _largest(e: Array) -> float:
    return float(np.abs(e).max())


BASIC_WITHOUT_TRUTH: dict[str, Callable[[Trace], float | None]] = {
    "stated_position_std_m": lambda trace: mean_stated_std(trace, 0),
    "stated_speed_std_mps": lambda trace: mean_stated_std(trace, 1),
    "position_interval_m": lambda trace: mean_interval(trace, 0),
    "speed_interval_mps": lambda trace: mean_interval(trace, 2),
    "refresh_hz": refresh_hz,
}

SCORES: dict[str, Score] = {
    "position_mean_m": _of_errors(0, _mean_size),
    "position_std_m": _of_errors(0, np.std),
    "position_rms_m": _of_errors(0, _rms),
    "position_max_m": _of_errors(0, _largest),
    "position_final_m": _of_errors(0, lambda e: abs(e[-1])),
    "speed_mean_mps": _of_errors(1, _mean_size),
    "speed_std_mps": _of_errors(1, np.std),
    "speed_rms_mps": _of_errors(1, _rms),
    "speed_max_mps": _of_errors(1, _largest),
    "speed_max_kmh": _of_errors(1, _largest, MPS_TO_KMH),
    "nees_mean": _of_trace(nees_mean),
    "outside_interval": _of_trace(outside_interval),
    **{
        key: _of_trace(compute, more_is_better=key == "refresh_hz", needs_truth=False)
        for key, compute in BASIC_WITHOUT_TRUTH.items()
    },
    "longest_gap_s": _of_trace(longest_gap_s, needs_truth=False),
    "diameter_error_percent_at_m": Score(diameter_error_percent_at_m, UnitOptions),
    "gap_error_m": Score(gap_error_m, GapsOptions),
    "private_at_end": Score(private_at_end, StatesOptions, needs_truth=False),
    "private_std_at_end": Score(private_std_at_end, StatesOptions, needs_truth=False),
    "recorded_scale": Score(recorded_scale, UnitsOptions),
    "reacquired_error_m": Score(reacquired_error_m, ReacquiredOptions, needs_truth=False),
    "reacquired_outside_interval": Score(reacquired_outside_interval, ReacquiredOptions, needs_truth=False),
    "false_fixes_accepted": Score(false_fixes_accepted, FixesOptions, needs_truth=False),
    **{name: _of_check(name) for name in CHECKS},
}
