"""The recorder of `milepost up`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from milepost.config.train import Train
from milepost.recorder.library import need_mcap
from milepost.runtime.launch import Job
from milepost.runtime.zenoh_config import Connection, as_options


def recorder_jobs(
    train: Train, folder: Path | None, endpoints: list[str], files: Callable[[str], Path] | None
) -> Iterator[Job]:
    """The recorder, if there is to be a recording. Raises ConfigError where its library is missing or its folder cannot be."""
    if folder is None:
        return
    need_mcap("up --record")
    from milepost.recorder.recorder import prepare
    from milepost.runtime.recording.process import NAME, RecorderOptions, run_recorder

    prepare(folder)
    connection: Connection = endpoints if files is None else files(NAME)
    options = ("--train", str(train.path), "--record", str(folder), *as_options(connection), "--parent", str(os.getpid()))
    body = partial(run_recorder, train, RecorderOptions(folder, connection, parent=os.getpid()))
    yield Job(NAME, ("run", NAME), options, body)
