"""The recorder of `milepost up`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from milepost.config.train import Train
from milepost.recorder.library import need_mcap
from milepost.runtime.launch import Job
from milepost.runtime.process import ProcessOptions
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
