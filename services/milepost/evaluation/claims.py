"""Claims of the sources judged by the results: one row for each claim, with the optimum beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from milepost.config.scenario_file import ClaimFile, ScenarioFile


@dataclass(frozen=True)
class SeedStatistics:
    """A figure over all seeds: median and worst; `pooled` is the root mean square, where the claim asks for it."""

    median: float
    worst: float
    pooled: float | None = None


@dataclass(frozen=True)
class JudgedClaim:
    """A judged claim: the figure by the source's method, by Milepost and by the optimum, each None where it is missing.

    `met` is None where there is no target.
    """

    source: str
    scenario: str
    label: str
    says: str
    target: str
    method: SeedStatistics | None
    ours: SeedStatistics | None
    optimum: SeedStatistics | None
    met: bool | None
    why: str

    def as_dict(self) -> dict[str, Any]:
        """The same, for JSON."""
        return asdict(self)


def judge(scenario: ScenarioFile, results: Sequence[dict[str, Any]]) -> list[JudgedClaim]:
    """Judge each claim of a scenario by the figures of all its seeds. A claim whose figure is missing is not met."""
    return [_row(scenario, claim, results) for claim in scenario.claims]


def _row(scenario: ScenarioFile, claim: ClaimFile, results: Sequence[dict[str, Any]]) -> JudgedClaim:
    ours = _spread(claim, claim.ours, results)
    label = claim.label or claim.key + (f" / {claim.over}" if claim.over else "")
    return JudgedClaim(
        claim.source,
        scenario.scenario + (f" ({claim.variant})" if claim.variant else ""),
        label,
        claim.says,
        _target(claim),
        _spread(claim, claim.method, results),
        ours,
        _spread(claim, claim.optimum, results),
        False if ours is None else _meets(claim, ours),
        claim.why if ours is not None else f"{claim.ours} has no figure {claim.key} on every seed",
    )


def _target(claim: ClaimFile) -> str:
    if claim.at_most is not None:
        return f"≤ {claim.at_most:g} ({claim.of})"
    return "-" if claim.at_least is None else f"≥ {claim.at_least:g} ({claim.of})"


def _meets(claim: ClaimFile, spread: SeedStatistics) -> bool | None:
    held = {"median": spread.median, "worst": spread.worst, "pooled": spread.pooled}[claim.of]
    if held is None:
        return False
    if claim.at_most is not None:
        return held <= claim.at_most
    return None if claim.at_least is None else held >= claim.at_least


def _spread(claim: ClaimFile, estimator: str | None, results: Sequence[dict[str, Any]]) -> SeedStatistics | None:
    values = [_value(claim, estimator, result) for result in results]
    bases = [1.0 if claim.over is None else _value(claim, claim.over, result) for result in results]
    pairs = [(value, base) for value, base in zip(values, bases, strict=True) if value is not None and base is not None]
    if len(pairs) < len(results) or any(base == 0.0 for _, base in pairs):
        return None
    numbers = [value / base for value, base in pairs]
    pooled = float(np.linalg.norm([v for v, _ in pairs]) / np.linalg.norm([b for _, b in pairs]))
    worst = min(numbers) if claim.at_least is not None else max(numbers)
    return SeedStatistics(float(np.median(numbers)), worst, pooled if claim.of == "pooled" else None)


def _value(claim: ClaimFile, estimator: str | None, result: dict[str, Any]) -> float | None:
    condition = result["variants"][claim.variant] if claim.variant else result
    if estimator is None:
        return None
    value = _figure(condition["estimators"].get(estimator), claim.key)
    if value is None and estimator == claim.ours:
        # figures of the whole run, such as `withheld_max_m`
        value = _figure(condition, claim.key)
    return value


def _figure(figures: Any, key: str) -> float | None:
    """A figure by its name; the part after a dot is a key of a map or an index of a list."""
    name, _, place = key.partition(".")
    value = figures.get(name) if isinstance(figures, dict) else None
    if place and isinstance(value, dict):
        value = value.get(place)
    elif place and isinstance(value, list):
        value = value[int(place)] if place.isdigit() and int(place) < len(value) else None
    return float(value) if isinstance(value, (int, float)) else None
