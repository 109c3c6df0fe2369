"""The progress of what takes longer than two seconds, on standard error: a bar, or a line a minute where no terminal is."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

LINE_EVERY_S = 60.0


@contextmanager
def progress_bar(text: str, total: float) -> Iterator[Callable[[float], None]]:
    """Yields a function to call with how much of `total` is done."""
    if not sys.stderr.isatty():
        yield ProgressLines(text, total, sys.stderr)
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=total)
        yield lambda done: bar.update(task, completed=done)


class ProgressLines:
    """Writes how much of `total` is done, and how long the rest will take at this pace; for logs, once a minute."""

    def __init__(self, text: str, total: float, out: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._text, self._total = text, total
        self._out, self._clock = out, clock
        self._began_s = self._told_s = clock()

    def __call__(self, done: float) -> None:
        """So much of the total is done."""
        now_s = self._clock()
        if now_s - self._told_s < LINE_EVERY_S or not 0.0 < done < self._total:
            return
        self._told_s = now_s
        left_min = (now_s - self._began_s) * (self._total / done - 1.0) / 60.0
        print(f"{self._text}: {100.0 * done / self._total:.0f} %, about {left_min:.0f} min left", file=self._out, flush=True)
