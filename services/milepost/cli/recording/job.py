"""The recorder of `milepost up`."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from milepost.config.fleet_file import Member
from milepost.config.train import Train
from milepost.recorder.library import need_mcap
from milepost.runtime.launch import FORKS, Job
from milepost.runtime.process import ProcessOptions
from milepost.runtime.train_jobs import in_short
from milepost.runtime.zenoh_config import Connection, as_options


def recorder_jobs(
    train: Train, folder: Path | None, shared: ProcessOptions, files: Callable[[str], Path] | None
) -> Iterator[Job]:
    """The recorder of a train, if there is to be a recording; `shared` is what its processes are told.

    Raises ConfigError where its library is missing or its folder cannot be.
    """
    if folder is None:
        return
    need_mcap("up --record")
    from milepost.recorder.recorder import prepare
    from milepost.runtime.recording.process import NAME, RecorderOptions, run_recorder

    prepare(folder)
    connection: Connection = shared.connection if files is None else files(NAME)
    several = shared.change is not None
    options = ["--train", str(train.path), "--record", str(folder), *as_options(connection), "--parent", str(os.getpid())]
    if shared.change is not None:
        options += ["--change", shared.change]
    body = partial(run_recorder, train, RecorderOptions(folder, connection, parent=os.getpid(), several=several))
    yield Job(NAME, ("run", NAME), tuple(options), body, train=train.name if several else "")


def recorders_job(members: Sequence[Member], folder: Path | None, shared: ProcessOptions, several: bool) -> Iterator[Job]:
    """One recorder for trains that run together, each train with files of its own. Raises ConfigError."""
    if folder is None:
        return
    need_mcap("up --record")
    from milepost.recorder.recorder import prepare
    from milepost.runtime.recording.process import NAME, RecorderOptions, run_recorders

    prepare(folder)
    if len(members) == 1 or not FORKS:
        for member in members:
            own = replace(shared, change=json.dumps(member.change)) if several else shared
            yield from recorder_jobs(member.train, folder, own, None)
        return
    trains = [member.train for member in members]
    name = in_short([train.name for train in trains])
    options = RecorderOptions(folder, shared.connection, parent=os.getpid(), several=True)
    yield Job(NAME, ("run", NAME), (), partial(run_recorders, trains, options), train=name)
