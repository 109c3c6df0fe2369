"""What is written to standard output, where Zenoh logs, read line by line."""

from __future__ import annotations

import contextlib
import logging
import os
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

from .records import is_json

log = logging.getLogger("milepost")
READ_BYTES, PIPE_BYTES = 1 << 18, 1 << 20
# a line that is longer is no line of Zenoh's
LONGEST = 1 << 16
F_SETPIPE_SZ = 1031
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_RECORD = re.compile(r"\S+ +(?P<level>TRACE|DEBUG|INFO|WARN|ERROR) +(?P<text>.*)")
_LEVELS = {"INFO": logging.INFO, "WARN": logging.WARNING, "ERROR": logging.ERROR}


def zenoh_in_log() -> AbstractContextManager[None]:
    """Where records are JSON, what Zenoh writes becomes records as well."""
    return reading_output(lambda line: False) if is_json() else nullcontext()  # noqa: ARG005


@contextmanager
def reading_output(take: Callable[[str], bool], rest: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Have standard output read; a line that `take` does not take is passed on. `rest` is called when what came was read."""
    before = os.dup(1)
    output, inlet = os.pipe()
    with contextlib.suppress(OSError):
        _widen(inlet)
    os.dup2(inlet, 1)
    os.close(inlet)

    def pass_on(line: str) -> None:
        if is_json():
            log_zenoh(line)
        else:
            os.write(before, f"{line}\n".encode())

    reader = threading.Thread(target=_read, args=(output, take, rest, pass_on), daemon=True)
    reader.start()
    try:
        yield
    finally:
        os.dup2(before, 1)
        reader.join(1.0)


def log_zenoh(line: str) -> None:
    """A line of Zenoh's log as a record of ours."""
    plain = _COLOUR.sub("", line).strip()
    found = _RECORD.fullmatch(plain)
    if found is not None:
        log.log(_LEVELS.get(found["level"], logging.DEBUG), "Zenoh: %s", found["text"])
    elif plain:
        log.info("%s", plain)


def _widen(pipe: int) -> None:
    import fcntl

    fcntl.fcntl(pipe, F_SETPIPE_SZ, PIPE_BYTES)


def _read(output: int, take: Callable[[str], bool], rest: Callable[[], None], pass_on: Callable[[str], None]) -> None:
    begun = b""
    while part := os.read(output, READ_BYTES):
        *lines, begun = (begun + part).split(b"\n")
        begun = begun[-LONGEST:]
        for line in lines:
            text = line.decode(errors="replace")
            if not take(text):
                pass_on(text)
        rest()
