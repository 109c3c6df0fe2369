"""Which of three fusers have a vote: one that contradicts the others for some epochs loses it, and earns it again."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field

# so many epochs in a row decide: two fusers may differ in one, where a reading came to one of them in time and not to the other
EPOCHS_OUT = 3


@dataclass(slots=True)
class Standing:
    """The standing of a fuser: `out` while it has no vote; epochs in a row in which it differed, and in which it agreed.

    `contradicted`: it said something else, not just nothing.
    """

    out: bool = False
    differed: int = 0
    agreed: int = 0
    contradicted: bool = False


@dataclass(slots=True)
class Standings:
    """The standings of all fusers.

    One that is out must agree with one that is not: in `epochs_in` epochs in a row where it contradicted the others, in three
    where it was only silent or late.
    """

    fusers: Sequence[str]
    epochs_in: int
    of: dict[str, Standing] = field(init=False)

    def __post_init__(self) -> None:
        self.of = {fuser: Standing() for fuser in self.fusers}

    @property
    def voting(self) -> list[str]:
        """The fusers that have a vote."""
        return [fuser for fuser, standing in self.of.items() if not standing.out]

    def judge(self, agrees: Mapping[str, bool], heard: Container[str], decided: bool) -> tuple[list[str], list[str]]:
        """Note an epoch: who agreed with another that votes, who was heard. Returns who loses the vote, and who has it again.

        In an epoch that was not `decided` nobody can be said to be wrong.
        """
        lost, regained = [], []
        for fuser, standing in self.of.items():
            if standing.out:
                standing.agreed = standing.agreed + 1 if agrees[fuser] else 0
                standing.contradicted |= fuser in heard and not agrees[fuser]
                if standing.agreed >= (self.epochs_in if standing.contradicted else min(EPOCHS_OUT, self.epochs_in)):
                    self.of[fuser] = Standing()
                    regained.append(fuser)
            elif decided:
                standing.differed = 0 if agrees[fuser] else standing.differed + 1
                if standing.differed >= EPOCHS_OUT:
                    self.of[fuser] = Standing(out=True, contradicted=fuser in heard)
                    lost.append(fuser)
        return lost, regained
