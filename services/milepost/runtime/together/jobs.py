"""Trains that run together as jobs: no more processes than there are cores, and the trains dealt out over them."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

from milepost.config.fleet_file import Member
from milepost.config.roles import ROLES
from milepost.runtime.launch import ASKED_TO_END, FORKS, Job
from milepost.runtime.process import ProcessOptions
from milepost.runtime.train_jobs import checked_world, command_options, in_short

from .aboard import Boarding
from .process import NAME, run_together


def together_jobs(members: Sequence[Member], shared: ProcessOptions, awaits: tuple[str, ...], several: bool) -> Iterator[Job]:
    """The processes in which trains run, each train whole in one of them. Raises ConfigError.

    `awaits`: whom else each waits for. `several`: the trains' names are said.
    """
    # a command, as it is started where no process can be forked, runs one train
    most = len(os.sched_getaffinity(0)) if FORKS else len(members)
    count = min(most, len(members))
    shared = replace(shared, awaits=awaits)
    for number in range(count):
        own = members[number::count]
        boardings = [_boarding(member, shared) for member in own]
        options = replace(shared, change=json.dumps(own[0].change)) if several else shared
        words = [*command_options(own[0].train, ROLES, options)]
        words += [word for unit in own[0].external for word in ("--external", unit)]
        yield Job(
            NAME,
            ("run", NAME),
            tuple(words),
            partial(_exit_code, boardings, options),
            train=in_short([member.train.name for member in own]) if several else "",
        )


def _boarding(member: Member, options: ProcessOptions) -> Boarding:
    world = checked_world(member.train, options.duration_s, member.external)
    return Boarding(member.train, world, options.duration_s, member.external, options.awaits)


def _exit_code(boardings: Sequence[Boarding], options: ProcessOptions) -> int:
    return ASKED_TO_END if run_together(boardings, options) else 0
