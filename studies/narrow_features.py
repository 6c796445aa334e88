"""Is a feature of a formula ever missed? Bumps, bends and steps of widths from 1e-2 to 1e-9, at random places of a hop.

Half the flight takes the time alpha, and the contact its own time: both are integrals over the extension by the
conservation of energy, which mpmath evaluates in 40 digits between places that are stated by hand. What an orbit is off
by must be within its own error.
Run: python studies/narrow_features.py [--quick] [--seed 1]
"""

import argparse
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import mpmath as mp
import numpy as np

from orbits import InputError, NoOrbit, find
from problems import Hopper

MASS_RATIO, DIGITS = 0.8, 40
# Of Gauss's rule between neighbouring places, which lie at distances from the feature that double each time.
NODES = [tuple(map(mp.mpf, each)) for each in zip(*np.polynomial.legendre.leggauss(28), strict=True)]
# A contact time may differ by this share, ten times the error that its own tests allow.
CONTACT_SHARE = 1e-11


def _softplus(s):
    return max(s, mp.mpf(0)) + mp.log1p(mp.exp(-abs(s)))


def _times_size(s):
    return s * abs(s) / 2


# Features f((r - c)/w) as formulas of s, with the functions f and their integrals.
FEATURES: dict[str, tuple[Callable, Callable]] = {
    "exp(-s**2)": (lambda s: mp.exp(-(s**2)), lambda s: mp.sqrt(mp.pi) / 2 * mp.erf(s)),
    "1/(1 + s**2)": (lambda s: 1 / (1 + s**2), mp.atan),
    "tanh(s)": (mp.tanh, lambda s: abs(s) + mp.log1p(mp.exp(-2 * abs(s)))),
    "s/sqrt(1 + s**2)": (lambda s: s / mp.sqrt(1 + s**2), lambda s: mp.sqrt(1 + s**2)),
    "atan(s)": (mp.atan, lambda s: s * mp.atan(s) - mp.log(1 + s**2) / 2),
    "1/(1 + exp(-s))": (lambda s: 1 / (1 + mp.exp(-s)), _softplus),
    "w*sqrt(1 + s**2)": (lambda s: mp.sqrt(1 + s**2), lambda s: (s * mp.sqrt(1 + s**2) + mp.asinh(s)) / 2),
    "tanh(s) - tanh(s - 3)": (
        lambda s: mp.tanh(s) - mp.tanh(s - 3),
        lambda s: abs(s) + mp.log1p(mp.exp(-2 * abs(s))) - abs(s - 3) - mp.log1p(mp.exp(-2 * abs(s - 3))),
    ),
    "w*abs(s)": (abs, _times_size),
    "(abs(s + 1) - abs(s - 1))/2": (
        lambda s: (abs(s + 1) - abs(s - 1)) / 2,
        lambda s: (_times_size(s + 1) - _times_size(s - 1)) / 2,
    ),
    "(abs(s + 1) - 2*abs(s) + abs(s - 1))/2": (
        lambda s: (abs(s + 1) - 2 * abs(s) + abs(s - 1)) / 2,
        lambda s: (_times_size(s + 1) - 2 * _times_size(s) + _times_size(s - 1)) / 2,
    ),
    "(sign(s + 1) - sign(s - 1))/2": (
        lambda s: (mp.sign(s + 1) - mp.sign(s - 1)) / 2,
        lambda s: (abs(s + 1) - abs(s - 1)) / 2,
    ),
    "sign(s)": (mp.sign, abs),
}


