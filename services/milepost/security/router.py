"""A router that lets in only certificates, and says whom it refused: in its log, and as events."""

from __future__ import annotations

import queue
import threading
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from milepost.runtime.bus import ZenohBus
from milepost.runtime.logs.output import reading_output
from milepost.runtime.logs.records import log_event
from milepost.runtime.process import run_router
from milepost.runtime.sessions.session_file import whole
from milepost_schemas import Event

from .refusals import LOG_FILTER, Refusals

Said = queue.SimpleQueue[tuple[str, str] | None]


def run_named_router(
    listen: list[str], config_file: Path | None, parent: int | None = None, link: Sequence[str] = (), name: str = "router"
) -> None:
    """Run a router until it is stopped; one whose file has access control also says whom it refuses. Raises ConfigError."""
    config = {} if config_file is None else whole(config_file)
    about = config.get("metadata") or {}
    if not config.get("access_control", {}).get("enabled") or not {"train", "name"} <= set(about):
        run_router(listen, config_file, parent, link, name=name)
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

    refusals = Refusals(lambda code, text: said.put((code, text)))
    with reading_output(refusals.line, refusals.rest):
        run_router(listen, config_file, parent, link, LOG_FILTER, attend, about["name"])


def _speak(said: Said, bus: ZenohBus, name: str) -> None:
    """Log and publish what is to be said. Not the reader's work: sending writes to the log that it has to empty."""
    instance, sequence = uuid.uuid4().hex[:8], 0
    while (sentence := said.get()) is not None:
        code, text = sentence
        now_ns = time.time_ns()
        head: dict[str, Any] = {"train": bus.train, "unit": name, "instance": instance, "sequence": sequence}
        event = Event(**head, measured_at_ns=now_ns, published_at_ns=now_ns, severity="warning", code=code, text=text)
        log_event(event)
        bus.publish("event", "", event)
        sequence += 1
