"""The processes of each train of `milepost up`, or of several trains that run together, in the order of their start."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from milepost.runtime.launch import ONE_THREAD, Job

from .options import UpOptions

if TYPE_CHECKING:
    from milepost.config.fleet_file import Member
    from milepost.runtime.process import ProcessOptions

# the configuration file of a process's session, by its name
Files = Callable[[str], Path]


@dataclass(frozen=True)
class Crew:
    """The processes of trains that are started at the same time, in seconds after the first ones.

    `awaited`: the labels of all that are to come, those included that somebody else starts.
    """

    trains: list[str]
    lines: list[Path]
    jobs: list[Job]
    start_after_s: float
    awaited: list[str]

    @property
    def called(self) -> str:
        """The trains for people."""
        from milepost.runtime.train_jobs import in_short

        return in_short(self.trains)


def load_crews(options: UpOptions) -> tuple[list[Crew], Files | None]:
    """The crews, in the order of their start, and the session files of a secure train, by name.

    Everything that they need is imported here, once. Raises ConfigError.
    """
    os.environ.update(ONE_THREAD)
    from milepost.config.fleet_file import load_fleet, load_together
    from milepost.runtime.process import ProcessOptions

    members = (
        load_together(options.train_files, options.external) if options.fleet_file is None else load_fleet(options.fleet_file)
    )
    files = None
    if options.secure:
        from milepost.security.bundle import certified

        files = certified(members[0].train, options.state_dir, options.listen)
    members = sorted(members, key=lambda member: member.start_after_s)
    first_s = members[0].start_after_s
    # one train alone, as its file says, needs no name beside those of its processes
    several = len(members) > 1 or bool(members[0].change)
    shared = ProcessOptions(options.endpoints, options.speed, options.duration_s, os.getpid(), options.state_dir)
    crews = []
    for start_after_s, group in groupby(members, key=lambda member: member.start_after_s):
        after_s = (start_after_s - first_s) / options.speed
        if options.together:
            crews.append(_together(list(group), shared, options.record, after_s, several))
            continue
        for member in group:
            process = replace(shared, change=json.dumps(member.change)) if several else shared
            crews.append(_crew(member, process, files, options.record, after_s))
    return crews, files


def _crew(member: Member, shared: ProcessOptions, files: Files | None, record: Path | None, start_after_s: float) -> Crew:
    from milepost.runtime.train_jobs import checked_world, train_jobs

    from ..recording.job import recorder_jobs

    train, external = member.train, member.external
    # it comes first, and scenario time waits for it: what is sent at the beginning is recorded too
    recorder = list(recorder_jobs(train, record, shared, files))
    shared = replace(shared, awaits=tuple(job.name for job in recorder))
    jobs = [*recorder, *train_jobs(train, checked_world(train, shared.duration_s, external), shared, files, external)]
    several = f"{train.name} " if shared.change is not None else ""
    awaited = [*(job.label for job in jobs), *(f"{several}sensor-{unit}" for unit in external)]
    return Crew([train.name], [train.file.line], jobs, start_after_s, awaited)


def _together(
    members: Sequence[Member], shared: ProcessOptions, record: Path | None, start_after_s: float, several: bool
) -> Crew:
    """Trains that start at the same time, in no more processes than there are cores, and one recorder for them all."""
    from milepost.config.roles import processes
    from milepost.runtime.recording.process import NAME
    from milepost.runtime.together.jobs import together_jobs

    from ..recording.job import recorders_job

    jobs = list(recorders_job(members, record, shared, several))
    awaits = (NAME,) if jobs else ()
    names = [
        (member.train.name, name)
        for member in members
        for name in (*awaits, *(p.name for p in processes(member.train, live=True)))
    ]
    jobs += together_jobs(members, shared, awaits, several)
    awaited = [f"{train} {name}" if several else name for train, name in names]
    trains, lines = [member.train.name for member in members], [member.train.file.line for member in members]
    return Crew(trains, lines, jobs, start_after_s, awaited)
