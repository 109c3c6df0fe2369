"""`milepost up`: a whole train on this machine."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from pathlib import Path

from milepost.config.roles import ROLES, Setting, processes
from milepost.config.train import load_train
from milepost.config.yaml_files import ConfigError
from milepost.runtime.bus import NoRouterError
from milepost.runtime.listening import listening
from milepost.runtime.process import set_up_log
from milepost.runtime.supervisor import Supervisor, port_is_free, start_train

from .watch import STREAMS, Screen, show

WAIT_FOR_ROUTER_S = 20.0


class _Interrupted(Exception):
    pass


def run_up(
    train_file: Path,
    duration_s: float | None,
    speed: float,
    report: Path | None,
    headless: bool,
    listen: str,
    state_dir: Path | None,
) -> int:
    """Start everything, show it, end it. Raises ConfigError before anything starts."""
    train = load_train(train_file)
    # every process is built once here: what a recording or a motion spoils shows before anything starts
    setting = Setting.of(train, "up", duration_s)
    for process in processes(train):
        ROLES[process.role].build(train, process.unit, setting)
    if report is not None and not report.parent.is_dir():
        raise ConfigError(report, "", "its folder does not exist")
    try:
        free = port_is_free(listen)
    except ValueError as error:
        raise ConfigError("up", "--listen", str(error)) from error
    if not free:
        raise ConfigError("up", "--listen", f"{listen} is in use; is another `milepost up` running?")
    set_up_log("up")

    def interrupted(*_: object) -> None:
        raise _Interrupted

    signal.signal(signal.SIGTERM, interrupted)
    signal.signal(signal.SIGINT, interrupted)
    table = not headless and sys.stdout.isatty()
    log_file = Path(tempfile.gettempdir()) / f"milepost-{os.getpid()}.log" if table else None
    supervisor = Supervisor(log_file)
    screen = Screen()
    if log_file is not None:
        screen.say(f"what the processes say goes to {log_file}")
    scratch = tempfile.TemporaryDirectory(prefix="milepost-")
    stalls = Path(scratch.name) / "stalls.jsonl"
    if report is not None:
        report.unlink(missing_ok=True)
    try:
        start_train(supervisor, train, listen, speed, duration_s, state_dir)
        if report is not None:
            supervisor.start("sentinel", ["sentinel", "--stalls", str(stalls)], restart=False)
            _wait_for_router(listen)
            supervisor.start(
                "observer", ["observe", "--report", str(report), "--stalls", str(stalls), "--connect", listen], restart=False
            )
        if headless:
            _loop(supervisor, screen, None)
        else:
            _wait_for_router(listen)
            with listening([listen], STREAMS, train.name, screen.receive):
                _loop(supervisor, screen, screen)
    except _Interrupted:
        pass
    finally:
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_IGN)
        supervisor.stop()
        scratch.cleanup()
    return 0 if report is None or report.is_file() else 1


def _wait_for_router(endpoint: str) -> None:
    deadline = time.monotonic() + WAIT_FOR_ROUTER_S
    while port_is_free(endpoint):
        if time.monotonic() > deadline:
            raise NoRouterError(f"the router did not begin to listen on {endpoint}")
        time.sleep(0.05)


def _loop(supervisor: Supervisor, screen: Screen, shown: Screen | None) -> None:
    """Until the train's processes have ended by themselves."""

    def going() -> bool:
        for sentence in supervisor.watch():
            screen.say(sentence)
            if shown is None or not sys.stdout.isatty():
                print(f"milepost: {sentence}", file=sys.stderr, flush=True)
        own = [c for c in supervisor.children if c.name not in ("router", "sentinel", "observer")]
        return any(c.running or c.again_at is not None for c in own)

    if shown is not None:
        show(shown, going)
        return
    while going():
        time.sleep(0.2)
