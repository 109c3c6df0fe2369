"""The thread that writes: whatever the disk does, the network's threads and the process's own go on."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from milepost.recorder.history import History
from milepost.recorder.incoming import Incoming
from milepost.recorder.recorder import Recorder
from milepost.recorder.several import Several

from .intake import Intake, Waiting

FLUSH_EVERY_S = 0.5
# what comes meanwhile is written at once: to be woken for each message costs more than to write it
PAUSE_S = 0.02


class WriterThread:
    """Writes what waits in an intake until it is told to end, and keeps some of it for `histories`, by key.

    `failed` is called from the thread where there is a bug in it.
    """

    def __init__(
        self,
        recorder: Recorder | Several,
        intake: Intake,
        failed: Callable[[], None],
        histories: Mapping[str, History] | None = None,
    ) -> None:
        self._recorder = recorder
        self._intake = intake
        self._failed = failed
        self._histories = histories or {}
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._guarded, name="writer", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Write all that waits, finish the file; returns then. Raises what the thread died of."""
        self._intake.tell(None)
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _guarded(self) -> None:
        try:
            self._write()
        except Exception as error:
            self._error = error
            self._failed()

    def _write(self) -> None:
        recorder, due = self._recorder, time.monotonic() + FLUSH_EVERY_S
        while True:
            item: Any = ()
            try:
                item = self._intake.get(0.0)
            except queue.Empty:
                time.sleep(PAUSE_S)
            if isinstance(item, Waiting):
                self._take(item)
            elif item is None:
                recorder.close(time.time_ns())
                return
            elif item:
                item()
            if time.monotonic() >= due:
                recorder.check(time.time_ns())
                due = time.monotonic() + FLUSH_EVERY_S

    def _take(self, item: Waiting) -> None:
        message = Incoming(item.key, str(item.sample.encoding), item.at_ns, item.sample.payload.to_bytes())
        history = self._histories.get(item.key)
        if history is not None:
            history.add(message)
        self._recorder.add(message)
