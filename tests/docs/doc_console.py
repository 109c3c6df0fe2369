"""Pages as a reader follows them: files are written, commands are run, and what they print is compared.

A line `...` stands for any lines. A block of a page that starts a train is compared but for its numbers.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from doc_pages import Block

ROOT = Path(__file__).resolve().parents[2]
ENDPOINT = "tcp/127.0.0.1:7447"
ANY = "..."
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
# of figures that are computed: other processors round otherwise
SAME = 0.02
LONGEST_S = 600.0


@dataclass
class Step:
    """A command and what it is to print."""

    command: str
    printed: list[str] = field(default_factory=list)


def steps(block: Block) -> list[Step]:
    """The commands of a `console` block."""
    out: list[Step] = []
    for line in block.lines:
        if line.startswith("$ "):
            out.append(Step(line[2:]))
        elif line:
            out[-1].printed.append(line)
    return out


def alike(shown: str, said: str, live: bool) -> bool:
    """Whether two lines are the same; numbers of a live run may be any, those of others may differ by rounding."""
    if " ".join(NUMBER.sub("#", shown).split()) != " ".join(NUMBER.sub("#", said).split()):
        return False
    pairs = zip(map(float, NUMBER.findall(shown)), map(float, NUMBER.findall(said)), strict=True)
    return live or all(abs(a - b) <= SAME * max(abs(a), abs(b)) for a, b in pairs)


def matches(shown: list[str], said: list[str], live: bool) -> bool:
    """Whether the lines shown are those said, with `...` for any lines."""
    if not shown:
        return not said
    if shown[0] == ANY:
        return any(matches(shown[1:], said[i:], live) for i in range(len(said) + 1))
    return bool(said) and alike(shown[0], said[0], live) and matches(shown[1:], said[1:], live)


class Reader:
    """Somebody with an empty folder, who does what pages say. Routers listen on another port than the pages name."""

    def __init__(self, folder: Path, port: int) -> None:
        self.folder, self.port = folder, port
        self.endpoint = ENDPOINT.replace("7447", str(port))
        self.trains: list[subprocess.Popen[str]] = []
        programs = folder / ".bin"
        programs.mkdir()
        for name, words in (("milepost", "-m milepost"), ("python", ""), ("pytest", "-m pytest -p no:cacheprovider")):
            path = programs / name
            path.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {words} "$@"\n', encoding="utf-8")
            path.chmod(0o755)
        paths = [str(ROOT / "services"), str(ROOT / "schemas")]
        self.environment = {
            **os.environ,
            "PATH": os.pathsep.join([str(programs), os.environ["PATH"]]),
            "PYTHONPATH": os.pathsep.join(paths),
            "MILEPOST_CONNECT": self.endpoint,
            "MILEPOST_STATE_DIR": str(folder / ".state"),
        }

    def write(self, files: Mapping[str, str]) -> None:
        """Write files of a page."""
        for name, text in files.items():
            (self.folder / name).write_text(text.replace("7447", str(self.port)), encoding="utf-8")

    def follow(self, step: Step, live: bool) -> None:
        """Run a command to its end; a train without `--duration` goes on."""
        words = shlex.split(step.command)
        if words[:2] == ["milepost", "up"]:
            words += ["--listen", self.endpoint]
            if "--duration" not in words:
                self._depart([*words, "--headless"])
                return
        deadline = time.monotonic() + LONGEST_S / 4
        while True:
            code, said = self._run(words)
            fits = code == 0 and (not step.printed or matches(step.printed, [line for line in said.splitlines() if line], live))
            # a page shows trains that are under way; how long they take to that is no matter of the page
            if fits or words[:2] != ["milepost", "status"] or time.monotonic() > deadline:
                break
        assert fits, f"$ {step.command}: exit code {code}\n{said[-4000:]}"

    def _run(self, words: list[str]) -> tuple[int, str]:
        """The exit code of a command, and all that it says."""
        done = subprocess.run(
            words,
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
        return done.returncode, done.stdout

    def _depart(self, words: list[str]) -> None:
        log = (self.folder / ".train").open("w", encoding="utf-8")
        train = subprocess.Popen(words, cwd=self.folder, env=self.environment, stdout=log, stderr=subprocess.STDOUT, text=True)
        log.close()
        self.trains.append(train)
        deadline = time.monotonic() + LONGEST_S / 4
        while self._run(["milepost", "status"])[0]:
            assert train.poll() is None, (self.folder / ".train").read_text(encoding="utf-8")
            assert time.monotonic() < deadline, (self.folder / ".train").read_text(encoding="utf-8")

    def leave(self) -> Iterator[int]:
        """End what still runs as a reader does, with Ctrl-C; the exit codes."""
        for train in self.trains:
            train.send_signal(signal.SIGINT)
        for train in self.trains:
            yield train.wait(60.0)
