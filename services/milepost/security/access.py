"""What each process of a train may send and receive, derived from the stream table and the role table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from milepost.config.roles import ROLES, Process, Setting, processes
from milepost.config.train import Train
from milepost.nodes.base import Node
from milepost.recorder.history import STREAMS as HISTORIES
from milepost.sensors.base import World
from milepost_schemas import BY_NAME, ROOT, STREAMS, Stream, alive_key, rpc_key, simulation_start_key

# who has a certificate besides the train's processes
ROUTERS = ("router", "router-2")
# a tool that only reads, one that also sends faults where the train file allows it, and those of `milepost up`
DISPATCH, CHAOS = "dispatch", "chaos"
READERS = (DISPATCH, "display", "observer", "feed", "page")
TOOLS = (*READERS, CHAOS)
# writes down what the others send, and tells how that is going
RECORDER = "recorder"
# procedures of the runtime: who remembers the fused state, all that a fuser knows, and when scenario time began
LATEST, SNAPSHOT, BEGAN = "latest_feedback", "snapshot", "simulation_start"
# beside a cached stream's key: its publisher's cache, heartbeat and token
CACHE = "@adv/**"


@dataclass(frozen=True)
class Access:
    """Key expressions by what may be done on them; what is not listed is refused.

    `sends` and `receives` are samples, `remembers` and `recovers` what goes with streams that have a cache, `shows` and
    `watches` liveliness tokens, `answers` and `asks` procedures. `hears` are the questions that may reach it:
    those to all units.
    """

    name: str
    sends: tuple[str, ...] = ()
    receives: tuple[str, ...] = ()
    remembers: tuple[str, ...] = ()
    recovers: tuple[str, ...] = ()
    shows: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()


def names(train: Train) -> list[str]:
    """Everybody who needs a certificate."""
    return [*ROUTERS, *(process.name for process in processes(train, live=True)), *TOOLS, RECORDER]


def accesses(train: Train) -> list[Access]:
    """The access of every process and tool; routers pass on everything. Raises ConfigError."""
    world = train.world() if train.file.world is not None else None
    trains = [_of_process(train, process, world) for process in processes(train, live=True)]
    return [*trains, *_tools(train), _recorder(train)]


def _of_process(train: Train, process: Process, world: World | None) -> Access:
    role = ROLES[process.role]
    node = role.build(train, process.unit, Setting("access", world, live=True))
    sent = [(BY_NAME[name], process.unit) for name in role.sends(train, process.unit)]
    sent += [(BY_NAME["event"], ""), (BY_NAME["health"], process.name)]
    received = [(BY_NAME[each.stream], each.unit) for each in node.subscriptions]
    answers, asks = _procedures(train, process, node)
    caches = _keys("*", [(stream, "*") for stream, _ in sent if stream.cached])
    return Access(
        process.name,
        sends=_keys(train.name, sent),
        receives=_keys(train.name, received),
        remembers=_keys(train.name, [each for each in sent if each[0].cached]),
        recovers=_keys(train.name, [each for each in received if _is_recovered(each[0])]),
        shows=(alive_key(train.name, process.name),),
        # world waits for all others, the fuser follows who is there, everybody looks for a second instance of itself
        watches=(alive_key(train.name),)
        if node.watches_processes or process.role == "world"
        else (alive_key(train.name, process.name),),
        answers=tuple(answers),
        asks=tuple(asks),
        hears=(*(_of_any_unit(key) for key in answers), *(f"{key}/{CACHE}" for key in caches)),
    )


def _procedures(train: Train, process: Process, node: Node) -> tuple[list[str], list[str]]:
    """The procedures that a process answers, and those that it asks."""
    answers, asks = [], []
    if node.remembers:
        answers.append(rpc_key(train.name, LATEST, process.name))
        asks.append(rpc_key(train.name, LATEST))
    if node.peers:
        answers.append(rpc_key(train.name, SNAPSHOT, process.name))
        asks.append(rpc_key(train.name, SNAPSHOT))
    if train.has_scenario_time and process.role == "world":
        answers.append(simulation_start_key(train.name))
    elif train.has_scenario_time:
        answers.append(rpc_key(train.name, BEGAN, process.name))
        asks.append(simulation_start_key(train.name))
    if train.has_scenario_time:
        # what others remember: `world` after a restart, and whoever doubts what it is told
        asks.append(rpc_key(train.name, BEGAN))
    return answers, asks


def _tools(train: Train) -> Iterator[Access]:
    # of any train: `watch` and `status` show all trains of a router
    streams = [(stream, "*") for stream in STREAMS if stream.name != "chaos"]
    read: dict[str, Any] = {
        "receives": (f"{ROOT}/**", *_keys("*", streams)),
        "recovers": _keys("*", [each for each in streams if each[0].cached]),
        "watches": (alive_key("*"),),
        # what a recorder remembers of the last minutes
        "asks": _keys("*", [(BY_NAME[name], "*") for name in HISTORIES]),
    }
    for name in READERS:
        yield Access(name, **read)
    yield Access(CHAOS, sends=_keys(train.name, [(BY_NAME["chaos"], "*")]) if train.file.chaos else (), **read)


def _recorder(train: Train) -> Access:
    received = [(stream, "*") for stream in STREAMS if stream.recorded]
    event, health = BY_NAME["event"], BY_NAME["health"]
    histories = _keys(train.name, [(BY_NAME[name], "*") for name in HISTORIES])
    return Access(
        RECORDER,
        sends=_keys(train.name, [(event, ""), (health, RECORDER)]),
        receives=_keys(train.name, received),
        remembers=_keys(train.name, [(event, "")]),
        recovers=_keys(train.name, [each for each in received if each[0].cached]),
        shows=(alive_key(train.name, RECORDER),),
        watches=(alive_key(train.name, RECORDER),),
        asks=(simulation_start_key(train.name),) if train.has_scenario_time else (),
        answers=histories,
        hears=(*_keys("*", [(BY_NAME[name], "*") for name in HISTORIES]), f"{event.key_for('*')}/{CACHE}"),
    )


def _of_any_unit(procedure: str) -> str:
    return f"{procedure.rpartition('/')[0]}/*" if "/@rpc/" in procedure else procedure


def _is_recovered(stream: Stream) -> bool:
    return stream.cached > 0 and stream.paced_by == "event"


def _keys(train: str, streams: Sequence[tuple[Stream, str]]) -> tuple[str, ...]:
    """Without repetition: several streams may have one key."""
    return tuple(dict.fromkeys(stream.key_for(train, unit) for stream, unit in streams))
