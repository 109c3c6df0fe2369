"""Spin and slide of a wheel against the fused speed, and the diameter that the fused state knows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, Field

from milepost.estimation.notice import Notice
from milepost.recordings.options import STRICT

from ..base import Belief, Observed
from ..scale import SCALE

Observe = Callable[[Any, Belief | None], Sequence[Observed]]
Positive = Annotated[float, Field(gt=0.0)]
REASONS = {"wheel_spin": "spinning", "wheel_slide": "sliding"}


class SlipOptions(BaseModel):
    """When a wheel is said to slip, and when its readings do not count.

    `spin_ratio`, `slide_ratio`: source D's λ_slip and λ_slide. `sigmas`: a reading this many standard deviations off what
    was expected does not count; from `doubt_sigmas` on it counts for less. `hold_s`: how long a wheel must run as expected
    before it counts again. `longest_s`: no slip lasts longer: the diameter is wrong. Below `least_speed_mps` a ratio says
    nothing. `report_every_m`: how far apart reports of the diameter are.
    """

    model_config = STRICT

    spin_ratio: Annotated[float, Field(lt=0.0)] = -0.02
    slide_ratio: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.02
    sigmas: Positive = 4.0
    doubt_sigmas: Positive = 2.5
    hold_s: Positive = 0.5
    longest_s: Positive = 30.0
    least_speed_mps: Positive = 0.5
    report_every_m: Positive = 100.0


class SlipMemory(NamedTuple):
    """What the watch remembers of a wheel.

    `off_since_s`: since when its readings do not count; `calm_since_s`: since when it has run as expected again. `slip`: the
    event that was told; `stuck`: whether it lasted too long. `too_far_m`: how much further than the train it has run.
    `mark`, `reported`: the places at which its diameter is reported. `refused`: why the last reading did not count.
    """

    off_since_s: float | None = None
    calm_since_s: float | None = None
    slip: str | None = None
    stuck: bool = False
    too_far_m: float = 0.0
    mark: int | None = None
    reported: int | None = None
    refused: str | None = None

    def gripping(self) -> SlipMemory:
        """The same of a wheel that grips."""
        return SlipMemory(mark=self.mark, reported=self.reported)


class WheelWatch:
    """Lets a wheel's readings count while the wheel grips; its only time is that of the readings.

    With the observation z = h x + e and ν = z - h x̂, S = h P hᵀ + R against the fused belief: h has 1 for the speed, so
    ν = v_w - v̂, v_w the wheel's speed at its true diameter, and the slip ratio is λ = (v̂ - v_w)/v̂ = -ν/v̂. λ ≤ λ_slip is
    spin, λ ≥ λ_slide slide. |ν| > k √S: the reading does not count, whatever λ is, nor any after it until the wheel has run
    as expected for a while; so a threshold that the fused speed is too uncertain to decide is not decided. Short of that R
    grows to (ν/k_d)² - h P hᵀ: the ramp of a slip is in doubt before it is sure. Source: D (18), lost in the text: λ is a
    reconstruction from its thresholds; the rest is ours.
    """

    def __init__(self, observe: Observe, options: SlipOptions, told_diameter_m: float) -> None:
        self._observe = observe
        self._options = options
        self._told_diameter_m = told_diameter_m
        self._notices: list[Notice] = []
        self.memory = SlipMemory()

    def restarted(self) -> None:
        """A wheel that slips shows so in its first reading, against the fused state."""

    @property
    def gating(self) -> str | None:
        """The kind of slip, or that the wheel is off, while its readings do not count."""
        return None if self.memory.off_since_s is None else REASONS.get(self.memory.slip or "", "contradicts the fused speed")

    @property
    def refused(self) -> str | None:
        """Why the last reading did not count."""
        return self.memory.refused

    def notices(self) -> list[Notice]:
        """What happened since the last time it was asked."""
        out, self._notices = self._notices, []
        return out

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:
        """The reading's observation, with the variance that it deserves; nothing while the wheel slips."""
        observed = self._observe(reading, belief)
        if belief is None or not observed:
            return observed
        self._report_diameter(belief)
        row, value, R = observed[0]
        nu = value - float(belief.mean @ row)
        hPh = float(belief.covariance @ row @ row)
        expected = abs(nu) <= self._options.sigmas * math.sqrt(hPh + R)
        if not expected:
            self._off(reading, belief, nu)
        memory = self.memory
        if memory.off_since_s is not None:
            self.memory = memory._replace(too_far_m=memory.too_far_m + nu * reading.interval_s)
            if not (expected and self._calm(reading.measured_at_ns * 1e-9)):
                self.memory = self.memory._replace(refused=self.gating)
                return ()
        return (Observed(row, value, max(R, (nu / self._options.doubt_sigmas) ** 2 - hPh)),)

    def _off(self, reading: Any, belief: Belief, nu: float) -> None:
        t_s, options = reading.measured_at_ns * 1e-9, self._options
        first = self.memory.off_since_s is None
        since_s = t_s if self.memory.off_since_s is None else self.memory.off_since_s
        v = float(belief.mean[1])
        ratio = -nu / v if abs(v) >= options.least_speed_mps else 0.0
        slip = "wheel_spin" if ratio <= options.spin_ratio else "wheel_slide" if ratio >= options.slide_ratio else None
        slip_told, stuck = self.memory.slip, self.memory.stuck
        if slip is not None and slip != slip_told:
            slip_told = slip
            text = f"slip ratio {ratio:+.3f} at {abs(v) * 3.6:.1f} km/h: the odometer's readings do not count"
            self._notices.append(Notice("warning", slip, text))
        elif first:
            text = f"{nu:+.3f} m/s off the fused speed of {abs(v) * 3.6:.1f} km/h: the odometer's readings do not count"
            self._notices.append(Notice("info", "wheel_off", text))
        if t_s - since_s > options.longest_s and not stuck:
            stuck = True
            text = f"{100.0 * abs(ratio):.2f} % off for {options.longest_s:g} s: no slip lasts so long, is the diameter right?"
            self._notices.append(Notice("error", "wheel_doubtful", text))
        self.memory = self.memory._replace(off_since_s=since_s, calm_since_s=None, slip=slip_told, stuck=stuck)

    def _calm(self, t_s: float) -> bool:
        """Whether a wheel that was off has run as expected for long enough; then it grips."""
        memory = self.memory
        calm_since_s = t_s if memory.calm_since_s is None else memory.calm_since_s
        if t_s - calm_since_s < self._options.hold_s:
            self.memory = memory._replace(calm_since_s=calm_since_s)
            return False
        if memory.off_since_s is not None:
            text = f"after {t_s - memory.off_since_s:.1f} s; the wheel had run {memory.too_far_m:+.2f} m further than the train"
            self._notices.append(Notice("info", "wheel_grips", text))
        self.memory = memory.gripping()
        return True

    def _report_diameter(self, belief: Belief) -> None:
        position, k = float(belief.mean[0]), float(belief.mean[SCALE])
        mark = math.floor(position / self._options.report_every_m)
        before = self.memory.mark
        if before == mark:
            return
        self.memory = self.memory._replace(mark=mark)
        passed = mark if before is None else max(before, mark)
        # a train that stands on a mark passes it for ever in what is believed of it
        if before is None or passed == self.memory.reported:
            return
        self.memory = self.memory._replace(reported=passed)
        diameter_mm = 1e3 * self._told_diameter_m * (1.0 + k)
        std_mm = 1e3 * self._told_diameter_m * math.sqrt(float(belief.covariance[SCALE, SCALE]))
        text = f"{diameter_mm:.2f} mm ± {std_mm:.2f} at {position:.1f} m (told {1e3 * self._told_diameter_m:.1f} mm)"
        self._notices.append(Notice("info", "wheel_diameter", text))
