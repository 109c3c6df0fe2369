"""All that a fuser knows, in parts, for a replica that was restarted; and whether what comes fits this train."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import msgpack

from milepost.estimation.kept import Kept
from milepost.estimation.observation import FUTURE_NS
from milepost.estimation.time_units import NS_PER_S
from milepost.fusion.rule import FusionRule
from milepost.nodes.catching_up.agreement import same_motion
from milepost.nodes.epochs import BACKLOG_NS, Times
from milepost.nodes.fuser_settings import FuserSettings
from milepost.nodes.telling.decisions import Reported
from milepost.nodes.telling.state_writer import Passed
from milepost.nodes.unit_record import UnitMemory
from milepost_schemas import Feedback, Gaussian, Refused, SnapshotPart, unpack

from .bank import RowsOf, bank_coder, verdict_reported
from .codec import Coder, Misfit, mapping, named, of, record
from .knots import Knots

# a train has moved on since
OLDEST_NS = NS_PER_S
# so many observations are one part: half a millisecond of a fuser's time
KNOTS_A_PART = 250
# what numbers that fit in kind and size may still do to the arithmetic
UNCOMPUTABLE = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)


class Memory(NamedTuple):
    """What a fuser knows beside its observations; `kept` is without them."""

    times: Times
    units: dict[str, UnitMemory]
    passed: tuple[Passed, ...]
    reported: Reported
    feedback: Feedback | None
    kept: Kept


class Snapshots:
    """Packs and opens the snapshots of one train's fusers."""

    def __init__(self, settings: FuserSettings, rows_of: RowsOf) -> None:
        self._settings = settings
        verdict = verdict_reported()
        reported = record(Reported, excluded=mapping(lambda unit: verdict))  # noqa: ARG005
        kept = record(Kept, base=bank_coder(settings, rows_of), knots=of(tuple[()]))
        self._coder: Coder = record(Memory, reported=reported, kept=kept)
        self._knots = Knots(settings)

    def parts(self, memory: Memory, now_ns: int) -> Iterator[SnapshotPart]:
        """The parts, each made when it is asked for. Raises Misfit where something cannot be handed over."""
        knots = memory.kept.knots
        memory = memory._replace(kept=memory.kept._replace(knots=()))
        parts = 1 + -(-len(knots) // KNOTS_A_PART)

        def part(number: int, content: Any) -> SnapshotPart:
            return SnapshotPart(
                fingerprint=self._settings.fingerprint,
                taken_at_ns=now_ns,
                part=number,
                parts=parts,
                content=msgpack.packb(content),
            )

        yield part(0, self._coder.pack(memory))
        for number in range(1, parts):
            first = (number - 1) * KNOTS_A_PART
            yield part(number, self._knots.pack(knots[first : first + KNOTS_A_PART]))

    def opened(self, parts: Sequence[SnapshotPart], now_ns: int) -> Memory:
        """What a replica knew. Raises Refused where it is too old, of another train or code, or does not fit."""
        if not parts or sorted(part.part for part in parts) != list(range(parts[0].parts)):
            raise Refused("incomplete", "parts are missing")
        first = parts[0]
        if any(part.fingerprint != self._settings.fingerprint for part in parts):
            raise Refused("other_settings", "it is from other settings or another version")
        if not -FUTURE_NS <= now_ns - first.taken_at_ns <= OLDEST_NS:
            raise Refused("too_old", f"it is {(now_ns - first.taken_at_ns) / NS_PER_S:.2f} s old")
        contents = [unpack(part.content) for part in sorted(parts, key=lambda part: part.part)]
        try:
            memory: Memory = self._coder.unpack(contents[0])
            knots = [knot for i, each in enumerate(contents[1:]) for knot in named(f"part {i + 1}", self._knots.unpack, each)]
            memory = memory._replace(kept=memory.kept._replace(knots=tuple(knots)))
            self._check_times(memory, first.taken_at_ns)
        except Misfit as misfit:
            raise Refused("invalid", str(misfit)) from None
        return memory

    def _check_times(self, memory: Memory, taken_ns: int) -> None:
        """That everything has happened, and that the next epoch is due. Raises Misfit."""
        latest_ns, times, kept, horizon_ns = taken_ns + FUTURE_NS, memory.times, memory.kept, self._settings.horizon_ns
        stated = [t for t in times._replace(epoch_ns=None, settled_ns=None) if t is not None]
        stated += [t for unit in memory.units.values() for t in (*unit.times[-1:], unit.arrived_ns, unit.received_ns)]
        stated += [t for t in (kept.base_ns, kept.base.since_ns) if t is not None] + [o.measured_at_ns for o in kept.knots]
        if any(t > latest_ns for t in stated):
            raise Misfit("something has not happened yet")
        epoch_ns, period_ns = times.epoch_ns, self._settings.period_ns
        if epoch_ns is None or epoch_ns % period_ns or not -BACKLOG_NS - period_ns <= epoch_ns - taken_ns <= period_ns:
            raise Misfit("the next epoch is not due")
        if not -OLDEST_NS <= kept.boundary_ns - (taken_ns - horizon_ns) <= FUTURE_NS:
            raise Misfit("the settled boundary is elsewhere")
        self._check_order(kept)
        if memory.units.keys() != {row.unit for row in self._settings.units}:
            raise Misfit("the units are others")

    def _check_order(self, kept: Kept) -> None:
        places = [o.place for o in kept.knots]
        if any(later <= earlier for earlier, later in pairwise(places)):
            raise Misfit("the observations are not in order")
        if kept.base_ns is None and not places:
            raise Misfit("there is no observation")
        if kept.base_ns is not None and places and places[0].measured_at_ns < kept.base_ns:
            raise Misfit("an observation is older than what it is added to")


def resume(rule: FusionRule, kept: Kept, agreed: Feedback) -> None:
    """Let a rule continue from what another one holds. Raises Refused where it cannot, or should not; it is then as before."""
    before = rule.kept()
    try:
        rule.resume(kept)
        why = _contradiction(rule, agreed)
    except UNCOMPUTABLE as error:
        why = f"it cannot be continued: {error}"
    if why is not None:
        if before is not None:
            rule.resume(before)
        raise Refused("invalid", why)


def _contradiction(rule: FusionRule, agreed: Feedback) -> str | None:
    """Why the belief that was taken over is not what most processes of the train remember; None where it is."""
    at_ns = agreed.measured_at_ns
    fused = rule.state_at(at_ns, {})
    if fused is None:
        return "it begins after the state that most processes remember"
    belief = Gaussian(states=rule.names, mean=fused.mean, covariance=fused.covariance)
    if not same_motion(belief, at_ns, agreed.fused, at_ns):
        return "it contradicts the state that most processes remember"
    return None
