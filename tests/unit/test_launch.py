"""Forked children, each from a process of its own: pytest may have threads, and then nothing may be forked from it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere jobs are spawned as commands")

PROGRAM = """
import os, signal, sys, time
from milepost.config.errors import ConfigError
from milepost.runtime.launch import Job, forked
def job(run, *words): return Job("child", ("run", *words), (), run)
def code_of(run, output=None):
    return os.waitstatus_to_exitcode(os.waitpid(forked(job(run, "fuser"), output), 0)[1])
def fail(error):
    raise error
"""


def parent(body: str, **options: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM + body], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )  # type: ignore[call-overload]


def said(body: str) -> tuple[str, str]:
    out, err = parent(body).communicate(timeout=30)
    return out.strip(), err.strip()


def gone_within(pid: int, seconds: float) -> bool:
    """Whether a process ends (a zombie, which its new parent has not yet buried, has ended)."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        try:
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX":
                return True
        except OSError:
            return True
        time.sleep(0.01)
    return False


def test_a_child_shows_its_role_as_its_title() -> None:
    body = "pid = forked(job(lambda: print('up', flush=True) or time.sleep(60), 'filter', 'radar'), None); os.waitpid(pid, 0)"
    process = parent(body)
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    assert Path(f"/proc/{child}/cmdline").read_bytes().rstrip(b"\0") == b"milepost run filter radar"
    os.kill(int(child), signal.SIGKILL)
    process.communicate(timeout=30)


@pytest.mark.parametrize(
    ("run", "code", "err"),
    [
        ("lambda: None", 0, ""),
        ("lambda: fail(ConfigError('a.yaml', 'units', 'none'))", 2, "milepost: a.yaml: units: none"),
        ("lambda: fail(OSError('no disk'))", 1, "milepost: no disk"),
        ("lambda: fail(MemoryError())", 1, "milepost: out of memory"),
        ("lambda: fail(ValueError('a bug'))", 1, "ValueError: a bug"),
        ("lambda: os.kill(os.getpid(), signal.SIGKILL)", -9, ""),
    ],
    ids=["end", "configuration", "system", "memory", "bug", "killed"],
)
def test_how_a_child_ends_is_its_exit_code(run: str, code: int, err: str) -> None:
    out, shown = said(f"print(code_of({run}))")
    assert out == str(code)
    assert shown.splitlines()[-1:] == ([err] if err else [])


def test_a_child_has_a_session_of_its_own_and_nothing_to_read() -> None:
    out, _ = said("code_of(lambda: print(os.getsid(0) == os.getpid(), repr(sys.stdin.read()), flush=True))")
    assert out == "True ''"


def test_a_childs_output_goes_where_it_is_told(tmp_path: Path) -> None:
    path = tmp_path / "log"
    body = f"file = open({str(path)!r}, 'wb')\n"
    body += "code_of(lambda: print('out') or print('err', file=sys.stderr), file.fileno())"
    assert said(body) == ("", "")
    assert sorted(path.read_text().split()) == ["err", "out"]


def test_signals_have_their_default_actions_in_a_child() -> None:
    body = "from milepost.runtime.stop_signals import StopSignals\n"
    body += "with StopSignals():\n    print(code_of(lambda: os.kill(os.getpid(), signal.SIGTERM)))"
    assert said(body)[0] == "-15"


def test_no_child_outlives_a_killed_parent_even_if_it_ignores_signals() -> None:
    deaf = "lambda: (signal.signal(signal.SIGTERM, signal.SIG_IGN), print(os.getpid(), flush=True), time.sleep(60))"
    process = parent(f"pid = forked(job({deaf}), None); os.waitpid(pid, 0)")
    assert process.stdout is not None
    child = int(process.stdout.readline())
    process.kill()
    assert gone_within(child, 1.0)
    process.communicate(timeout=30)


def test_a_spawned_job_is_the_command_of_the_same_words() -> None:
    body = "from milepost.runtime.launch import spawned\n"
    body += "pid = spawned(Job('x', ('schema',), ('--check', '--out', '/nowhere'), None), None)\n"
    body += "print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))"
    out, err = said(body)
    assert out == "1"
    assert "differs: /nowhere/schemas/json/state-1.schema.json" in err


def test_a_signal_ends_a_wait_and_a_second_one_changes_nothing() -> None:
    body = "from milepost.runtime.stop_signals import StopSignals\n"
    body += "with StopSignals() as stop:\n"
    body += "    print('waiting', flush=True)\n"
    body += "    while not stop.wait(60): pass\n"
    body += "    print('asked', flush=True); sys.stdin.readline(); print(stop.wait(60), flush=True)\n"
    process = parent(body, stdin=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == "waiting\n"
    begun = time.monotonic()
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline() == "asked\n"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate("\n", timeout=30)
    assert (out, err, process.returncode) == ("True\n", "", 0)
    assert time.monotonic() - begun < 10.0
