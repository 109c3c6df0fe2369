"""`milepost evaluate`: estimators side by side, offline; one scenario, or all of them with their claims."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from milepost.config.shipped_files import scenario_folder
from milepost.config.yaml_files import ConfigError
from milepost.evaluation.campaign import Evaluated, Skipped, as_fields, evaluate, find, tasks_of
from milepost.evaluation.plan import Plan, make_plan
from milepost.evaluation.tables import claims_table, estimator_table

from .showing.progress import progress_bar

RUNS_OF_ALL = 20


def run_evaluate(
    path: Path,
    seed: int | None,
    runs: int | None,
    jobs: int | None,
    as_json: bool,
    plot: Path | None,
    record: Path | None,
    report: Path | None,
) -> int:
    """Evaluate one scenario and print its figures. Raises ConfigError."""
    for file in (plot, record):
        _check_output(file)
    _check_pictures(plot, report)
    plan = make_plan(path, seed)
    if plot is not None and plan.cases[0].train.file.world is None:
        raise ConfigError("evaluate", "--plot", f"errors need a truth, and {plan.cases[0].train.path} has no `world`")
    keep = plot is not None or report is not None
    done = _work([plan], runs or 1, jobs, keep, record)[0]
    if plot is not None and done.traces is not None:
        from milepost.evaluation.plotting import draw_errors

        draw_errors(plot, plan.scenario.scenario, done.traces[""])
    _write_report(report, [done], [])
    result = done.results[0] if len(done.results) == 1 else done.figures
    print(json.dumps(result) if as_json else estimator_table(result))
    return 0


def run_evaluate_all(
    folder: Path | None, runs: int | None, jobs: int | None, as_json: bool, report: Path | None, only: Sequence[str]
) -> int:
    """Evaluate a folder's scenarios and print all claims; 1 if a target is missed without a reason. Raises ConfigError."""
    _check_pictures(None, report)
    plans, skipped = find(folder or scenario_folder(), [name for names in only for name in names.split(",") if name])
    for each in skipped:
        print(f"skipped {each.scenario}: {each.reason}", file=sys.stderr)
    done = _work(plans, runs or RUNS_OF_ALL, jobs, report is not None, None) if plans else []
    _write_report(report, done, skipped)
    rows = [row for each in done for row in each.rows]
    print(json.dumps(as_fields(done, skipped)) if as_json else claims_table(sorted(rows, key=lambda row: row.source)))
    return int(any(row.met is False and not row.why for row in rows))


def _work(plans: Sequence[Plan], runs: int, jobs: int | None, keep: bool, record: Path | None) -> list[Evaluated]:
    total = sum(task.work_s for plan in plans for task in tasks_of(plan, runs, keep))
    text = plans[0].scenario.scenario if len(plans) == 1 else f"{len(plans)} scenarios"
    with progress_bar(text, total) as show:
        return evaluate(plans, runs, jobs or os.cpu_count() or 1, keep, show, record)


def _check_output(file: Path | None) -> None:
    if file is not None and not file.parent.is_dir():
        raise ConfigError(file, "", "its folder does not exist")
    if file is not None and file.is_dir():
        raise ConfigError(file, "", "is a folder")


def _check_pictures(plot: Path | None, report: Path | None) -> None:
    """Whether pictures can be drawn and written. Raises ConfigError before any work."""
    if report is not None and report.exists() and not report.is_dir():
        raise ConfigError(report, "", "is not a folder")
    if (plot is not None or report is not None) and find_spec("matplotlib") is None:
        option = "--plot" if report is None else "--report"
        raise ConfigError("evaluate", option, "needs matplotlib: pip install 'milepost[plot]'")


def _write_report(folder: Path | None, done: Sequence[Evaluated], skipped: Sequence[Skipped]) -> None:
    if folder is not None:
        from milepost.evaluation.report import write_report

        write_report(folder, done, skipped)
