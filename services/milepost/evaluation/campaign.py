"""Many scenarios on many seeds."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from milepost.config.scenario_file import ScenarioFile
from milepost.config.yaml_files import ConfigError, read_yaml, validate

from .claims import JudgedClaim, judge
from .plan import Plan, make_plan
from .pool import Outcome, Task, run_tasks
from .scenario_run import ProgressCallback, Traces
from .summary import summary


@dataclass(frozen=True)
class Skipped:
    """A scenario that cannot be run here, and why."""

    scenario: str
    reason: str


@dataclass(frozen=True)
class Evaluated:
    """A scenario's results on all its seeds, its judged claims, and the traces of the first seed if they were kept."""

    plan: Plan
    results: list[dict[str, Any]]
    rows: list[JudgedClaim]
    traces: dict[str, Traces] | None

    @property
    def scenario(self) -> ScenarioFile:
        """The scenario file."""
        return self.plan.scenario

    @property
    def figures(self) -> dict[str, Any]:
        """Medians and worst over the seeds."""
        return summary(self.results, self.plan.more_is_better)


def find(folder: Path, only: Sequence[str]) -> tuple[list[Plan], list[Skipped]]:
    """The scenarios of a folder, loaded and checked; `only` the named ones if any are named. Raises ConfigError."""
    plans: list[Plan] = []
    skipped: list[Skipped] = []
    paths = sorted(folder.glob("*.yaml"))
    if not paths:
        raise ConfigError(folder, "", "has no scenario files (*.yaml)")
    for path in paths:
        scenario = validate(path, read_yaml(path), ScenarioFile)
        if only and scenario.scenario not in only and path.stem not in only:
            continue
        absent = next((needed for needed in scenario.needs if not os.path.exists(needed)), None)
        if absent is not None:
            skipped.append(Skipped(scenario.scenario, f"{absent} does not exist"))
        else:
            plans.append(make_plan(path))
    known = {plan.path.stem for plan in plans} | {plan.scenario.scenario for plan in plans} | {s.scenario for s in skipped}
    for name in only:
        if name not in known:
            raise ConfigError(folder, "--only", f"no scenario has the name {name}")
    return plans, skipped


def tasks_of(plan: Plan, runs: int, keep: bool, record: Path | None = None) -> list[Task]:
    """A task for each seed; the first keeps traces and the recording."""
    count = min(runs, plan.scenario.seeds or runs)
    return [
        Task(plan.path, plan.seed + run, plan.work_s, keep and run == 0, record if run == 0 else None) for run in range(count)
    ]


def evaluate(
    plans: Sequence[Plan], runs: int, jobs: int, keep: bool, progress: ProgressCallback, record: Path | None = None
) -> list[Evaluated]:
    """Every plan on `runs` seeds; all plans share the `jobs` processes."""
    tasks = [tasks_of(plan, runs, keep, record) for plan in plans]
    outcomes = iter(run_tasks([task for group in tasks for task in group], jobs, progress))
    return [_evaluated(plan, [next(outcomes) for _ in group]) for plan, group in zip(plans, tasks, strict=True)]


def _evaluated(plan: Plan, outcomes: list[Outcome]) -> Evaluated:
    results = [outcome.result for outcome in outcomes]
    return Evaluated(plan, results, judge(plan.scenario, results), outcomes[0].traces)


def as_fields(done: Sequence[Evaluated], skipped: Sequence[Skipped]) -> dict[str, Any]:
    """All results as one JSON object: figures and judged claims by scenario, and the skipped scenarios."""
    return {
        "scenarios": {
            each.scenario.scenario: {**each.figures, "claims": [row.as_dict() for row in each.rows]} for each in done
        },
        "skipped": {each.scenario: each.reason for each in skipped},
    }
