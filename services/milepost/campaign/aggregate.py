"""The figures of a cell: over its runs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from .cells import Cell
from .task import Figures, Task

S_PER_HOUR = 3600.0


def aggregate(cell: Cell, figures: Sequence[Figures]) -> dict[str, Any]:
    """A cell as one JSON object. Figures of epochs count from the onset on, figures with `_percent` are shares of 100.

    Quantiles of the time to detect are over all runs, where a run without detection takes forever: None where that is the
    quantile. Half-widths: median of the runs' medians, and the largest of all.
    """
    whole = [run for run in figures if "crashed" not in run]
    out: dict[str, Any] = {"train": cell.train, "units": list(cell.units), "fault": cell.fault, "runs": len(figures)}
    out["crashed_runs"] = len(figures) - len(whole)
    out |= _interval(whole) | _detection(whole) | _innocents(whole)
    for name in ("position_error_during_max_m", "position_error_after_max_m"):
        out[name] = _largest(run[name] for run in whole)
    for name in ("speed_error_during_max_mps", "speed_error_after_max_mps"):
        out[name] = _largest(run[name] for run in whole)
    out |= _recovery(whole)
    out["resets"] = _total(whole, "resets")
    out["reset_max_m"] = _largest(run["reset_max_m"] for run in whole)
    out["failed_runs"] = [
        _failed(task, run) for task, run in zip(cell.tasks, figures, strict=True) if "crashed" in run or run["outside_epochs"]
    ]
    return out


def violated(cell: dict[str, Any]) -> bool:
    """Whether in a run of the cell the truth was outside an interval, or a node crashed."""
    return bool(cell["violation_runs"] or cell["crashed_runs"])


def quantile(values: Iterable[float | None], share: float) -> float | None:
    """The smallest value that at least `share` of the values do not exceed; None counts as larger than all."""
    ordered = sorted(math.inf if value is None else value for value in values)
    if not ordered:
        return None
    value = ordered[max(0, math.ceil(share * len(ordered) - 1e-9) - 1)]
    return None if math.isinf(value) else value


def percent(part: float, whole: float) -> float | None:
    """`part` of `whole` in percent; None of nothing."""
    return 100.0 * part / whole if whole else None


def _total(runs: Sequence[Figures], name: str) -> int:
    return sum(run[name] for run in runs)


def _largest(values: Iterable[float | None]) -> float | None:
    return max((value for value in values if value is not None), default=None)


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _interval(runs: Sequence[Figures]) -> dict[str, Any]:
    epochs = _total(runs, "epochs")
    words = sorted({word for run in runs for word in run["statuses_epochs"]})
    return {
        "observed_h": sum(run["observed_s"] for run in runs) / S_PER_HOUR,
        "epochs": epochs,
        "epochs_without_state": _total(runs, "epochs_without_state"),
        "violation_runs": sum(run["outside_epochs"] > 0 for run in runs),
        "violation_epochs": _total(runs, "outside_epochs"),
        "violation_epochs_percent": percent(_total(runs, "outside_epochs"), epochs),
        "position_violation_epochs": _total(runs, "outside_position_epochs"),
        "speed_violation_epochs": _total(runs, "outside_speed_epochs"),
        "normal_while_outside_epochs": _total(runs, "normal_while_outside_epochs"),
        "normal_while_outside_percent": percent(_total(runs, "normal_while_outside_epochs"), epochs),
        "outside_before_onset_epochs": _total(runs, "outside_before_onset_epochs"),
        "position_half_width_median_m": _median(run["position_half_width_median_m"] for run in runs),
        "position_half_width_max_m": _largest(run["position_half_width_max_m"] for run in runs),
        "speed_half_width_median_mps": _median(run["speed_half_width_median_mps"] for run in runs),
        "speed_half_width_max_mps": _largest(run["speed_half_width_max_mps"] for run in runs),
        "subset_041_percent": percent(_total(runs, "subset_041_epochs"), _total(runs, "subset_041_due_epochs")),
        "statuses_percent": {word: percent(sum(r["statuses_epochs"].get(word, 0) for r in runs), epochs) for word in words},
    }


def _detection(runs: Sequence[Figures]) -> dict[str, Any]:
    """When the liars were excluded, doubted, and named by a warning; None throughout where nobody lies.

    Runs in which no fault had anything to act on are counted by themselves.
    """
    lying = [run for run in runs if run["liars"]]
    out: dict[str, Any] = {"never_acted_runs": sum(run["never_acted"] > 0 and not run["liars"] for run in runs)}
    for word, key in (("detected", "time_to_detect"), ("doubted", "time_to_doubt"), ("warned", "time_to_warn")):
        times = [run[f"{key}_s"] for run in lying]
        out[f"{word}_percent"] = percent(sum(time is not None for time in times), len(lying))
        out |= {f"{key}_p50_s": quantile(times, 0.5), f"{key}_p95_s": quantile(times, 0.95)}
    out["used_again_percent"] = percent(_total(runs, "used_again_epochs"), _total(runs, "found_epochs"))
    return out


def _innocents(runs: Sequence[Figures]) -> dict[str, Any]:
    hours, epochs = sum(run["observed_s"] for run in runs) / S_PER_HOUR, _total(runs, "epochs")
    units = sorted({unit for run in runs for unit in run["wrongly_excluded"]})
    return {
        "wrongly_excluded_percent": percent(_total(runs, "wrongly_excluded_epochs"), _total(runs, "innocent_epochs")),
        "wrongly_excluded_runs": sum(run["wrongly_excluded_epochs"] > 0 for run in runs),
        "wrong_exclusions_per_h": _total(runs, "wrong_exclusions") / hours if hours else None,
        "wrongly_excluded": {unit: _wrongly(runs, unit, epochs) for unit in units},
    }


def _wrongly(runs: Sequence[Figures], unit: str, epochs: int) -> dict[str, Any]:
    entries = [run["wrongly_excluded"][unit] for run in runs if unit in run["wrongly_excluded"]]
    reasons = sorted({reason for entry in entries for reason in entry["reasons"]})
    return {"percent": percent(sum(entry["epochs"] for entry in entries), epochs), "runs": len(entries), "reasons": reasons}


def _recovery(runs: Sequence[Figures]) -> dict[str, Any]:
    judged = [run for run in runs if run["readmitted"] is not None]
    times = [run["time_to_recover_s"] for run in judged]
    return {
        "readmitted_percent": percent(sum(run["readmitted"] for run in judged), len(judged)),
        "time_to_recover_p50_s": quantile(times, 0.5),
        "time_to_recover_p95_s": quantile(times, 0.95),
    }


def _failed(task: Task, run: Figures) -> dict[str, Any]:
    """A run with a violation or a crash: enough to make it again."""
    kept = ("outside_epochs", "normal_while_outside_epochs", "first_outside_s", "position_error_during_max_m", "crashed")
    faults = [dict(fault) for fault in task.faults]
    return {
        "seed": task.seed,
        "labels": list(task.labels),
        "faults": faults,
        **{name: run[name] for name in kept if name in run},
    }
