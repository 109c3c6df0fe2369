"""Many seeds of many scenarios on all cores; the results do not depend on the number of cores."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from milepost.offline.memory_bus import Tap
from milepost.offline.message_log import write_line
from milepost.offline.process_pool import run_in_processes

from .plan import make_plan
from .scenario_run import ProgressCallback, Traces, run_plan

# enough for a picture; figures are computed from every epoch
EPOCHS_OF_A_PICTURE = 3000


@dataclass(frozen=True)
class Task:
    """A scenario on one seed. `keep`: return traces. `record`: write every message of the scenario's own train to this file."""

    path: Path
    seed: int
    work_s: float
    keep: bool = False
    record: Path | None = None


@dataclass(frozen=True)
class Outcome:
    """The result of a task: the figures and, if they were kept, the thinned traces of each case."""

    task: Task
    result: dict[str, Any]
    traces: dict[str, Traces] | None


def run_tasks(tasks: Sequence[Task], jobs: int, progress: ProgressCallback) -> list[Outcome]:
    """The outcomes, in the order of the tasks; `progress` is called with the seconds of scenario time done in all."""
    return run_in_processes(run_task, tasks, jobs, progress)


def run_task(task: Task, progress: ProgressCallback) -> Outcome:
    """Run one task in this process."""
    plan = make_plan(task.path, task.seed)
    with _writer(task.record) as also:
        run = run_plan(plan, also, progress)
    return Outcome(task, run.result, {case: _thinned(traces) for case, traces in run.traces.items()} if task.keep else None)


def _thinned(traces: Traces) -> Traces:
    return {name: trace.within(slice(None, None, -(-len(trace.t_s) // EPOCHS_OF_A_PICTURE))) for name, trace in traces.items()}


@contextmanager
def _writer(path: Path | None) -> Iterator[Tap | None]:
    if path is None:
        yield None
        return
    with path.open("w", encoding="utf-8") as file:
        yield _to(file)


def _to(file: TextIO) -> Tap:
    return lambda output, now_ns: write_line(file, output.message.train, output, now_ns)
