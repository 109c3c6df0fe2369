"""Whether two fusers say the same of an epoch."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from milepost.estimation.layout import N_COMMON
from milepost_schemas import Candidate, Feedback, FusedState

# the numbers that are compared, by the field of the tolerance
NUMBERS = {
    "position_m": ("position_m", "position_accuracy_m"),
    "speed_mps": ("speed_mps", "speed_accuracy_mps"),
    "interval_m": ("position_min_m", "position_max_m"),
    "interval_mps": ("speed_min_mps", "speed_max_mps"),
}
SAME = ("epoch", "line", "line_hash", "status", "settled")
# of latitude; a degree of longitude is shorter, so the same tolerance in degrees is no more metres
METRES_A_DEGREE = 111_700.0


@dataclass(frozen=True, slots=True)
class Tolerance:
    """By how much two that agree may differ.

    `position_m` and `speed_mps`: of the estimate and of its accuracy. `interval_m` and `interval_mps`: of the ends of the
    intervals; the outer ones are published, so that neither of the two narrows what the other says. `sigmas`: of every other
    state that is fed back, and of the covariances, in the smaller standard deviation that the two state.
    """

    position_m: float
    speed_mps: float
    interval_m: float
    interval_mps: float
    sigmas: float


def difference(a: Candidate, b: Candidate, tolerance: Tolerance) -> str | None:
    """The first difference beyond the tolerance, in words; None where two candidates agree.

    Two that have not heard the same units in time, as on a busy machine, say different things, and neither is wrong: there each
    estimate must lie in the other's interval. Of the units out of use those are compared that are said to be wrong, not why.
    Not compared: `last_balise` where one has none.
    """
    return state_difference(a.state, b.state, tolerance) or feedback_difference(
        a.feedback, b.feedback, tolerance, not_heard(a.state) == not_heard(b.state)
    )


def not_heard(state: FusedState) -> frozenset[str]:
    """The units whose readings a fuser still awaits; not those that it excludes, which may be a fault of its own."""
    return frozenset(state.awaiting)


def better_heard(one: Candidate, other: Candidate) -> tuple[Candidate, Candidate]:
    """The two, the one that has heard more units first; as given where that is the same."""
    return (one, other) if len(not_heard(one.state)) <= len(not_heard(other.state)) else (other, one)


def state_difference(one: FusedState, other: FusedState, tolerance: Tolerance) -> str | None:
    """The same of two states."""
    differences = (
        _contradictions(one, other) if not_heard(one) != not_heard(other) else _state_differences(one, other, tolerance)
    )
    return next(differences, None)


def feedback_difference(
    one: Feedback | None, other: Feedback | None, tolerance: Tolerance, same_heard: bool = True
) -> str | None:
    """The same of two feedbacks; their intervals are those of the states.

    Without `same_heard` what their states say of the train's motion is left to these.
    """
    if one is None or other is None:
        return None if one is other else "feedback of one alone"
    return next(_feedback_differences(one, other, tolerance, 0 if same_heard else N_COMMON), None)


def outer_interval(one: FusedState | Feedback, other: FusedState | Feedback) -> dict[str, float]:
    """The interval that holds those of both, as fields of a message."""
    fields = {name: min(getattr(one, name), getattr(other, name)) for name in ("position_min_m", "speed_min_mps")}
    return fields | {name: max(getattr(one, name), getattr(other, name)) for name in ("position_max_m", "speed_max_mps")}


def _state_differences(one: FusedState, other: FusedState, t: Tolerance) -> Iterator[str]:
    for name in SAME:
        if (left := getattr(one, name)) != (right := getattr(other, name)):
            yield f"{name} {left} and {right}"
    # what merely says nothing in time may be heard by one and not by the other
    judged = ("excluded", one.said_wrong, other.said_wrong), ("doubted", frozenset(one.doubted), frozenset(other.doubted))
    for name, left, right in judged:
        if left != right:
            yield f"{name} {_listed(left)} and {_listed(right)}"
    if one.last_balise and other.last_balise and one.last_balise.balise_id != other.last_balise.balise_id:
        yield f"last_balise {one.last_balise.balise_id} and {other.last_balise.balise_id}"
    for field, names in NUMBERS.items():
        most = getattr(t, field)
        for name in names:
            apart = abs(getattr(one, name) - getattr(other, name))
            # written so that a NaN is a difference
            if not apart <= most:
                yield f"{name} differs by {apart:.3g}"
    for name in ("latitude_deg", "longitude_deg"):
        left, right = getattr(one, name), getattr(other, name)
        if (left is None) != (right is None) or (left is not None and not abs(left - right) * METRES_A_DEGREE <= t.position_m):
            yield f"{name} {left} and {right}"
    yield from _matrix("covariance", one.covariance, other.covariance, t.sigmas)


def _listed(units: frozenset[str]) -> str:
    return ", ".join(sorted(units)) or "none"


def _contradictions(one: FusedState, other: FusedState) -> Iterator[str]:
    """Where two that have heard different units cannot both be right."""
    for name in ("epoch", "line", "line_hash"):
        if (left := getattr(one, name)) != (right := getattr(other, name)):
            yield f"{name} {left} and {right}"
    for a, b in ((one, other), (other, one)):
        for name in ("position", "speed"):
            unit = "m" if name == "position" else "mps"
            low, value, high = getattr(b, f"{name}_min_{unit}"), getattr(a, f"{name}_{unit}"), getattr(b, f"{name}_max_{unit}")
            # written so that a NaN is a difference
            if not low <= value <= high:
                yield f"{name}_{unit} {value:.6g} is not in [{low:.6g}, {high:.6g}]"


def _feedback_differences(one: Feedback, other: Feedback, t: Tolerance, first: int) -> Iterator[str]:
    if one.fused.states != other.fused.states:
        yield "feedback of other states"
        return
    scale = _scale(one.fused.covariance, other.fused.covariance)
    most = [t.position_m, t.speed_mps, *(t.sigmas * std for std in scale[2:])]
    numbers = list(zip(one.fused.states, one.fused.mean, other.fused.mean, most, strict=True))
    for name, left, right, limit in numbers[first:]:
        if not abs(left - right) <= limit:
            yield f"feedback {name} {left:.6g} and {right:.6g}"
    if not first:
        yield from _matrix("feedback covariance", one.fused.covariance, other.fused.covariance, t.sigmas)


def _scale(one: list[list[float]], other: list[list[float]]) -> list[float]:
    """The smaller standard deviation of each state."""
    return [math.sqrt(max(min(left[i], right[i]), 0.0)) for i, (left, right) in enumerate(zip(one, other, strict=True))]


def _matrix(name: str, one: list[list[float]], other: list[list[float]], sigmas: float) -> Iterator[str]:
    if one == other:
        return
    scale = _scale(one, other)
    for i, (left, right) in enumerate(zip(one, other, strict=True)):
        for k in range(i + 1):
            if not abs(left[k] - right[k]) <= sigmas * scale[i] * scale[k]:
                yield f"{name} [{i}][{k}] {left[k]:.3g} and {right[k]:.3g}"
