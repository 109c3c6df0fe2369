"""The state of the bank of hypotheses, and how its rows are taken over."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from milepost.estimation.layout import Array

from .evidence import TESTS, Flags, statistics, usual, worst_by_chance
from .hypotheses import CHANNELS, Rows
from .verdicts import Reset, Verdict

# evidence beyond 10⁻⁴ tells no more: then the row is about to be refuted
RAREST = 4


class Channel(NamedTuple):
    """What the tests keep of one row of a unit's readings, for each of H hypotheses.

    `sums` (7, H) over the windows; of so many `readings`; `nu` (H) the last innovations; `strikes` (H) of readings in
    a row that were refused by themselves.
    """

    sums: Array
    readings: int
    nu: Array
    strikes: NDArray[np.int_]

    @classmethod
    def begin(cls, H: int) -> Channel:
        """Nothing was heard yet."""
        return cls(np.zeros((len(TESTS), H)), 0, np.zeros(H), np.zeros(H, dtype=int))

    def fresh(self) -> Channel:
        """The tests begin again."""
        return self._replace(sums=np.zeros_like(self.sums), readings=0, strikes=np.zeros_like(self.strikes))

    def of(self, index: list[int]) -> Channel:
        """The sums and innovations of other rows, each the continuation of the row `index`."""
        return self._replace(sums=self.sums[:, index], nu=self.nu[index])

    def struck(self, odd: Flags) -> Channel:
        """One more strike where a reading is odd, none where it is not."""
        return self._replace(strikes=np.where(odd, self.strikes + 1, 0))


class Bank(NamedTuple):
    """The kernel's state: H hypotheses over n states, and what was heard of each unit.

    `beliefs` (n + 1, n + 1, H) as `joined` makes them; `alive` (H): not refuted; `dead_ns` (H): when refuted, 0 for those
    alive. `channels`: for the tests, apart, so that states share what does not change. `leader`: the row that is published.
    `since_ns`: the time of the first observation that counted. `waiting` (H): rows that have heard none of their units in the
    `waited_s` since, None where there are none. `wary_until_ns`: how long what explains an exclusion otherwise is published
    after the unit was readmitted.
    """

    beliefs: Array
    channels: tuple[Channel, ...]
    verdicts: Mapping[str, Verdict]
    rows: Rows
    alive: Flags
    dead_ns: tuple[int, ...]
    leader: int = 0
    since_ns: int | None = None
    reset: Reset | None = None
    waiting: Flags | None = None
    waited_s: float = 0.0
    wary_until_ns: int = 0

    # what each reading changes comes first, and is changed by these: `_replace` takes four times as long

    def moved(self, beliefs: Array) -> Bank:
        """With other beliefs."""
        return Bank(beliefs, *self[1:])

    def tested(self, beliefs: Array, place: int, channel: Channel) -> Bank:
        """With other beliefs and another channel at a place."""
        channels = self.channels
        return Bank(beliefs, (*channels[:place], channel, *channels[place + 1 :]), *self[2:])

    def judged(self, unit: str, verdict: Verdict) -> Bank:
        """With another verdict on a unit."""
        return Bank(self.beliefs, self.channels, {**self.verdicts, unit: verdict}, *self[3:])

    @property
    def x(self) -> Array:
        """The means (H, n)."""
        return self.beliefs[:-1, -1].T

    @property
    def P(self) -> Array:  # noqa: N802
        """The covariances (H, n, n)."""
        return self.beliefs[:-1, :-1].transpose(2, 0, 1)

    def innovations(self, row: int) -> list[float]:
        """The last innovation of each channel in a row."""
        return [float(channel.nu[row]) for channel in self.channels]

    def of(self, index: list[int]) -> Bank:
        """With what other rows believe and learned, each the continuation of the row `index`."""
        return self._replace(
            beliefs=self.beliefs.take(index, axis=2),
            channels=tuple(channel.of(index) for channel in self.channels),
            verdicts={u: v.continued(index) if v.noise else v for u, v in self.verdicts.items()},
            waiting=None if self.waiting is None else self.waiting[index],
        )

    @property
    def doubted(self) -> tuple[str, ...]:
        """The units of which one lies, while nothing tells which."""
        if self.alive[0]:
            return ()
        plausible = self.rows.plausible(self.alive)
        sets = [units - self.rows.excluded for units, held in zip(self.rows.sets, plausible, strict=True) if held]
        return tuple(sorted(frozenset().union(*sets)))


def recomposed(state: Bank, rows: Rows, index: list[int]) -> Bank:
    """The bank with other rows, each the continuation of the old row `index`."""
    H = len(rows.sets)
    state = state.of(index)
    return state._replace(
        rows=rows,
        channels=tuple(channel._replace(strikes=np.zeros(H, dtype=int)) for channel in state.channels),
        alive=np.ones(H, dtype=bool),
        dead_ns=(0,) * H,
        leader=0,
    )


def narrowed(state: Bank, rows: Rows) -> Bank:
    """The bank with some of its rows, the leading one among them."""
    old = state.rows
    index = [old.places[units] for units in rows.sets]
    out = state.of(index)
    return out._replace(
        rows=rows,
        channels=tuple(channel._replace(strikes=channel.strikes[index]) for channel in out.channels),
        alive=state.alive[index],
        dead_ns=tuple(state.dead_ns[i] for i in index),
        leader=rows.places[old.sets[state.leader]],
    )


def led(before: Bank, state: Bank, row: int, at_ns: int, reason: str) -> Bank:
    """Another row leads; a step from `before` that is larger than the new row's own uncertainty is noted.

    `before`: without the observation that decided, which was never published.
    """
    old, new = before.x[before.leader], state.x[row]
    step_m, step_mps = float(new[0] - old[0]), float(new[1] - old[1])
    variances = np.diagonal(state.P[row])
    far = abs(step_m) > 2.0 * math.sqrt(variances[0]) or abs(step_mps) > 2.0 * math.sqrt(variances[1])
    return state._replace(leader=row, reset=Reset(at_ns, step_m, step_mps, reason) if far else state.reset)


def protected(state: Bank) -> tuple[tuple[float, float], tuple[float, float]]:
    """[min, max] of position and of speed over the hypotheses that are not refuted: the union of x_h ± K_h σ_h.

    The rarer by noise alone the tests of the row that leads are, the likelier is each other hypothesis.
    """
    held, K = state.rows.intervals(state.alive, state.leader, rarity(state))
    centre, variances = state.beliefs[:2, -1][:, held], state.beliefs[(0, 1), (0, 1)][:, held]
    if state.waiting is not None:
        # a row that is about to begin may still be where it was at the first reading of all, whose clock may be behind
        begins = (state.waiting & ~state.rows.deaf)[held]
        variances[0] += np.where(begins, (centre[1] * state.waited_s) ** 2, 0.0)
    reach = K * np.sqrt(variances)
    (low, slow), (high, fast) = (centre - reach).min(axis=1).tolist(), (centre + reach).max(axis=1).tolist()
    return (low, high), (slow, fast)


def rarity(state: Bank) -> int:
    """r: by noise alone the worst test over all units that the leading row uses is as bad in one of 10ʳ cases."""
    row, channels = state.leader, state.channels
    used = [channels[i] for i in state.rows.channels(row) if channels[i].readings]
    if not used:
        return 0
    tests, counts = (len(TESTS) - 1) * len(used), [channel.readings for channel in used]
    sums = np.array([channel.sums[:, row] for channel in used]).T
    if not np.count_nonzero(np.abs(sums[1:]) > usual(tests).of(counts)[1:]):
        # most often: then by how much does not matter
        return 0
    (chance,) = worst_by_chance(np.array([statistics(sums, counts)[1:].max()]), np.array([tests]))
    return int(-math.log10(max(chance, 10.0**-RAREST)))


def by_chance(state: Bank) -> Array:
    """For each row, the probability that the worst test over all units that it uses is as bad by noise alone."""
    suspects = state.rows.doubts.suspects
    heard = [(suspects[i // CHANNELS].unit, channel) for i, channel in enumerate(state.channels) if channel.readings]
    if not heard:
        return np.ones(len(state.alive))
    sums, H = np.concatenate([channel.sums for _, channel in heard], axis=1), len(state.alive)
    # without the first test: the last reading alone is no evidence of long standing
    told = statistics(sums, np.repeat([channel.readings for _, channel in heard], H))[1:]
    uses = np.array([state.rows.uses(unit) for unit, _ in heard])
    worst = np.where(uses, told.max(axis=0).reshape(-1, H), 0.0).max(axis=0)
    return worst_by_chance(worst, len(told) * uses.sum(axis=0))


def likeliest(state: Bank, rows: Flags) -> int:
    """The row of these with the best odds: its probability, times that of a worst test as bad as its units' by chance.

    A deaf row is where it was predicted to be, and nothing tells against it: it is chosen only where no other
    one is left.
    """
    hearing = rows & ~state.rows.deaf
    odds = state.rows.chances * by_chance(state)
    return int(np.argmax(np.where(hearing if hearing.any() else rows, odds, -1.0)))
