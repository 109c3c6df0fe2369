"""The runs of a campaign on a Dask cluster; the results are those of the local processes."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

from milepost.config.yaml_files import ConfigError
from milepost.offline.process_pool import Finished, Progress

from .campaign import Executor
from .task import Figures, Task, run_task

CONNECT_S = 10.0
SCHEMES = ("tcp://", "tls://", "ws://", "wss://")
LOGGERS = ("distributed", "distributed.client", "distributed.core")
OPTION = ("campaign", "--dask")


def on_dask(address: str) -> Executor:
    """An executor: the workers of the scheduler at `address`. Raises ConfigError where `distributed` is not installed."""
    if find_spec("distributed") is None:
        raise ConfigError(*OPTION, "needs dask.distributed: pip install 'milepost[dask]'")

    def execute(tasks: Sequence[Task], progress: Progress, finished: Finished[Figures]) -> None:
        if tasks:
            _run(address, tasks, progress, finished)

    return execute


def _run(address: str, tasks: Sequence[Task], progress: Progress, finished: Finished[Figures]) -> None:
    from distributed import as_completed
    from distributed.versions import VersionMismatchWarning

    # each worker refuses a run for which its versions are wrong; others need not be the same
    warnings.simplefilter("ignore", VersionMismatchWarning)
    # what is lost on the way is the scheduler's business until it gives a run up, and then an error here
    for name in LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with _client(address) as client:
        _wait_for_a_worker(client, address)
        futures = client.map(_work, tasks, key=[f"run-{place}-{task.key}" for place, task in enumerate(tasks)])
        places = {future.key: place for place, future in enumerate(futures)}
        done_s = 0.0
        try:
            for future in as_completed(futures, loop=client.loop):
                place = places[future.key]
                finished(place, _result(future, address))
                done_s += tasks[place].duration_s
                progress(done_s)
        except BaseException:
            client.cancel(futures, force=True)
            raise


def _work(task: Task) -> Figures:
    return run_task(task, lambda done_s: None)  # noqa: ARG005


def _client(address: str) -> Any:
    from distributed import Client

    if not address.startswith(SCHEMES):
        raise ConfigError(*OPTION, f"must be like tcp://HOST:PORT, not {address!r}")
    try:
        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(*OPTION, f"no scheduler at {address}") from error


def _wait_for_a_worker(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError as error:
        raise ConfigError(*OPTION, f"the scheduler at {address} has no workers") from error


def _result(future: Any, address: str) -> Figures:
    """A run's figures. Raises ConfigError where the workers cannot make it."""
    from distributed import KilledWorker
    from distributed.client import FutureCancelledError

    try:
        figures: Figures = future.result()
    except ModuleNotFoundError as error:
        raise ConfigError(*OPTION, f"the workers at {address} lack a package: {error}") from error
    except KilledWorker as error:
        raise ConfigError(*OPTION, f"a run ended several workers of {address}, one after another") from error
    except FutureCancelledError as error:
        raise ConfigError(*OPTION, f"the scheduler at {address} has gone") from error
    return figures
