"""A sensor's noise variance from its innovations."""

from __future__ import annotations


class InnovationVariance:
    """R̂ from the innovations: R̂ = mean(e² - c) over the memory, not below a floor.

    e = z - h x̂ and c = h P hᵀ of each observation, so that E[e²] = c + R (Mehra 1970; Mohamed and Schwarz 1999 over a
    window). Each counts (R/(R + c))², the information that e² has on R, R the greater of R̂ and e² - c: a badly
    predicted reading says little about its noise, unless it is farther off than the prediction can be. The mean runs over
    all observations until there are `memory` of them, then forgets exponentially; it begins with `start`, which has
    the weight of `start_weight` observations. `floor`: R̂ is not below it, because a few small innovations must not make a
    reading certain. Stated is R̂ (n + 2)/n for the effective number n of observations: it is itself uncertain, and
    E[1/R̂] > 1/R.
    """

    def __init__(self, start: float, memory: int, floor: float, start_weight: float = 4.0) -> None:
        self._mean = start
        self._weight = start_weight
        self._memory = float(memory)
        self._floor = floor

    @property
    def variance(self) -> float:
        """The variance that is stated now, in the reading's unit squared."""
        # an exponential memory of weight w averages as well as a window of 2 w
        n = self._weight if self._weight < self._memory else 2.0 * self._memory
        return max(self._mean, self._floor) * (n + 2.0) / n

    def learn(self, innovation: float, predicted_variance: float) -> None:
        """Take one innovation e of predicted variance c."""
        # a large innovation suggests a greater R, about which it holds more information than about the present one
        R = max(self._mean, self._floor, innovation * innovation - predicted_variance)
        weight = (R / (R + predicted_variance)) ** 2
        self._weight = min(self._weight + weight, self._memory)
        self._mean += (innovation * innovation - predicted_variance - self._mean) * weight / self._weight
