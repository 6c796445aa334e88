"""The standard deviation that an orbit states for the noise of a measured spring: is the true alpha within three of it?

Random tables of 20 to 200 rows, evenly spaced or not, of springs of several laws, with normal noise of 0.02 % to 3 % of
the range of force. The truth is the orbit of the law itself.
Run: python studies/table_noise.py [--count 200] [--seed 1]
"""

import argparse
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from orbits import NoOrbit, Orbit, find
from orbits.laws import Law
from problems import Hopper, springs

# Laws with the bounds of their parameters, drawn evenly in the logarithm.
LAWS = {
    "linear": ("k*r", {"k": (0.5, 2.0)}),
    "hardening": ("r + b*r**3", {"b": (0.01, 0.4)}),
    "softening": ("r - b*r**3", {"b": (5e-4, 8e-3)}),
    "air": ("h/n*(1 - (1 + r/h)**(-n))", {"h": (6.0, 15.0), "n": (1.0, 1.4)}),
    "tanh": ("tanh(b*r)/b", {"b": (0.05, 0.22)}),
    "sinh": ("sinh(b*r)/b", {"b": (0.2, 0.8)}),
    "rubber": ("h/3*((1 + r/h) - (1 + r/h)**(-2))", {"h": (12.0, 25.0)}),
}
ROWS, NOISE, MARGIN = (20, 200), (2e-4, 0.03), (0.03, 0.3)
# Beside the pole of an air spring the range of force may be many times that of the orbit: nobody measures there.
LARGEST_RANGE = 10.0
# Bounds of the groups that are printed.
GROUPS = {"noise": (0.0, 1e-3, 5e-3, 1.0), "rows": (0, 35, 70, 1000)}


class NoisyTable(NamedTuple):
    """A table with the law that it is of, and the orbit of that."""

    law: str
    truth: Orbit
    rows: tuple[np.ndarray, np.ndarray]
    noise: float  # as a share of the range of force


class Outcome(NamedTuple):
    """The orbit of a table: how many stated deviations alpha is off by, and what share of it is one of them."""

    law: str
    rows: int
    noise: float
    off: float
    stated: float
    text: str


def random_tables(count: int, seed: int) -> Iterator[NoisyTable]:
    rng = np.random.default_rng(seed)
    while count:
        name = [*LAWS][rng.integers(len(LAWS))]
        text, bounds = LAWS[name]
        law = springs.formula(text, **{each: _between(rng, *ends) for each, ends in bounds.items()})
        rows, noise = round(_between(rng, *ROWS)), _between(rng, *NOISE)
        try:
            truth = find(Hopper(law))
        except NoOrbit:
            continue
        r = _extensions(truth, law, rows, rng)
        force, used = law(r), law(np.array([*_stretches(truth)]))
        if not np.isfinite(force).all() or np.ptp(force) > LARGEST_RANGE * np.ptp(used):
            continue
        count -= 1
        yield NoisyTable(name, truth, (r, force + noise * np.ptp(force) * rng.normal(size=rows)), noise)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _extensions(truth: Orbit, law: Law, rows: int, rng: np.random.Generator) -> np.ndarray:
    """Extensions beyond those of the orbit on both sides, in half of the tables unevenly spaced."""
    low, high = _stretches(truth)
    below, above = rng.uniform(*MARGIN, 2) * (high - low)
    r = np.linspace(low - below, high + above, rows)
    if rng.random() < 0.5:
        r[1:-1] += rng.uniform(-0.4, 0.4, rows - 2) * (r[1] - r[0])
    return r


def _stretches(orbit: Orbit) -> tuple[float, float]:
    """The smallest and the largest extension of an orbit."""
    columns = orbit.table()
    stretch = columns["y1"] - columns["y2"]
    return float(stretch.min()), float(stretch.max())


def outcome(table: NoisyTable) -> Outcome:
    law = springs.table(table.rows)
    orbit = find(Hopper(law))
    stated = orbit.certificate.alpha_noise or 0.0
    off = abs(orbit.alpha - table.truth.alpha) / stated if stated else np.inf
    return Outcome(table.law, len(table.rows[0]), table.noise, off, stated / orbit.alpha, law.text)


def main(count: int, seed: int) -> list[Outcome]:
    found = [outcome(table) for table in random_tables(count, seed)]
    print(f"{'':24}{'tables':>8}{'within 1':>10}{'2':>8}{'3 deviations':>14}   median deviation of alpha")
    rows = {"all": found} | {name: [each for each in found if each.law == name] for name in LAWS}
    for what, bounds in GROUPS.items():
        for low, high in pairwise(bounds):
            rows[f"{what} {low:g} to {high:g}"] = [each for each in found if low <= getattr(each, what) < high]
    for name, group in rows.items():
        if group:
            shares = [np.mean([each.off < k for each in group]) for k in (1, 2, 3)]
            median = np.median([each.stated for each in group])
            print(f"{name:24}{len(group):8}{shares[0]:10.1%}{shares[1]:8.1%}{shares[2]:14.1%}   {median:.2e}")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    main(**vars(parser.parse_args()))
