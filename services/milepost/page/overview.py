"""The trains of a fleet as rows of a table, and how many are in which status."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from milepost_schemas import FusedState

from .heard import TrainHeard
from .rows import Fields, Rows
from .words import STATUSES, UNKNOWN, age, figure, kind_word, kmh

# the row beside those of the trains, whose names cannot look like this
FLEET = "#fleet"
MOST_NAMED = 3


def overview(trains: Sequence[TrainHeard], now_ns: int, left_out: int = 0) -> Rows:
    """A row for each train, and one about all."""
    rows = {train.name: _row(train, now_ns) for train in trains}
    counts = Counter(train.status(now_ns) for train in trains)
    told = ", ".join(f"{counts[status]} {words.word}" for status, words in STATUSES.items() if counts[status])
    number = f"{len(trains)} train{'' if len(trains) == 1 else 's'}"
    summary = f"{number}: {told}" if trains else "No train is heard. The list fills by itself."
    return {
        **rows,
        FLEET: {"summary": summary, "left_out": "Not all trains are shown: there are too many." if left_out else ""},
    }


def _row(train: TrainHeard, now_ns: int) -> Fields:
    status = train.status(now_ns)
    words = STATUSES[status]
    state = train.current(now_ns)
    known = state is not None and state.status != "initialising"
    return {
        "name": train.name,
        "line": train.state.line if train.state is not None else UNKNOWN,
        "status": status,
        "level": words.level,
        "word": words.word,
        "position": figure(state.position_m if state else None, 1),
        "speed": kmh(state.speed_mps if state else None),
        "width": figure(state.position_max_m - state.position_min_m if state else None, 1),
        "age": age(train.age_s(now_ns)),
        "note": _note(state) if state is not None and known else "",
    }


def _note(state: FusedState) -> str:
    """What is excluded or doubted, in a few words."""
    notes = [f"{each.unit} {kind_word(each.kind)}" for each in state.excluded]
    if state.doubted:
        notes.append(f"{' or '.join(state.doubted)} doubted")
    more = len(notes) - MOST_NAMED
    return "; ".join([*notes[:MOST_NAMED], *([f"{more} more"] if more > 0 else [])])
