"""A bifurcation of hops, and the names of hops by their period and their stability."""

from dataclasses import dataclass

import numpy as np

PERIODS_IN_WORDS = {2: "two", 3: "three", 4: "four", 5: "five", 6: "six", 8: "eight"}  # others are figures
WORDS_OF_STABILITY = {True: "stable", False: "unstable", None: "stability unknown"}


def name_of_hops(period: int) -> str:
    """What launches of a period are called: "fixed points", or "hops of period two"."""
    return "fixed points" if period == 1 else f"hops of period {PERIODS_IN_WORDS.get(period, period)}"


@dataclass(frozen=True)
class Bifurcation:
    """A located bifurcation on a branch of periodic launches.

    kind : "flip" (multiplier -1: hops of twice the period begin), "fold" (multiplier 1: the branch turns round in the
        parameter), "branch point" (multiplier 1, and the branch does not turn), "Neimark-Sacker" (a pair of complex
        multipliers crosses the unit circle), "border collision" (a launch passes a border of the map, with one bounce
        more or less, or a graze; or the slope of the map jumps, and with it the multiplier past 1 or -1), or
        "non-smooth fold" (the branch turns round at a border)
    value : of the parameter
    alphas : the launch speeds (period,) of the periodic hops
    multiplier : of these hops; NaN at a border, where there are two
    branch : index of the branch
    note : in words, for example which branch begins or ends there, or that the hop is lossless; may be ""
    border : the kind of the border that a launch passes, "lossless", "graze" or "bounce"; else ""
    sides : the multipliers on both sides of the border, in order along the branch
    """

    kind: str
    value: float
    alphas: tuple[float, ...]
    multiplier: float = np.nan
    branch: int = -1
    note: str = ""
    border: str = ""
    sides: tuple[float, ...] = ()

    @property
    def alpha(self) -> float:
        """The first of the launch speeds."""
        return self.alphas[0]
