"""Runs the cells one after the other, many on one train, and judges each against its limits."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import psutil

from milepost.config.train import load_train
from milepost.runtime.launch import is_router
from milepost.runtime.process import ProcessOptions
from milepost.runtime.train_jobs import router_jobs, train_jobs

from .cells import Cell, cells
from .figures import Figures
from .news import NotInTime
from .stack import NORMAL_S, Stack
from .view import begins_traceback

# the train `full` spins a wheel 75 s after its start, and cells on it would not be like those before
TRAIN_S = 65.0


@dataclass(frozen=True)
class Outcome:
    """A cell's figures; `failures` are sentences, none where it passed."""

    cell: Cell
    figures: Figures
    failures: tuple[str, ...]
    # what the processes said meanwhile
    log: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether all limits were kept."""
        return not self.failures

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        head = {"cell": self.cell.name, "passed": self.passed, "gap_limit_s": self.cell.gap_s}
        figures = {**asdict(self.figures), "own_gap_s": self.figures.own_gap_s}
        return {**head, **figures, "failures": self.failures, "log": self.log}


def planned(train_file: Path, only: Sequence[str]) -> list[Cell]:
    """The cells of a train; `only`: those whose names match one of these patterns. Raises ConfigError."""
    train = load_train(train_file)
    endpoints = ["tcp/127.0.0.1:0"] * 2
    options = ProcessOptions(endpoints)
    names = [job.name for job in (*router_jobs(endpoints), *train_jobs(train, None, options))]
    assert sum(is_router(name) for name in names) == 2
    units = list(train.sensors) if train.file.chaos else []
    found = cells(names, units)
    return [cell for cell in found if not only or any(fnmatch(cell.name, f"*{pattern}*") for pattern in only)]


def run_matrix(train_file: Path, wanted: Sequence[Cell], done: Callable[[Outcome], None]) -> list[Outcome]:
    """Run cells; `done` is told of each outcome as soon as there is one."""
    out: list[Outcome] = []
    left = iter(wanted)
    cell = next(left, None)
    while cell is not None:
        with Stack(train_file) as stack:
            stack.recovered(NORMAL_S)
            begun = time.monotonic()
            while cell is not None and time.monotonic() - begun < TRAIN_S:
                out.append(run_cell(stack, cell))
                done(out[-1])
                cell = next(left, None)
                if out[-1].figures.recovery_s is None:  # what did not recover is no place for another cell
                    break
    return out


def run_cell(stack: Stack, cell: Cell) -> Outcome:
    """Do what a cell says to a train that is well, and wait until it is well again."""
    said = {name: len(lines) for name, lines in stack.lines.items()}
    failures: list[str] = []
    figures = Figures()
    try:
        if cell.prepare is not None:
            cell.prepare(stack)
        stack.recovered(cell.recovery_s)
        refused = stack.refused()
        with stack.measured() as figures:
            cell.blow(stack)
            stack.recover(figures, cell.recovery_s)
        figures.refused = stack.refused() - refused
    except (NotInTime, AssertionError, LookupError, OSError, psutil.Error) as error:
        failures.append(str(error))
    failures += judged(cell, figures)
    log = tuple(line.rstrip() for name, lines in stack.lines.items() for line in lines[said.get(name, 0) :])
    failures += [f"exception: {line.strip()}" for line in log if begins_traceback(line)]
    return Outcome(cell, figures, tuple(failures), log)


def judged(cell: Cell, figures: Figures) -> Iterator[str]:
    """Sentences about the limits that were not kept."""
    if figures.own_gap_s > cell.gap_s:
        yield f"{figures.own_gap_s:.2f} s without a state, at most {cell.gap_s:g} s are allowed"
    if figures.violations:
        yield f"{figures.violations} states whose interval did not hold the truth"
    if figures.contradicted:
        yield f"{figures.contradicted} states contradict one of the same epoch, though neither awaited anything"
    if not figures.compared and figures.states:
        yield "no state could be compared with the truth"
