"""A router that lets in only certificates, and says whom it refused: in its log, and as events."""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from milepost.runtime.bus import ZenohBus
from milepost.runtime.process import run_router
from milepost.runtime.session_file import whole
from milepost_schemas import Event

from .refusals import LOG_FILTER, Refusals

log = logging.getLogger("milepost")
READ_BYTES, PIPE_BYTES = 1 << 18, 1 << 20
# a line that is longer is no line of Zenoh's
LONGEST = 1 << 16
F_SETPIPE_SZ = 1031

Said = queue.SimpleQueue[tuple[str, str] | None]


def run_named_router(listen: list[str], config_file: Path | None, parent: int | None = None, link: Sequence[str] = ()) -> None:
    """Run a router until it is stopped; one whose file has access control also says whom it refuses. Raises ConfigError."""
    config = {} if config_file is None else whole(config_file)
    about = config.get("metadata") or {}
    if not config.get("access_control", {}).get("enabled") or not {"train", "name"} <= set(about):
        run_router(listen, config_file, parent, link)
        return
    said: Said = queue.SimpleQueue()

    @contextmanager
    def attend(session: Any) -> Iterator[None]:
        speaker = threading.Thread(target=_speak, args=(said, ZenohBus(session, about["train"]), about["name"]))
        speaker.start()
        try:
            yield
        finally:
            said.put(None)
            speaker.join()

    with _read_output(Refusals(lambda code, text: said.put((code, text)))):
        run_router(listen, config_file, parent, link, LOG_FILTER, attend)


def _speak(said: Said, bus: ZenohBus, name: str) -> None:
    """Log and publish what is to be said. Not the reader's work: sending writes to the log that it has to empty."""
    instance, sequence = uuid.uuid4().hex[:8], 0
    while (sentence := said.get()) is not None:
        code, text = sentence
        log.warning("%s", text)
        now_ns = time.time_ns()
        head: dict[str, Any] = {"train": bus.train, "unit": name, "instance": instance, "sequence": sequence}
        event = Event(**head, measured_at_ns=now_ns, published_at_ns=now_ns, severity="warning", code=code, text=text)
        bus.publish("event", "", event)
        sequence += 1


@contextmanager
def _read_output(refusals: Refusals) -> Iterator[None]:
    """Have standard output, where Zenoh logs, read line by line; what is not understood is passed on."""
    before = os.dup(1)
    output, inlet = os.pipe()
    with contextlib.suppress(OSError):
        _widen(inlet)
    os.dup2(inlet, 1)
    os.close(inlet)
    reader = threading.Thread(target=_read, args=(output, refusals, lambda text: os.write(before, text.encode())), daemon=True)
    reader.start()
    try:
        yield
    finally:
        os.dup2(before, 1)
        reader.join(1.0)


def _widen(pipe: int) -> None:
    import fcntl

    fcntl.fcntl(pipe, F_SETPIPE_SZ, PIPE_BYTES)


def _read(output: int, refusals: Refusals, pass_on: Callable[[str], object]) -> None:
    begun = b""
    while part := os.read(output, READ_BYTES):
        *lines, begun = (begun + part).split(b"\n")
        begun = begun[-LONGEST:]
        for line in lines:
            text = line.decode(errors="replace")
            if not refusals.line(text):
                pass_on(text + "\n")
        refusals.rest()
