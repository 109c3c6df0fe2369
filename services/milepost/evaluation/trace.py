"""The run of one estimator as arrays, beside the truth where there is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from milepost.checks.monotonic import steps_beyond_travelled_m
from milepost.estimation.layout import N_COMMON
from milepost.estimation.time_units import S_PER_NS
from milepost_schemas import FusedState

Array = NDArray[np.float64]
# standard deviations within which 95 % of a normal distribution lie
SIGMAS_OF_95 = 1.959964
HEADING = {"forward": 1.0, "backward": -1.0}
PER_EPOCH = (
    "t_s",
    "states",
    "covariance",
    "truth",
    "bounds",
    "accuracy",
    "since_balise_m",
    "location_accuracy_m",
    "lost",
    "steps_m",
)
PER_EPOCH_BY_NAME = ("shares", "private", "private_std")


@dataclass(frozen=True)
class Trace:
    """K epochs of an estimator: those that it shares with the truth, or all of them where there is no truth.

    `t_s` (K) scenario time, `states` and `truth` (K, 3) of [s, v, a], `covariance` (K, 3, 3). Where there are messages:
    `bounds` (K, 4), the published position and speed intervals; `shares` by unit (K); `sent_s`, when live states were sent,
    `stamps_s`, what times they were about, and `counted` by unit, the times of the observations that reached the fuser: these
    three within any window or not. What the checks look at is in `checks.published`.
    `private` and `private_std` (K), by `unit.state`.
    """

    t_s: Array
    states: Array
    covariance: Array
    truth: Array | None = None
    bounds: Array | None = None
    sent_s: Array | None = None
    counted: Mapping[str, Array] = field(default_factory=dict)
    shares: Mapping[str, Array] = field(default_factory=dict)
    private: Mapping[str, Array] = field(default_factory=dict)
    private_std: Mapping[str, Array] = field(default_factory=dict)
    accuracy: Array | None = None
    since_balise_m: Array | None = None
    location_accuracy_m: Array | None = None
    lost: NDArray[np.bool_] | None = None
    steps_m: Array | None = None
    stamps_s: Array | None = None

    @property
    def true_states(self) -> Array:
        """The truth (K, 3) of [s, v, a]. Raises ValueError where there is none."""
        if self.truth is None:
            raise ValueError("there is no truth")
        return self.truth

    @cached_property
    def errors(self) -> Array:
        """States less truth (K, 3). Raises ValueError where there is no truth."""
        return self.states - self.true_states

    @property
    def travelled_m(self) -> Array:
        """The distance from the first epoch (K): the true one, or the estimated one where there is no truth."""
        s = (self.states if self.truth is None else self.truth)[:, 0]
        travelled: Array = np.abs(s - s[0])
        return travelled

    def within(self, inside: Any) -> Trace:
        """The epochs for which `inside` (K booleans) is true."""
        columns = {name: getattr(self, name) for name in PER_EPOCH}
        kept: dict[str, Any] = {name: column[inside] for name, column in columns.items() if column is not None}
        for group in PER_EPOCH_BY_NAME:
            kept[group] = {name: values[inside] for name, values in getattr(self, group).items()}
        return replace(self, **kept)


def trace_of_beliefs(
    beliefs: Mapping[int, tuple[Any, Any]], truth: Mapping[int, Sequence[float]], start_ns: int, names: Sequence[str] = ()
) -> Trace:
    """A trace of epoch → (mean (n), covariance (n, n)); `names` of all n states, where there are private ones.

    An empty `truth` is none. Raises ValueError where no epoch has an estimate and, where there is one, a truth.
    """
    epochs = _shared(beliefs, truth)
    if not epochs:
        raise ValueError("no epoch has both an estimate and a truth")
    means = np.array([beliefs[k][0] for k in epochs])
    covariances = np.array([beliefs[k][1] for k in epochs])
    columns = {name: i for i, name in enumerate(names) if i >= N_COMMON}
    return Trace(
        (np.array(epochs) - start_ns) * S_PER_NS,
        means[:, :N_COMMON],
        covariances[:, :N_COMMON, :N_COMMON],
        np.array([truth[k] for k in epochs]) if truth else None,
        private={name: means[:, i] for name, i in columns.items()},
        private_std={name: np.sqrt(covariances[:, i, i]) for name, i in columns.items()},
    )


def _shared(estimates: Mapping[int, Any], truth: Mapping[int, Any]) -> list[int]:
    return sorted(set(estimates) & set(truth)) if truth else sorted(estimates)


def trace_of_states(
    states: Mapping[int, FusedState],
    truth: Mapping[int, Sequence[float]],
    start_ns: int,
    live: Mapping[int, FusedState],
    private: Mapping[int, tuple[list[float], list[float]]],
    names: Sequence[str],
    location_accuracy_m: Mapping[str, float],
) -> Trace:
    """A trace of a fuser's messages: `states` are scored, `live` gives the times of sending, `private` the private states.

    `location_accuracy_m` by balise. Where states do not say how accurate they are without faults, their covariance does.
    Raises ValueError as `trace_of_beliefs` does.
    """
    beliefs = {at: ((s.position_m, s.speed_mps, s.acceleration_mps2), s.covariance) for at, s in states.items()}
    trace = trace_of_beliefs(beliefs, truth, start_ns)
    chosen = [states[at] for at in _shared(states, truth)]
    shares = [{sensor.unit: sensor.share for sensor in state.sensors} for state in chosen]
    means, deviations = _between(private, trace.t_s, start_ns)
    own = list(enumerate(names[N_COMMON:])) if private else []
    bounds = np.array([(s.position_min_m, s.position_max_m, s.speed_min_mps, s.speed_max_mps) for s in chosen])
    heading = np.array([HEADING.get(s.direction, 0.0) for s in chosen])
    reset = np.array([getattr(s, "reset", None) is not None for s in chosen])
    passed = [s.last_balise for s in chosen]
    return replace(
        trace,
        bounds=bounds,
        accuracy=np.array([_accuracy(s) for s in chosen]),
        since_balise_m=np.array([np.nan if each is None else each.distance_since_m for each in passed]),
        location_accuracy_m=np.array(
            [0.0 if each is None else location_accuracy_m.get(each.balise_id, 0.0) for each in passed]
        ),
        lost=np.array([s.status == "lost" for s in chosen]),
        steps_m=steps_beyond_travelled_m(trace.t_s, trace.states[:, 1], heading, bounds, reset),
        stamps_s=np.array([(s.measured_at_ns - start_ns) * S_PER_NS for s in live.values()]),
        sent_s=np.array([(s.published_at_ns - start_ns) * S_PER_NS for s in live.values()]),
        shares={unit: np.array([row.get(unit, 0.0) for row in shares]) for unit in sorted({u for row in shares for u in row})},
        private={name: means[i] for i, name in own},
        private_std={name: deviations[i] for i, name in own},
    )


def _accuracy(state: FusedState) -> tuple[float, float]:
    """The errors that position and speed stay within at 95 % of the epochs, without faults."""
    stated = getattr(state, "position_accuracy_m", None), getattr(state, "speed_accuracy_mps", None)
    position, speed = (
        SIGMAS_OF_95 * state.covariance[i][i] ** 0.5 if accuracy is None else accuracy for i, accuracy in enumerate(stated)
    )
    return position, speed


def _between(
    private: Mapping[int, tuple[list[float], list[float]]], t_s: Array, start_ns: int
) -> tuple[list[Array], list[Array]]:
    """Means and standard deviations (K) of each private state, linear between the epochs that sent feedback."""
    epochs_s = [(at - start_ns) * S_PER_NS for at in private]
    columns = np.array(list(private.values())).transpose(1, 2, 0) if private else np.empty((2, 0, 0))
    return [np.interp(t_s, epochs_s, m) for m in columns[0]], [np.interp(t_s, epochs_s, np.sqrt(v)) for v in columns[1]]


def largest_difference_in_sigmas(ours: Trace, reference: Trace) -> float:
    """The largest difference of two estimators' states, in the reference's standard deviations."""
    _, mine, theirs = np.intersect1d(ours.t_s, reference.t_s, return_indices=True)
    sigma = np.sqrt(np.einsum("kii->ki", reference.covariance[theirs]))
    return float(np.abs((ours.states[mine] - reference.states[theirs]) / sigma).max())
