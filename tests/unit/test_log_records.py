"""What a process logs: one line a record, with date, level and name, as text or as JSON."""

from __future__ import annotations

import json
import logging
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from milepost.runtime.logs.output import log_zenoh
from milepost.runtime.logs.records import FORMAT_VARIABLE, LEVEL_VARIABLE, Lines, failed, log_event, message_of, say

log = logging.getLogger("milepost")
STAMP = r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z"


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """The lines that the process `fuser` of train `t-1` would write, from `info` on."""
    out: list[str] = []
    formatter = Lines("fuser", "t-1")
    handler = logging.Handler()
    handler.setFormatter(formatter)
    handler.emit = lambda record: out.append(formatter.format(record))  # type: ignore[method-assign]
    logging.getLogger().addHandler(handler)
    level, before = log.level, logging.getLogger().level
    log.setLevel(logging.INFO)
    monkeypatch.delenv(LEVEL_VARIABLE, raising=False)
    monkeypatch.delenv(FORMAT_VARIABLE, raising=False)
    yield out
    logging.getLogger().removeHandler(handler)
    log.setLevel(level)
    logging.getLogger().setLevel(before)


def test_text_has_date_level_and_name(lines: list[str]) -> None:
    log.warning("silent for %d s", 3)
    assert re.fullmatch(STAMP + r" warning fuser: silent for 3 s", lines[0])


def test_of_several_trains_text_names_the_record_s(lines: list[str]) -> None:
    record = logging.LogRecord("milepost", logging.INFO, "", 0, "x", None, None)
    assert Lines("fuser", "t-1", several=True).format(record).endswith(" info t-1 fuser: x")


def test_json_has_the_same_as_fields(lines: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FORMAT_VARIABLE, "json")
    log.error('a "word" and σ\nand a second line')
    found = json.loads(lines[0])
    assert re.fullmatch(STAMP, found.pop("time"))
    message = 'a "word" and σ\nand a second line'
    assert found == {"level": "error", "process": "fuser", "train": "t-1", "message": message}
    assert "\n" not in lines[0]
    assert lines[0].isascii(), "whatever the locale of a container, it can be written"


@pytest.mark.parametrize("form", ["text", "json"])
def test_what_was_raised_is_one_line_with_its_place(lines: list[str], monkeypatch: pytest.MonkeyPatch, form: str) -> None:
    monkeypatch.setenv(FORMAT_VARIABLE, form)
    try:
        raise ValueError("a\nbug")
    except ValueError as error:
        failed_in_log(error)
    (line,) = lines
    assert "\n" not in line
    assert "Traceback" not in line
    assert re.search(r"ValueError: a( |\\n)bug \(test_log_records\.py, line \d+\)", line)


@pytest.mark.parametrize("form", ["text", "json"])
def test_with_level_debug_its_traceback_is_shown(lines: list[str], monkeypatch: pytest.MonkeyPatch, form: str) -> None:
    monkeypatch.setenv(FORMAT_VARIABLE, form)
    monkeypatch.setenv(LEVEL_VARIABLE, "debug")
    try:
        raise ValueError("a bug")
    except ValueError as error:
        failed_in_log(error)
    assert "Traceback" in (json.loads(lines[0])["traceback"] if form == "json" else lines[0])
    assert form == "text" or "\n" not in lines[0]


def failed_in_log(error: BaseException) -> None:
    assert any(isinstance(handler.formatter, Lines) for handler in logging.getLogger().handlers)
    failed(error)


@pytest.mark.parametrize("severity", ["info", "warning", "error"])
def test_an_event_is_as_bad_as_it_says_and_has_its_code(
    lines: list[str], monkeypatch: pytest.MonkeyPatch, severity: str
) -> None:
    monkeypatch.setenv(FORMAT_VARIABLE, "json")
    log_event(SimpleNamespace(severity=severity, code="flood", text="too many"))
    found = json.loads(lines[0])
    assert (found["level"], found["code"], found["message"]) == (severity, "flood", "too many")


def test_of_a_process_that_has_many_units_an_event_is_said_with_its_unit(lines: list[str]) -> None:
    """Where the name of the process is that of the unit, or the event begins with it, it is said once."""
    for unit, text in (("odometer-front", "845.0 mm"), ("radar", "radar: biased"), ("fuser", "two speak")):
        log_event(SimpleNamespace(severity="warning", code="x", text=text, unit=unit))
    assert [line.split(" fuser: ")[1] for line in lines] == ["odometer-front: 845.0 mm", "radar: biased", "two speak"]