@dataclass(frozen=True)
class Case:
    """A straight spring with a feature of this height, place and width."""

    feature: str
    height: float
    place: float
    width: float

    @property
    def machine(self) -> Hopper:
        """The hopper with this spring."""
        text = "r + h*(" + re.sub(r"\bs\b", "((r - c)/w)", self.feature) + ")"
        parameters = {"h": self.height, "c": self.place, "w": self.width}
        return Hopper(text, mass_ratio=MASS_RATIO, rest_length=40, parameters=parameters)

    def _scaled(self, r):
        return (r - mp.mpf(self.place)) / mp.mpf(self.width)

    def _size(self):
        return mp.mpf(self.height) * (mp.mpf(self.width) if self.feature.startswith("w") else 1)

    def force(self, r):
        """The force at an extension."""
        return r + self._size() * FEATURES[self.feature][0](self._scaled(r))

    def energy(self, r):
        """Its integral."""
        return r**2 / 2 + self._size() * mp.mpf(self.width) * FEATURES[self.feature][1](self._scaled(r))

    def energy_in_contact(self, r):
        """That of the body above a foot that stands."""
        return (MASS_RATIO * self.energy(r) + r) / (1 + mp.mpf(MASS_RATIO))

    def places(self) -> list:
        """Places between which the force is smooth on their own scale."""
        steps = [mp.mpf(self.width) * mp.mpf(2) ** (k / mp.mpf(2)) for k in range(-2, 70)]
        kinks = [mp.mpf(self.width) * k for k in (-1, 1, 3)]
        return sorted(mp.mpf(self.place) + side * each for each in (*steps, *kinks, mp.mpf(0)) for side in (-1, 1))

    def liftoff(self):
        """The extension at which the force first comes to 1 from rest."""
        side = 1 if self.force(mp.mpf(0)) < 1 else -1
        known = [mp.mpf(0), *self.places(), *map(mp.mpf, np.linspace(-8, 8, 1601))]
        fine = [mp.mpf(self.place) + mp.mpf(self.width) * mp.mpf(k) / 64 for k in range(-640, 641)]
        extensions = sorted((r for r in (*known, *fine) if side * r >= 0), key=abs)
        there = next(i for i, r in enumerate(extensions) if side * (self.force(r) - 1) >= 0)
        return _bisected(lambda r: self.force(r) - 1, *sorted(extensions[there - 1 : there + 1]))

    def time(self, energy: Callable, total, start, end):
        """The time from an extension to that at which the speed vanishes, where the energy is the total."""
        side = mp.sign(end - start)
        # r = end - side u**2 takes the singularity away.
        inside = [mp.sqrt(side * (end - r)) for r in self.places() if side * (end - r) > 0 and side * (r - start) > 0]
        ends = sorted([mp.mpf(0), *inside, mp.sqrt(side * (end - start))])
        found = mp.mpf(0)
        for low, high in pairwise(ends):
            for node, weight in NODES:
                u = low + (high - low) * (1 + node) / 2
                speed = mp.sqrt(2 * (total - energy(end - side * u**2)))
                found += weight * (high - low) / 2 * 2 * u / speed
        return found

    def lateness(self, rho, alpha):
        """How much later than after the time alpha the extension turns for the second time."""
        total = alpha**2 / 2 + self.energy(rho)
        longest = _bisected(lambda r: self.energy(r) - total, rho, mp.mpf(100))
        shortest = _bisected(lambda r: total - self.energy(r), mp.mpf(-400), min(rho, mp.mpf(0)))
        middle = mp.mpf(0) if abs(self.place) > 1 else mp.mpf(self.place) + 0.01
        way = (rho, longest), (middle, longest), (middle, shortest)
        return sum(self.time(self.energy, total, *each) for each in way) - alpha

    def contact_time(self, rho, alpha):
        """The time of the contact between two lossless landings."""
        total = alpha**2 / 2 + self.energy_in_contact(rho)
        lowest = _bisected(lambda r: total - self.energy_in_contact(r), mp.mpf(-400), min(rho, mp.mpf(0)))
        return 2 * self.time(self.energy_in_contact, total, rho, lowest)

    def check(self, orbit) -> str:
        """What is wrong with an orbit, in words; empty where nothing is."""
        with mp.workdps(DIGITS):
            rho, alpha = self.liftoff(), mp.mpf(orbit.alpha)
            if abs(rho - orbit.liftoff_extension) > 1e-14 * (1 + self.width):
                return f"lifts off at {orbit.liftoff_extension!r}, not {float(rho)!r}"
            late, step = self.lateness(rho, alpha), mp.mpf(10) ** -12
            slope = (self.lateness(rho, alpha + step) - late) / step
            off = float(-late / slope)
            if abs(off) > orbit.error:
                return f"alpha = {orbit.alpha!r} is off by {off:.2e} and claims {orbit.error:.1e}"
            if orbit.contact_time is not None:
                contact = self.contact_time(rho, alpha)
                if abs(contact / orbit.contact_time - 1) > CONTACT_SHARE:
                    return f"the contact takes {orbit.contact_time!r}, not {float(contact)!r}"
        return ""


def _bisected(function: Callable, low, high):
    """Where a function changes its sign from negative to positive."""
    for _ in range(int(3.4 * DIGITS) + 12):
        middle = (low + high) / 2
        low, high = (low, middle) if function(middle) > 0 else (middle, high)
    return (low + high) / 2


def cases(count: int, seed: int) -> Iterator[Case]:
    """Random features: a third anywhere, the others beside lift-off, mid-flight and the first turn."""
    rng, names = np.random.default_rng(seed), list(FEATURES)
    for i in range(count):
        width = 10 ** rng.uniform(-9, -2)
        beside = width * rng.uniform(-3, 3)
        place = (rng.uniform(-5, 5), 1.0 + beside, -4.603 + beside, 4.603 + beside, rng.uniform(0, 1.5))[i % 5]
        yield Case(names[i % len(names)], rng.choice([-1, 1]) * rng.uniform(0.1, 0.9), float(place), float(width))


def main(some: Iterable[Case]) -> Counter:
    """How many cases are right, refused and wrong."""
    found = Counter[str]()
    for case in some:
        try:
            wrong = case.check(find(case.machine))
        except (NoOrbit, InputError) as error:
            found["refused"] += 1
            print(f"refused: {case}: {error}")
            continue
        found["wrong" if wrong else "right"] += 1
        if wrong:
            print(f"WRONG: {case}: {wrong}")
    print(", ".join(f"{number} {what}" for what, number in found.items()))
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="13 cases instead of 400")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    raise SystemExit(main(cases(13 if arguments.quick else 400, arguments.seed))["wrong"] > 0)
