"""The run of one estimator as arrays, beside the truth where there is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from milepost.estimation.layout import N_COMMON
from milepost.estimation.time_units import S_PER_NS
from milepost_schemas import FusedState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """K epochs of an estimator: those that it shares with the truth, or all of them where there is no truth.

    `t_s` (K) scenario time, `states` and `truth` (K, 3) of [s, v, a], `covariance` (K, 3, 3). Where there are messages:
    `bounds` (K, 4), the published position and speed intervals; `shares` by unit (K); `sent_s`, when live states were sent;
    `counted` by unit, the times of the observations that reached the fuser, within any window or not.
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
        return replace(
            self,
            t_s=self.t_s[inside],
            states=self.states[inside],
            truth=None if self.truth is None else self.truth[inside],
            covariance=self.covariance[inside],
            bounds=None if self.bounds is None else self.bounds[inside],
            shares={name: values[inside] for name, values in self.shares.items()},
            private={name: values[inside] for name, values in self.private.items()},
            private_std={name: values[inside] for name, values in self.private_std.items()},
        )


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
) -> Trace:
    """A trace of a fuser's messages: `states` are scored, `live` gives the times of sending, `private` the private states.

    Raises ValueError as `trace_of_beliefs` does.
    """
    beliefs = {at: ((s.position_m, s.speed_mps, s.acceleration_mps2), s.covariance) for at, s in states.items()}
    trace = trace_of_beliefs(beliefs, truth, start_ns)
    chosen = [states[at] for at in _shared(states, truth)]
    shares = [{sensor.unit: sensor.share for sensor in state.sensors} for state in chosen]
    means, deviations = _between(private, trace.t_s, start_ns)
    own = list(enumerate(names[N_COMMON:])) if private else []
    return replace(
        trace,
        bounds=np.array([(s.position_min_m, s.position_max_m, s.speed_min_mps, s.speed_max_mps) for s in chosen]),
        sent_s=np.array([(s.published_at_ns - start_ns) * S_PER_NS for s in live.values()]),
        shares={unit: np.array([row.get(unit, 0.0) for row in shares]) for unit in sorted({u for row in shares for u in row})},
        private={name: means[i] for i, name in own},
        private_std={name: deviations[i] for i, name in own},
    )


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
