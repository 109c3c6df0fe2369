"""The figures of checks: violations, widths and availability, each by itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from .published import Published
from .requirements import CHECKS

Figures = dict[str, float]
# of these figures the smallest is the worst
MORE_IS_BETTER = ("epochs", "availability")


def figures(name: str, published: Published) -> Figures | None:
    """The figures of one check; None without truth or interval, and where it applies to no epoch.

    `epochs`: those that it applies to. `violations` and `violations_share`: those beyond what is permitted, and `worst_m` (or
    `_mps`, `_s`) the farthest beyond, 0 if none is. `width_median_m`, `width_p95_m`, `width_max_m` (of steps `step_…`).
    `availability`: the share of the epochs whose width is permitted.
    """
    if published.truth is None or published.bounds is None:
        return None
    check = CHECKS[name]
    found = check.look(published)
    if found is None:
        return None
    given = next(each for each in (found.beyond, found.size) if each is not None)
    if not len(given):
        return None
    out: Figures = {"epochs": len(given)}
    if found.beyond is not None:
        outside = found.beyond > 0.0
        out |= {"violations": int(outside.sum()), "violations_share": float(outside.mean())}
        out[f"worst_{check.unit}"] = max(0.0, float(found.beyond.max()))
    if found.size is not None:
        for key, value in zip(("median", "p95", "max"), np.quantile(found.size, (0.5, 0.95, 1.0)), strict=True):
            out[f"{check.size}_{key}_{check.unit}"] = float(value)
    if found.available is not None:
        out["availability"] = float(found.available.mean())
    return out


def check_all(published: Published) -> dict[str, Figures]:
    """The figures of every check that applies everywhere."""
    found = {name: figures(name, published) for name, check in CHECKS.items() if check.always}
    return {name: each for name, each in found.items() if each is not None}


def over_seeds(results: Sequence[Mapping[str, Mapping[str, Figures]]]) -> dict[str, Any]:
    """estimator → check → figures of many seeds as one: medians, and under `worst` the worst of each."""
    out: dict[str, Any] = {}
    for estimator, name in dict.fromkeys((e, name) for result in results for e, checks in result.items() for name in checks):
        seeds = [result[estimator][name] for result in results if name in result.get(estimator, {})]
        worst = {key: _over(seeds, key, min if key in MORE_IS_BETTER else max) for key in seeds[0]}
        medians: dict[str, Any] = {key: _over(seeds, key, lambda values: float(np.median(values))) for key in seeds[0]}
        out.setdefault(estimator, {})[name] = {**medians, "worst": worst}
    return out


def _over(seeds: Sequence[Figures], key: str, reduce: Callable[[list[float]], float]) -> float:
    return reduce([seed[key] for seed in seeds])
