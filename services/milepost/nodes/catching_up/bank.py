"""The bank of hypotheses as what msgpack can hold, for the fusers of one train: of another train's none fits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from milepost.estimation.noise.learner import Learned
from milepost.fusion.bank_state import Bank, Channel
from milepost.fusion.evidence import TESTS
from milepost.fusion.hypotheses import CHANNELS, MOTION_MODEL, Rows, Units
from milepost.fusion.verdicts import Verdict
from milepost.nodes.fuser_settings import FuserSettings
from milepost.nodes.judges import UnitJudge

from .codec import FLOAT, INT, NONE, TEXT, Coder, Misfit, a_set, array, either, fixed, like, mapping, of, record, sequence

# the rows that follow from what is excluded, what explains it otherwise, and what was blamed
RowsOf = Callable[[Units, frozenset[Units], Units], Rows]
# what a unit may have said last: see `fusion.readings.said_by`
SAID = either(NONE, FLOAT, INT, sequence(list, FLOAT), sequence(tuple, FLOAT))
# scaled to a unit diagonal, a covariance has no eigenvalue below this: rounding
LEAST_EIGENVALUE = -1e-6


def bank_coder(settings: FuserSettings, rows_of: RowsOf) -> Coder:
    """The coder of a train's bank. Raises Misfit for a judge's memory whose kinds cannot be told."""
    n = settings.layout.dimension
    channel = record(Channel, sums=array(float, (len(TESTS), None)), nu=array(float, (None,)), strikes=array(np.int_, (None,)))
    flags = array(bool, (None,))
    coder = record(
        Bank,
        beliefs=array(float, (n + 1, n + 1, None)),
        channels=fixed(
            lambda *each: each, tuple, {str(place): channel for place in range(CHANNELS * len(settings.doubts.suspects))}
        ),
        verdicts=_verdicts(settings),
        rows=_rows(settings, rows_of),
        alive=flags,
        waiting=either(NONE, flags),
    )
    needed = {*settings.doubts.by_unit, *settings.judges, MOTION_MODEL}
    return Coder(coder.pack, lambda value: _sound(coder.unpack(value), needed))


def _verdicts(settings: FuserSettings) -> Coder:
    known: dict[str, UnitJudge | None] = {MOTION_MODEL: None, **{row.unit: None for row in settings.units}}
    coders = {unit: _verdict(judge) for unit, judge in {**known, **settings.judges}.items()}

    def of_unit(unit: str) -> Coder:
        if unit not in coders:
            raise Misfit(f"{unit} is no unit of this train")
        return coders[unit]

    return mapping(of_unit)


def _verdict(judge: UnitJudge | None) -> Coder:
    noise = of(tuple[()])
    if judge is not None and judge.learner is not None:
        learned = record(Learned, memory=like(judge.learner.begin(np.ones(1)), first_axis=True))
        noise = sequence(tuple, learned)
    return record(Verdict, memory=NONE if judge is None else like(judge.start()), said=SAID, noise=noise)


def verdict_reported() -> Coder:
    """The coder of what was reported of a unit: without what its judge remembers."""
    return record(Verdict, memory=NONE, said=NONE, noise=of(tuple[()]))


def _rows(settings: FuserSettings, rows_of: RowsOf) -> Coder:
    """Rows follow from three sets of units."""
    units = a_set(TEXT)
    kinds = {"excluded": units, "alternatives": a_set(units), "blamed": units}
    sets = fixed(lambda *each: each, tuple, kinds)
    known = {*settings.doubts.by_unit, MOTION_MODEL}

    def pack(rows: Rows) -> Any:
        return sets.pack((rows.excluded, rows.alternatives, rows.blamed))

    def unpack(value: Any) -> Any:
        excluded, alternatives, blamed = sets.unpack(value)
        if not known >= excluded.union(blamed, *alternatives):
            raise Misfit("a unit that is no suspect of this train")
        try:
            return rows_of(excluded, alternatives, blamed)
        except ArithmeticError:
            raise Misfit("what is blamed cannot be at all") from None

    return Coder(pack, unpack)


def _sound(bank: Bank, needed: set[str]) -> Bank:
    """The bank, if its parts fit each other and its beliefs are beliefs. Raises Misfit."""
    H = len(bank.rows.sets)
    lengths = {
        "beliefs": bank.beliefs.shape[2],
        "alive": len(bank.alive),
        "dead_ns": len(bank.dead_ns),
        "waiting": H if bank.waiting is None else len(bank.waiting),
        **{f"channel {i}": n for i, c in enumerate(bank.channels) for n in (c.sums.shape[1], len(c.nu), len(c.strikes))},
    }
    for name, length in lengths.items():
        if length != H:
            raise Misfit(f"{name}: {H} rows expected, not {length}")
    if not needed <= bank.verdicts.keys():
        raise Misfit(f"verdicts: no {min(needed - bank.verdicts.keys())}")
    for unit, verdict in bank.verdicts.items():
        if not all(size in (1, H) for noise in verdict.noise for size in _first_axes(noise.memory)):
            raise Misfit(f"verdicts: {unit}: what was learned is not of {H} rows")
    if not 0 <= bank.leader < H or not bank.alive.any() or any(c.readings < 0 for c in bank.channels):
        raise Misfit("no row that leads")
    if not _beliefs(bank):
        raise Misfit("a belief is none")
    return bank


def _first_axes(memory: Any) -> list[int]:
    if isinstance(memory, tuple):
        return [size for part in memory for size in _first_axes(part)]
    return [len(memory)]


def _beliefs(bank: Bank) -> bool:
    """Whether all numbers are finite, and all covariances symmetric and positive semi-definite but for rounding."""
    x, P = bank.x, bank.P
    if not np.isfinite(bank.beliefs).all() or bank.beliefs[-1, -1].any() or not np.array_equal(bank.beliefs[-1, :-1].T, x):
        return False
    variances = np.diagonal(P, axis1=1, axis2=2)
    if (variances < 0.0).any():
        return False
    std = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    scaled = P / std[:, :, None] / std[:, None, :]
    if np.abs(scaled - scaled.transpose(0, 2, 1)).max() > -LEAST_EIGENVALUE:
        return False
    return bool(np.linalg.eigvalsh(scaled).min() > LEAST_EIGENVALUE)
