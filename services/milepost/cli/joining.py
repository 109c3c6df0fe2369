"""`milepost up --connect`: whether trains of these names may join a router."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from functools import partial

from milepost.config.errors import ConfigError
from milepost.runtime.launch import Job, launch
from milepost.runtime.zenoh_config import as_options


def may_join(endpoints: list[str], names: Sequence[str]) -> int:
    """0 where no train of these names is running there; else the exit code, after the reason was printed.

    In a process of its own: one that has had a Zenoh session must not fork.
    """
    options = [*as_options(endpoints), *(word for name in names for word in ("--name", name))]
    pid = launch(Job("vacant", ("vacant",), tuple(options), partial(check_vacant, endpoints, names)), None)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def check_vacant(endpoints: list[str], names: Sequence[str]) -> None:
    """Raises ConfigError where a train of one of these names is running, NoRouterError where no router is."""
    from milepost.runtime.bus import open_session
    from milepost.runtime.instances import OVERLAP_S, live_tokens
    from milepost.runtime.zenoh_config import place, tool

    with open_session(tool(endpoints), zenoh_log="off") as session:
        there = {name: live_tokens(session, name) for name in names}
        if any(there.values()):
            time.sleep(OVERLAP_S)  # a train that was just killed keeps its tokens for their lease
        for name, tokens in there.items():
            lasting = tokens & live_tokens(session, name) if tokens else tokens
            if lasting:
                text = f"{name} is running at {place(endpoints)} already ({len(lasting)} processes); names must differ"
                raise ConfigError("up", "--connect", text)
