"""A process's log: one line a record on standard error, as text for people or as JSON for programs.

Level and format are taken from the environment: forks, spawned commands and containers all have it.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import re
import sys
import threading
import traceback
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import Any

LEVEL_VARIABLE, FORMAT_VARIABLE = "MILEPOST_LOG_LEVEL", "MILEPOST_LOG_FORMAT"
HEAD = re.compile(r"^\d{4}-\d\d-\d\dT[\d:.]+Z [a-z]+ [^:]+: ")
log = logging.getLogger("milepost")


class LogLevel(StrEnum):
    """From which level on records are written."""

    debug = "debug"
    info = "info"
    warning = "warning"
    error = "error"


class LogFormat(StrEnum):
    """How records are written."""

    text = "text"
    json = "json"


NUMBERS = {str(level): logging.getLevelNamesMapping()[level.upper()] for level in LogLevel}


def choose(level: LogLevel, form: LogFormat) -> None:
    """Level and format of this process and of all that it starts."""
    os.environ.update({LEVEL_VARIABLE: level.value, FORMAT_VARIABLE: form.value})


def is_json() -> bool:
    """Whether records are JSON."""
    return os.environ.get(FORMAT_VARIABLE) == LogFormat.json


def _level() -> int:
    return NUMBERS.get(os.environ.get(LEVEL_VARIABLE, ""), logging.INFO)


class Lines(logging.Formatter):
    """A record as one line. `several`: there are several trains, and text names the record's; JSON always does.

    What was raised is named with its place. Its traceback follows where the level is `debug`: in JSON as a field.
    """

    def __init__(self, process: str, train: str = "", several: bool = False) -> None:
        super().__init__()
        self._process, self._train, self._several = process, train, several

    def format(self, record: logging.LogRecord) -> str:
        """The line, without its end."""
        time = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        level = "error" if record.levelno >= logging.ERROR else record.levelname.lower()
        message, error = self._named(record), record.exc_info[1] if record.exc_info else None
        if error is not None:
            message = f"{message}: {in_short(error)}"
        trace = "".join(traceback.format_exception(error)) if error is not None and _level() == logging.DEBUG else ""
        if not is_json():
            who = f"{self._train} {self._process}" if self._several else self._process
            return f"{time} {level} {who}: {' '.join(message.splitlines())}" + (f"\n{trace.rstrip()}" if trace else "")
        fields: dict[str, Any] = {"time": time, "level": level, "process": self._process}
        fields |= {"train": self._train} if self._train else {}
        fields |= {"code": code} if (code := getattr(record, "code", "")) else {}
        return json.dumps({**fields, "message": message, **({"traceback": trace} if trace else {})})

    def _named(self, record: logging.LogRecord) -> str:
        """What it says; an event with its unit, where the name of the process does not tell: in one that has many."""
        message, unit = record.getMessage(), getattr(record, "unit", "")
        told = not unit or unit in self._process or message.startswith(unit)
        return message if told else f"{unit}: {message}"


def in_short(error: BaseException) -> str:
    """What was raised, and where: `ValueError: a bug (fuser.py, line 12)`."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {error}{place}"


def message_of(line: str) -> str:
    """What a process had to say, of a line that it wrote."""
    with contextlib.suppress(ValueError, KeyError, TypeError):
        return str(json.loads(line)["message"])
    return HEAD.sub("", line).strip()


def set_up_log(process: str, train: str = "", several: bool = False) -> None:
    """From now on this process logs, under its name; what other libraries say only from warnings on."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(Lines(process, train, several))
    logging.basicConfig(handlers=[handler], level=max(_level(), logging.WARNING), force=True)
    log.setLevel(_level())
    threading.excepthook = _thread_raised
    sys.unraisablehook = _nobody_hears


def _formatter() -> logging.Formatter | None:
    """That of this process's log; None before there is one."""
    found = (handler.formatter for handler in logging.getLogger().handlers)
    return next((each for each in found if isinstance(each, Lines)), None)


def log_event(message: object) -> None:
    """Log an event that was sent."""
    level = NUMBERS.get(getattr(message, "severity", ""), logging.WARNING)
    extra = {"code": getattr(message, "code", ""), "unit": getattr(message, "unit", "")}
    log.log(level, "%s", getattr(message, "text", ""), extra=extra)


def say(sentence: str, level: int = logging.INFO) -> None:
    """A sentence to whoever started a command; a record where those are JSON."""
    line = f"milepost: {sentence}"
    if is_json():
        if level < _level():
            return
        record = logging.LogRecord(log.name, level, "", 0, sentence, None, None)
        line = (_formatter() or Lines("milepost")).format(record)
    # in one piece: several processes write to the same terminal or pipe
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


def failed(error: BaseException) -> None:
    """Say that a bug ends this process: a process with a log in one line, another one with the traceback."""
    if _formatter() is None and not is_json():
        traceback.print_exception(error)
        return
    if _formatter() is None:
        set_up_log("milepost")
    log.error("ends", exc_info=_told(error))


def _told(error: BaseException) -> tuple[type[BaseException], BaseException, TracebackType | None]:
    return type(error), error, error.__traceback__


def _thread_raised(raised: threading.ExceptHookArgs) -> None:
    if raised.exc_value is not None and not isinstance(raised.exc_value, SystemExit):
        log.error("a thread ends", exc_info=_told(raised.exc_value))


def _nobody_hears(raised: Any) -> None:
    if raised.exc_value is not None:
        log.error("ignored", exc_info=_told(raised.exc_value))
