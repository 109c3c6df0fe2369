"""One run of a campaign: a train on one seed with its faults, and what was measured on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from milepost.config.shipped_files import find_file
from milepost.config.train import Train, load_train
from milepost.config.yaml_files import ConfigError
from milepost.offline.process_pool import Cancelled
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry

from .epoch import Spell
from .exclusions import Slips, grips
from .fingerprint import code_fingerprint, digest, train_fingerprint
from .measure import measure
from .watch import Watch

Figures = dict[str, Any]


@dataclass(frozen=True)
class Task:
    """A run: the campaign's entry `train`, its file by name or path with `change`, the seed, and the faults.

    `faults` are the fields of FaultEntry, `labels` what the campaign calls them. `inputs` and `code` are the fingerprints of
    the train's files and of the code with which the run is meant to be made.
    """

    train: str
    file: str
    duration_s: float
    onset_s: float
    seed: int
    inputs: str
    code: str
    change: dict[str, Any] = field(default_factory=dict)
    faults: tuple[dict[str, Any], ...] = ()
    labels: tuple[str, ...] = ()

    @property
    def units(self) -> tuple[str, ...]:
        """The units that have a fault."""
        return tuple(str(fault["unit"]) for fault in self.faults)

    @property
    def key(self) -> str:
        """A hash of all that the figures depend on; where the train file lies is not part of it."""
        parts = (self.duration_s, self.onset_s, self.seed, self.inputs, self.code, self.change, self.faults)
        return digest(parts)

    def as_dict(self) -> dict[str, Any]:
        """What a person needs to find the run in a file of results."""
        return {
            "train": self.train,
            "units": list(self.units),
            "faults": list(self.labels),
            "seed": self.seed,
            "code": self.code,
        }


def run_task(task: Task, progress: Callable[[float], None]) -> Figures:
    """The figures of a run; `crashed` alone, with the reason, where a node failed.

    Raises ConfigError where this machine has other code or other files than the task was made for, or a file is wrong.
    """
    path = find_file(Path(task.file), "trains")
    if not path.is_file():
        raise ConfigError(path, "", "a worker has no such file")
    if task.code != code_fingerprint():
        raise ConfigError(path, "", "a worker has another version of Milepost, Python or numpy than this command")
    if task.inputs != train_fingerprint(path):
        raise ConfigError(path, "", "a worker has another version of this train's files than this command")
    train = load_train(path, task.change, task.seed)
    entries = [FaultEntry.model_validate(fault) for fault in task.faults]
    watch = Watch({balise.balise_id: balise.location_accuracy_m for balise in train.line.balises})
    try:
        simulate(train, task.duration_s, watch.tap, None, progress, entries)
    except (ConfigError, Cancelled):
        raise
    except Exception as error:  # a fault that stops a node is a result, not the end of the campaign
        return {"crashed": " ".join(f"{type(error).__name__}: {error}".split())}
    spells = [Spell(entry.unit, entry.from_s, entry.to_s, _acts(entry, train, watch)) for entry in entries]
    return measure(watch, spells, task.onset_s, list(train.sensors), _slips(train, task.duration_s))


def _slips(train: Train, duration_s: float) -> Slips:
    """Which wheels slip when, where the train is simulated."""
    # the motion takes time to build, so only where wheels slip
    creep = train.world(duration_s).creep if train.file.world is not None and train.file.world.creep is not None else None
    wheels = {unit for unit, sensor in train.sensors.items() if sensor.slip_probability > 0.0}
    return grips if creep is None else lambda unit, t_s: unit in wheels and creep.at(unit, t_s) != 0.0


def _acts(entry: FaultEntry, train: Train, watch: Watch) -> bool:
    """Whether a fault has anything to act on: that of a balise reader, only where the train passes a balise meanwhile."""
    if train.sensors[entry.unit].stream != "balise_telegram":
        return True
    passed_m = [place for at_s, (place, _) in watch.truth.items() if entry.from_s <= at_s < entry.to_s]
    wanted = getattr(entry.options(), "balise", None)
    places_m = [balise.position_m for balise in train.line.balises if wanted in (None, balise.balise_id)]
    return bool(passed_m) and any(min(passed_m) <= place <= max(passed_m) for place in places_m)
