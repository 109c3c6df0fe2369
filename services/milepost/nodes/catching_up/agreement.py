"""Which of several answers to believe: the one that most processes of the train give."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TypeVar

from milepost.estimation.time_units import NS_PER_S
from milepost_schemas import Feedback, Gaussian, Part

T = TypeVar("T", bound=Part)
# what each process of the train, by its name, has answered
Answers = Sequence[tuple[str, T]]

# two fused states of one train, an epoch or a few apart, differ by no more than this from their common motion
SAME_M, SAME_MPS, HARDEST_MPS2 = 1.0, 1.0, 10.0
VARIANCES_WITHIN = 10.0


def most_told(answers: Answers[T], known: Collection[str]) -> T | None:
    """The answer that most processes give word by word, the first of several; None where no process of `known` answers."""
    told = [(name, answer) for name, answer in answers if name in known]
    return max((answer for _, answer in told), key=lambda answer: len(_names(told, answer)), default=None)


def most_agreed(answers: Answers[Feedback], known: Collection[str]) -> Feedback | None:
    """The fused state that most processes agree with; of several the one that most give word by word, then the newest."""
    told = [(name, answer) for name, answer in answers if name in known]

    def support(one: Feedback) -> tuple[int, int, int]:
        agreeing = {name for name, other in told if _agree(one, other)}
        return len(agreeing), len(_names(told, one)), one.measured_at_ns

    return max((answer for _, answer in told), key=support, default=None)


def _names(told: Answers[T], answer: T) -> set[str]:
    return {name for name, other in told if other == answer}


def _agree(one: Feedback, other: Feedback) -> bool:
    return same_motion(one.fused, one.measured_at_ns, other.fused, other.measured_at_ns)


def same_motion(a: Gaussian, at_ns: int, b: Gaussian, other_ns: int) -> bool:
    """Whether two fused states are of the same motion, and as sure of it."""
    span_s = (other_ns - at_ns) / NS_PER_S
    spread = HARDEST_MPS2 * abs(span_s)
    if a.states != b.states or abs(b.mean[0] - a.mean[0] - a.mean[1] * span_s) > SAME_M + 0.5 * spread * abs(span_s):
        return False
    if abs(b.mean[1] - a.mean[1]) > SAME_MPS + spread:
        return False
    pairs = [(a.covariance[i][i], b.covariance[i][i]) for i in range(2)]
    return all(x <= VARIANCES_WITHIN * y and y <= VARIANCES_WITHIN * x for x, y in pairs)
