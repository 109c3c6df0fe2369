"""The results of many seeds as one: medians, and the worst of each figure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from milepost.checks.figures import MORE_IS_BETTER, over_seeds

OF_THE_RUN = (
    "fused_over_centralised",
    "fused_minus_centralised_max_sigma",
    "withheld_fixes",
    "withheld_max_m",
    "withheld_outside_interval",
)


def summary(results: Sequence[dict[str, Any]], more_is_better: set[str] | frozenset[str] = frozenset()) -> dict[str, Any]:
    """Medians over the runs; under `worst` the largest value of each figure, or the smallest of those in `more_is_better`."""
    first = results[0]
    out = {"scenario": first["scenario"], "seed": first["seed"], "duration_s": first["duration_s"], "runs": len(results)}
    out |= _condition(results, more_is_better)
    if "variants" in first:
        out["variants"] = {
            name: _condition([result["variants"][name] for result in results], more_is_better) for name in first["variants"]
        }
    return out


def _condition(results: Sequence[dict[str, Any]], more_is_better: set[str] | frozenset[str]) -> dict[str, Any]:
    estimators: dict[str, Any] = {}
    for name, figures in results[0]["estimators"].items():
        values = {key: [r["estimators"][name][key] for r in results if key in r["estimators"][name]] for key in figures}
        estimators[name] = {key: over(v, _median) for key, v in values.items()}
        estimators[name]["worst"] = {key: _worst(key, v, more_is_better) for key, v in values.items()}
    alone = {key: max(r[key] for r in results) for key in OF_THE_RUN if key in results[0]}
    ends = [r["ended_s"] for r in results if "ended_s" in r]
    alone |= {"ended_s": min(ends)} if ends else {}
    not_scored = {"not_scored": results[0]["not_scored"]} if "not_scored" in results[0] else {}
    checks = {"checks": over_seeds([r.get("checks", {}) for r in results])} if "checks" in results[0] else {}
    return {"estimators": estimators, **alone, **not_scored, **checks}


def _worst(key: str, values: Sequence[Any], more_is_better: set[str] | frozenset[str]) -> Any:
    if key in more_is_better:
        return over(values, min)
    worst = over(values, max)
    # of a check, which is a map, some figures are the worse the smaller they are
    return (
        {**worst, **{k: v for k, v in over(values, min).items() if k in MORE_IS_BETTER}} if isinstance(worst, dict) else worst
    )


def over(values: Sequence[Any], reduce: Callable[[Sequence[float]], float]) -> Any:
    """One figure over several seeds: `reduce` of the numbers; maps and lists entry by entry."""
    if isinstance(values[0], dict):
        return {key: over([value[key] for value in values if key in value], reduce) for key in values[0]}
    if isinstance(values[0], list):
        return [reduce(entry) for entry in zip(*values, strict=False)]
    return reduce(values)


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))