@pytest.mark.parametrize("form", ["text", "json"])
def test_a_line_tells_what_it_says_to_who_shows_it(lines: list[str], monkeypatch: pytest.MonkeyPatch, form: str) -> None:
    """GIVEN a process's last line, THEN `up` shows what it says, without date, level and name."""
    monkeypatch.setenv(FORMAT_VARIABLE, form)
    log.error("no disk: sda")
    assert message_of(lines[0]) == "no disk: sda"
    assert message_of("milepost: a.yaml: units: none ") == "milepost: a.yaml: units: none"
    assert message_of("[1]") == "[1]"


def test_what_zenoh_writes_keeps_its_level(lines: list[str]) -> None:
    log_zenoh("\x1b[2m2026-11-28T05:22:01.000001Z\x1b[0m \x1b[33m WARN\x1b[0m rx-0 ThreadId(05) zenoh::x: closed")
    log_zenoh("2026-11-28T05:22:01.000001Z ERROR main zenoh::y: cannot")
    log_zenoh("")
    assert [line.split(" ", 1)[1] for line in lines] == [
        "warning fuser: Zenoh: rx-0 ThreadId(05) zenoh::x: closed",
        "error fuser: Zenoh: main zenoh::y: cannot",
    ]


def test_a_sentence_of_a_command_is_for_people_unless_records_are_json(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # another test of the same run may have called a command, whose log has its name
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    monkeypatch.delenv(FORMAT_VARIABLE, raising=False)
    say("the page is there")
    assert capsys.readouterr().err == "milepost: the page is there\n"
    monkeypatch.setenv(FORMAT_VARIABLE, "json")
    say("the page is there")
    found = json.loads(capsys.readouterr().err)
    assert (found["level"], found["process"], found["message"]) == ("info", "milepost", "the page is there")
    monkeypatch.setenv(LEVEL_VARIABLE, "error")
    say("the page is there")
    assert capsys.readouterr().err == ""


WRITER = """
import sys
from milepost.runtime.logs.records import say, set_up_log
set_up_log(sys.argv[1])
for _ in range(300): say("x" * 200)
"""


def test_lines_of_several_processes_stay_whole() -> None:
    """GIVEN processes that write to one pipe without a buffer, as in a container, THEN none breaks another one's line."""
    environment = {**os.environ, FORMAT_VARIABLE: "json", "PYTHONUNBUFFERED": "1"}
    read, write = os.pipe()
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, str(n)], stderr=write, env=environment) for n in range(4)]
    os.close(write)
    with os.fdopen(read, encoding="utf-8") as pipe:
        found = [json.loads(line) for line in pipe]
    assert [writer.wait(60.0) for writer in writers] == [0] * 4
    assert len(found) == 1200


THREADS = """
import os, threading
from milepost.runtime.logs.output import zenoh_in_log
from milepost.runtime.logs.records import set_up_log
set_up_log("fuser")
with zenoh_in_log():
    thread = threading.Thread(target=lambda: 1 / 0)
    thread.start(); thread.join()
    os.write(1, b"2026-11-28T05:22:01.000001Z  WARN main zenoh::y: closed\\n")
class Raising:
    def __del__(self): raise ValueError("nobody hears")
Raising()
print("as before")
"""


def test_threads_and_zenoh_log_as_the_process_does() -> None:
    """GIVEN records in JSON, WHEN a thread raises and Zenoh writes to standard output, THEN both are records."""
    done = subprocess.run(
        [sys.executable, "-c", THREADS], env={**os.environ, FORMAT_VARIABLE: "json"}, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout) == (0, "as before\n")
    found = [json.loads(line) for line in done.stderr.splitlines()]
    assert [(each["level"], each["process"]) for each in found] == [
        ("error", "fuser"),
        ("warning", "fuser"),
        ("error", "fuser"),
    ]
    assert "ZeroDivisionError" in found[0]["message"]
    assert found[1]["message"] == "Zenoh: main zenoh::y: closed"
    assert "nobody hears" in found[2]["message"]
