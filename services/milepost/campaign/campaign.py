"""A whole campaign: its runs, those that are in a file of results taken from there, and the figures of its cells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from milepost.offline.process_pool import Finished, Progress, run_in_processes

from .aggregate import aggregate, violated
from .campaign_file import CampaignFile
from .cells import Cell
from .fingerprint import code_fingerprint
from .results_file import ResultsFile
from .task import Figures, Task, run_task

# runs tasks somewhere: (tasks, progress in seconds of scenario time, what to do with each result)
Executor = Callable[[Sequence[Task], Progress, Finished[Figures]], object]


@dataclass(frozen=True)
class Campaign:
    """A finished campaign: its file and the figures of its cells, in the file's order."""

    file: CampaignFile
    seed: int
    runs: int
    cells: list[dict[str, Any]]

    @property
    def violated(self) -> list[dict[str, Any]]:
        """The cells with a violation or a crash."""
        return [cell for cell in self.cells if violated(cell)]

    def as_dict(self) -> dict[str, Any]:
        """All figures as one JSON object; the unit of each is at the end of its name."""
        head = {"campaign": self.file.campaign, "seed": self.seed, "runs_per_cell": self.runs, "code": code_fingerprint()}
        trains = {name: entry.model_dump() for name, entry in self.file.trains.items()}
        return {**head, "trains": trains, "violated_cells": len(self.violated), "cells": self.cells}


def locally(jobs: int) -> Executor:
    """An executor: so many processes of this machine."""
    return lambda tasks, progress, finished: run_in_processes(run_task, tasks, jobs, progress, finished)


def work_s(cells: Sequence[Cell]) -> float:
    """The scenario time of all runs."""
    return sum(task.duration_s for cell in cells for task in cell.tasks)


def run_campaign(
    file: CampaignFile, cells: Sequence[Cell], execute: Executor, results: ResultsFile | None, progress: Progress
) -> Campaign:
    """Make the runs that `results` does not have, keep each there as soon as it is finished, and aggregate all."""
    tasks = list({task.key: task for cell in cells for task in cell.tasks}.values())
    done: dict[str, Figures] = {}
    if results is not None:
        done = {task.key: found for task in tasks if (found := results.get(task)) is not None}
    left = [task for task in tasks if task.key not in done]
    before_s = sum(task.duration_s for task in tasks if task.key in done)

    def finished(place: int, figures: Figures) -> None:
        task = left[place]
        done[task.key] = figures
        if results is not None:
            results.add(task, figures)

    progress(before_s)
    execute(left, lambda more_s: progress(before_s + more_s), finished)
    rows = [aggregate(cell, [done[task.key] for task in cell.tasks]) for cell in cells]
    return Campaign(file, cells[0].tasks[0].seed, len(cells[0].tasks), rows)
