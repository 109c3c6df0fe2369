"""Which satellite fixes count, judged by what they say, by the ones before them and by the line alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from .fix_motion import MotionTest, Run, SeenFix, Still, extended

RTK = ("rtk_fixed", "rtk_float")
# silence longer than this interrupts a proof, and counts as no more coasting than this
GAP_S = 2.0
# the mean distance from the track is taken over so long, and over so many fixes at least
MEAN_S, MEAN_FIXES = 2.0, 3


class Verdict(NamedTuple):
    """Why a fix does not count (None: it does), and what its standard deviation is multiplied with."""

    refused: str | None
    std_factor: float = 1.0


@dataclass(frozen=True, slots=True)
class FixLimits:
    """Limits of the monitor.

    `cross_track_m`: a fix farther from the track than this, and than `sigmas` standard deviations, is not this train's; nor
    are those whose mean over 2 s is farther than half of it.
    `jump_sigmas`: how many standard deviations a fix errs by at most where motions are judged; more than `sigmas`, because
    each fix is in many differences, and a refusal costs a proof.
    `coasting_s`: after so long without a solution of its own, RTK in between taken off, a receiver is suspect; `proof_s`:
    until its fixes were sound for so long without a break. `max_acceleration_mps2`: of any train (trams with magnetic track
    brakes reach 3). `course_deg`: between course and track.
    `alone_above`, `least`: source C's satellite numbers: a stand-alone solution is good with more than the first, and none
    is with fewer than the second. `poor_factor`: on the standard deviation of a stand-alone solution with fewer.
    """

    cross_track_m: float = 10.0
    sigmas: float = 4.0
    jump_sigmas: float = 5.0
    coasting_s: float = 5.0
    proof_s: float = 6.0
    max_acceleration_mps2: float = 3.0
    course_deg: float = 20.0
    alone_above: int = 10
    least: int = 4
    poor_factor: float = 2.0

    def farthest_m(self, std_m: float) -> float:
        """How far from the track a fix may lie."""
        return max(self.cross_track_m, self.sigmas * std_m)


class Memory(NamedTuple):
    """What the monitor remembers: never changed, replaced at each fix.

    `heard_s`: time of the newest fix. `coasted_s`: coasting that RTK has not made up for. `suspect`, `proof_since_s`: RTK
    does not count until it is proved; since when it is being proved. `run`: the newest fixes that agree with each other.
    `apart`: those that agree with each other but not with the run; before a jump of RTK, the run that it left. `still`: how
    the output stands still.
    """

    heard_s: float | None = None
    coasted_s: float = 0.0
    suspect: bool = False
    proof_since_s: float | None = None
    run: Run = ()
    apart: Run = ()
    still: Still | None = None

    def doubted(self) -> Memory:
        """The same where RTK has to prove itself."""
        return self._replace(suspect=True, proof_since_s=None)


class FixMonitor:
    """A receiver's word for its solution is a claim: what calls itself RTK has to prove it after every long gap.

    Receivers that coast through a tunnel go on calling some fixes RTK-fixed while they drift hundreds of metres away,
    smoothly and in runs of several seconds; true RTK comes back to stay. So after `coasting_s` of coasting, in one piece or
    several, RTK counts only once it was sound for `proof_s` at a stretch. Sound: on the line, near the track by each fix and
    by their mean, along it, and moving as a train can (`fix_motion`). RTK that moves as no train can, lies beside the track
    for long, or repeats a position that no train can have stopped at, has to prove itself too.
    Another solution claims little and proves nothing: a fix counts or not by its satellites, its distance from the track and
    whether a train can have come there from the fixes before. Those that contradict them count once they have agreed with
    each other for `proof_s`, or for as long as the ones before.
    Silence is not coasting. A fix that is not later than the last teaches nothing: it is judged by itself and by the trust
    that the receiver has. `memory` is all that is remembered: who sets it to an earlier value continues from there.
    `known`: the solutions that count. `length_m`: of the line. `turning`: of the line between two chainages, in radians.
    Source: C, its satellite monitor, whose verdict is one of several here; the rest is ours, from recorded logs.
    """

    def __init__(
        self,
        limits: FixLimits,
        known: Mapping[str, float],
        length_m: float = math.inf,
        turning: Callable[[float, float], float] = lambda from_m, to_m: 0.0,  # noqa: ARG005
    ) -> None:
        self._limits, self._known, self._length_m = limits, known, length_m
        self._motion = MotionTest(limits.max_acceleration_mps2, limits.jump_sigmas, turning)
        self.memory = Memory()

    @property
    def suspect(self) -> bool:
        """Whether RTK has to prove itself."""
        return self.memory.suspect

    def doubt(self) -> None:
        """Let RTK prove itself from here on."""
        self.memory = self.memory.doubted()

    def judge(self, fix: SeenFix) -> Verdict:
        """The verdict on the next fix."""
        memory = self.memory
        if memory.heard_s is not None and fix.t_s <= memory.heard_s:
            reason = self._late(fix)
        else:
            since_s = 0.0 if memory.heard_s is None else min(fix.t_s - memory.heard_s, GAP_S)
            reason, self.memory = self._next(memory._replace(heard_s=fix.t_s), fix, since_s)
        if reason is not None:
            return Verdict(reason)
        few = fix.solution == "single" and fix.satellites is not None and fix.satellites <= self._limits.alone_above
        return Verdict(None, self._limits.poor_factor if few else 1.0)

    def _late(self, fix: SeenFix) -> str | None:
        if fix.solution not in self._known:
            return "solution"
        # also one that was refused before and comes again
        return self._unsound(fix) or ("unproven" if self.memory.suspect and fix.solution in RTK else None)

    def _next(self, memory: Memory, fix: SeenFix, since_s: float) -> tuple[str | None, Memory]:
        """Why the next fix does not count, and what is remembered after it."""
        if fix.solution not in self._known:
            memory = memory._replace(coasted_s=memory.coasted_s + since_s, proof_since_s=None)
            return "solution", memory.doubted() if memory.coasted_s >= self._limits.coasting_s else memory
        reason = self._unsound(fix)
        if fix.solution not in RTK:
            memory = memory._replace(proof_since_s=None)
            return (reason, memory) if reason else self._continued(memory, fix)
        heard = bool(memory.run) and fix.t_s - memory.run[-1].t_s <= GAP_S
        if reason is None:
            reason, memory = self._claimed(memory, fix)
        if not memory.suspect:
            return reason, memory._replace(coasted_s=max(0.0, memory.coasted_s - since_s))
        if reason is not None:
            return reason, memory._replace(proof_since_s=None)
        since = memory.proof_since_s if heard and memory.proof_since_s is not None else fix.t_s
        if fix.t_s - since < self._limits.proof_s:
            return "unproven", memory._replace(proof_since_s=since)
        return None, memory._replace(suspect=False, coasted_s=0.0)

    def _unsound(self, fix: SeenFix) -> str | None:
        """Why a fix by itself does not count."""
        limits = self._limits
        if fix.satellites is not None and fix.satellites < limits.least:
            return "satellites"
        if fix.ambiguous:
            return "ambiguous"
        # a distance that is no number fails too
        if not abs(fix.cross_track_m) <= limits.farthest_m(fix.std_m):
            return "off_track"
        noise_m = limits.sigmas * fix.std_m
        if not -noise_m <= fix.position_m <= self._length_m + noise_m:
            return "off_line"
        if fix.turned_deg is not None and abs(math.sin(math.radians(fix.turned_deg))) > math.sin(
            math.radians(limits.course_deg)
        ):
            return "off_course"
        return None

    def _claimed(self, memory: Memory, fix: SeenFix) -> tuple[str | None, Memory]:
        """RTK after the fixes before: what moves as no train can is doubted at once."""
        memory = memory._replace(still=self._motion.stood(memory.still, memory.run, fix))
        if memory.still is not None and memory.still.frozen:
            return "frozen", memory.doubted()
        jump = self._motion.impossible(memory.run, fix)
        if jump is not None:
            # what a poorer solution said is no evidence against RTK
            worse = memory.run[-1].solution not in RTK
            memory = memory._replace(run=(fix,), apart=memory.run)
            return (None, memory) if worse else (jump, memory.doubted())
        memory = memory._replace(run=extended(memory.run, fix))
        return ("off_track_mean", memory.doubted()) if self._beside(memory.run) else (None, memory)

    def _continued(self, memory: Memory, fix: SeenFix) -> tuple[str | None, Memory]:
        """Another solution after the fixes before: it counts where it continues them, or others that have lasted."""
        memory = memory._replace(still=self._motion.stood(memory.still, memory.run, fix))
        if memory.still is not None and memory.still.frozen:
            return "frozen", memory
        jump = self._motion.impossible(memory.run, fix)
        if jump is None:
            memory = memory._replace(run=extended(memory.run, fix), apart=())
        else:
            continued = memory.apart and self._motion.impossible(memory.apart, fix) is None
            apart = extended(memory.apart, fix) if continued else (fix,)
            if len(apart) < 2 or _span_s(apart) < min(self._limits.proof_s, _span_s(memory.run)):
                return jump, memory._replace(apart=apart)
            memory = memory._replace(run=apart, apart=())
        return "off_track_mean" if self._beside(memory.run) else None, memory

    def _beside(self, run: Run) -> bool:
        """Whether the newest fixes together lie beside the track. Their errors may be slow: the mean is no better than one."""
        newest = run[-1]
        recent = [fix.cross_track_m for fix in run if newest.t_s - fix.t_s <= MEAN_S]
        allowed_m = max(0.5 * self._limits.cross_track_m, self._limits.sigmas * newest.std_m)
        return len(recent) >= MEAN_FIXES and abs(sum(recent)) > allowed_m * len(recent)


def _span_s(run: Run) -> float:
    return run[-1].t_s - run[0].t_s if run else 0.0
