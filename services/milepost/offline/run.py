"""A whole train on the memory bus, as fast as possible and with the same result in every run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from milepost.config.faults import check_faults
from milepost.config.roles import ROLES, Setting, processes
from milepost.config.train import Train
from milepost.config.yaml_files import ConfigError
from milepost.estimation.time_units import NS_PER_S
from milepost.nodes.base import Node
from milepost.nodes.fuser import FuserNode
from milepost.nodes.world import WorldNode
from milepost.simulation.faults import FaultEntry
from milepost_schemas import FusedState, Message

from .collector import rare_collection
from .memory_bus import MemoryBus, Tap

# scenario time 0 of every offline run: a whole second of UTC, so that runs and recordings compare
OFFLINE_START_NS = 1_700_000_000 * NS_PER_S


@dataclass
class OfflineRun:
    """A run of nodes on a memory bus that collects the fuser's settled states."""

    train: Train
    nodes: list[Node]
    tap: Tap | None = None
    settled: Callable[[FusedState], None] | None = None
    bus: MemoryBus = field(init=False)

    def __post_init__(self) -> None:
        fuser = next((node for node in self.nodes if isinstance(node, FuserNode)), None)
        if fuser is None:
            raise ValueError("an offline run needs a fuser")
        self._fuser = fuser
        self.bus = MemoryBus(self.nodes, self.tap, self._settle if self.settled else None)

    def _settle(self, now_ns: int | None) -> None:
        for state in self._fuser.settled_states(now_ns):
            if self.settled:
                self.settled(state)

    def finish(self) -> None:
        """Settle the remaining states."""
        if self.settled:
            self._settle(None)


def simulate(
    train: Train,
    duration_s: float,
    tap: Tap | None = None,
    settled: Callable[[FusedState], None] | None = None,
    progress: Callable[[float], None] | None = None,
    faults: Sequence[FaultEntry] = (),
) -> float:
    """Run all processes of a simulated or replayed train for `duration_s` of scenario time, or until its world ends.

    Returns the scenario time at which it ended, in seconds. `progress` is called with the scenario time done, in seconds.
    `faults`: what goes wrong with units' readings on their way out of the sensors' processes. Raises ConfigError for a train
    without scenario time, and for a fault that does not fit.
    """
    if not train.has_scenario_time:
        raise ConfigError(train.path, "world", "required for an offline run without recordings")
    check_faults(train, faults, train.path, "faults")
    setting = Setting.of(train, "offline", duration_s, OFFLINE_START_NS, tuple(faults))
    nodes = [ROLES[p.role].build(train, p.unit, setting) for p in processes(train)]
    run = OfflineRun(train, nodes, tap, settled)
    end_s = min([duration_s, *(node.end_s for node in nodes if isinstance(node, WorldNode))])
    end_ns = OFFLINE_START_NS + round(end_s * NS_PER_S)
    done = OFFLINE_START_NS
    with rare_collection():
        while done <= end_ns:
            done = min(done + NS_PER_S, end_ns + 1)
            run.bus.run_until(done)
            if progress is not None:
                progress((done - OFFLINE_START_NS) / NS_PER_S)
        run.finish()
    return end_s


def replay(
    train: Train,
    messages: Iterable[tuple[str, str, Message, int]],
    from_estimates: bool,
    settled: Callable[[FusedState], None],
    tap: Tap | None = None,
) -> None:
    """Run filters, balise service and fuser, or the fuser alone, on (stream, unit, message, received_at_ns)."""
    roles = ("fuser",) if from_estimates else ("fuser", "filter", "balise")
    setting = Setting("rerun")
    nodes = [ROLES[p.role].build(train, p.unit, setting) for p in processes(train) if p.role in roles]
    run = OfflineRun(train, nodes, tap, settled)
    now_ns = 0
    with rare_collection():
        for stream, unit, message, received_ns in messages:
            now_ns = max(now_ns, received_ns)
            run.bus.run_until(now_ns)
            run.bus.inject(stream, unit, message, now_ns)
        run.finish()
