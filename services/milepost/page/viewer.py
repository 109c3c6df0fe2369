"""What one browser sees and was sent: each frame holds only what is different from the one before."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import Any

from milepost.track.line import Line

from .drawing import drawing_of
from .heard import Heard, TrainHeard
from .one_train import nobody, one_train
from .overview import overview
from .rows import Rows, Sent

# a line by its name and content hash; None where it is not known
Lines = Callable[[str, str], Line | None]
Frame = dict[str, Any]


class Viewer:
    """A browser that looks at one train, or at all where `train` is empty."""

    def __init__(self, heard: Heard, lines: Lines, train: str = "") -> None:
        self._heard, self._lines, self._name = heard, lines, train
        self._sent = Sent()
        self._line = ("", "")
        self._points, self._run = 0, 0

    def frame(self, now_ns: int) -> Frame:
        """What is different now. Whoever asks has shown the frame before: nothing is kept for who does not."""
        self._heard.refresh()
        if not self._name:
            return self._changed(overview(self._heard.trains(), now_ns, self._heard.left_out))
        train = self._heard.train(self._name)
        if train is None:
            return self._changed(nobody(self._name))
        return self._changed(one_train(train, now_ns)) | self._drawing(train) | self._new_points(train)

    def _changed(self, rows: Rows) -> Frame:
        return dict(self._sent.change(rows)._asdict())

    def _drawing(self, train: TrainHeard) -> Frame:
        """The line, when the train is on another one than before."""
        state = train.state
        if state is None or (state.line, state.line_hash) == self._line:
            return {}
        self._line = (state.line, state.line_hash)
        line = self._lines(*self._line)
        return {"line": None if line is None else drawing_of(line)}

    def _new_points(self, train: TrainHeard) -> Frame:
        """The speeds that it has not; all, where the train began again."""
        again = train.runs != self._run
        missing = len(train.points) if again else min(train.points_told - self._points, len(train.points))
        self._points, self._run = train.points_told, train.runs
        if not missing and not again:
            return {}
        points = [[round(value, 2) for value in each] for each in islice(train.points, len(train.points) - missing, None)]
        return {"points": points, "again": again}
