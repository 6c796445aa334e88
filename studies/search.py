"""Is what `find` gives the lowest orbit of its family, and is there none where it refuses?

Random springs with a narrow bump, springs whose force wiggles and gravities that vary within a hop, against a scan of
launch speeds by scipy's integrator with short steps, which shares nothing with the toolkit: no law, no integrator, no
search. What it finds is counted: orbits that are the lowest of the scan, refusals where the scan finds none either,
refusals where it finds one, orbits that are not the lowest, and wrong ones, which another integration denies.

Of random springs that are nearly flat somewhere, wiggle or stiffen, all orbits of `find_all` are compared with the
roots of integrals of the energy, by Gauss quadrature, on a fine grid of turning points. There families are counted that
are whole, lack an orbit or have one too many, and those that lack one and say so.
Run: python studies/search.py [--quick] [--seed 1]
"""

import argparse
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import NoOrbit, find, find_all
from problems import Hopper, Juggler

# The scan: launch speeds up to so much, and so much more for each family above the first, this far apart; and how many
# times as close where there may be an orbit.
FASTEST, FURTHER, APART, FINER = 9.0, 4.0, 0.05, 10
# Of the integrals of the energy: how far extensions are sampled, and how many of them and of the launch speeds; the
# places and weights of the quadrature in shares of the way from a turning point to lift-off.
FARTHEST, EXTENSIONS, LAUNCHES, PANELS, BESIDE = 3000.0, 200_001, 4000, 30, 1e-7
NODES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(16)
SHARES = ((np.arange(PANELS)[:, None] + (1 + NODES) / 2) / PANELS).ravel()
WEIGHTS = np.tile(NODE_WEIGHTS / (2 * PANELS), PANELS)
# Launch speeds of the scan agree with those of orbits to this share; an orbit holds in another integration to this.
SAME, HOLDS = 2e-3, 1e-7


@dataclass(frozen=True)
class Case:
    """A machine, and its laws as NumPy functions; `length` is the shortest over which they vary."""

    machine: Hopper | Juggler
    family: int
    force: Callable
    gravity: Callable
    length: float

    def rates(self, t: float, x: np.ndarray) -> np.ndarray:
        """The rates of several flights at once: positions and speeds of both masses, (4 m,)."""
        upper, v, lower, w = x.reshape(4, -1)
        ell, M = self.machine.rest_length, self.machine.mass_ratio
        if isinstance(self.machine, Hopper):
            force = self.force(upper - lower)
            pulls = -(M * force + self.gravity(ell + upper)) / (1 + M), (force - self.gravity(lower)) / (1 + M)
        else:
            pulls = -self.gravity(ell + upper), -self.force(lower) - self.gravity(ell + lower)
        return np.concatenate([v, pulls[0], w, pulls[1]])

    def launch(self, alphas: np.ndarray) -> np.ndarray:
        """The states (4 m,) at lift-off."""
        level = 1.0 if isinstance(self.machine, Hopper) else 0.0
        r = np.linspace(0, 12, 24_001) if level else np.linspace(-4, 12, 24_001)
        excess = self.force(r) - level
        i = np.flatnonzero((excess[:-1] < 0) & (excess[1:] >= 0))
        i = i[0] if level else i[np.abs(r[i]).argmin()]
        rho = brentq(lambda r: float(self.force(np.array(r)) - level), r[i], r[i + 1], xtol=1e-15)
        still, at = np.zeros(len(alphas)), np.full(len(alphas), rho)
        return np.concatenate([at, alphas, still, still] if level else [at, alphas, at, alphas])

    def shared_speeds(self, alphas: np.ndarray) -> np.ndarray:
        """The speed (m,) that both masses share when the extension turns for the last time in an orbit of the family;
        minus infinity where it does not turn so often."""
        end = 1.1 * alphas.max() + 0.5 if self.gravity is np.ones_like else 1.5 * alphas.max() + 2
        run = solve_ivp(
            self.rates, (0, end), self.launch(alphas), "DOP853", rtol=1e-7, atol=1e-7, max_step=self.length / 6
        )
        _, v, _, w = run.y.reshape(4, len(alphas), -1)
        turning = v - w if isinstance(self.machine, Hopper) else w
        turns = (turning[:, 1:] > 0) != (turning[:, :-1] > 0)
        reached = np.cumsum(turns, axis=1) == self.family + 1
        i, each = reached.argmax(1), np.arange(len(alphas))
        share = turning[each, i] / (turning[each, i] - turning[each, i + 1])
        speed = v[each, i] + share * (v[each, i + 1] - v[each, i])
        return np.where(reached.any(1), speed, -np.inf)

    def scanned(self, fastest: float) -> list[float]:
        """Launch speeds of the orbits of the family, ascending, up to the fastest."""
        alphas = np.arange(APART, min(fastest, FASTEST + FURTHER * (self.family - 1)) + APART, APART)
        speeds = self.shared_speeds(alphas)
        size = np.minimum(np.abs(speeds[1:]), np.abs(speeds[:-1]))
        near = np.flatnonzero(((speeds[1:] > 0) != (speeds[:-1] > 0)) | (size < 0.1))
        fine = alphas[near, None] + (alphas[near + 1] - alphas[near])[:, None] * np.arange(FINER + 1) / FINER
        values = self.shared_speeds(fine.ravel()).reshape(fine.shape) if len(near) else fine
        cell, i = np.nonzero((values[:, 1:] > 0) != (values[:, :-1] > 0))
        a, b, fa, fb = fine[cell, i], fine[cell, i + 1], values[cell, i], values[cell, i + 1]
        real = np.abs(fa - fb) < 1.0  # else the number of turns changes there
        return sorted(np.where(real, a - fa * (b - a) / np.where(real, fb - fa, 1.0), np.nan)[real])

    def holds(self, alpha: float, half: float) -> bool:
        """Whether a launch is at rest after a time, with as many turns before as its family says."""
        nudge = 1e-6 * alpha
        start = self.launch(np.array([alpha, alpha + nudge]))
        turn = lambda t, x: x[2] - x[6] if isinstance(self.machine, Hopper) else x[6]  # noqa: E731
        run = solve_ivp(
            self.rates, (0, half), start, "DOP853", rtol=1e-12, atol=1e-13, max_step=self.length / 8, events=turn
        )
        ends = run.y[[[2, 6], [3, 7]], -1]
        (_, vdot), (_, wdot) = (self.rates(half, run.y[:, -1])[[0, 2]], self.rates(half, run.y[:, -1])[[4, 6]])
        slopes = np.column_stack([(ends[1] - ends[0]) / nudge, [vdot, wdot]])
        off = np.linalg.solve(slopes, ends[0])
        times = run.t_events[0]
        turns = np.sum((times > 1e-9) & (times < half * (1 - 1e-6)))
        return bool(np.abs(off).max() < HOLDS * (1 + alpha)) and turns == self.family


def bumps(count: int, seed: int) -> Iterator[Case]:
    """Straight springs with a Gaussian bump, 0.05 to 0.5 wide, somewhere within the hop."""
    rng = np.random.default_rng(seed)
    while count:
        a = rng.choice([-1, 1]) * rng.uniform(0.05, 1.5)
        c, w = rng.uniform(-6, 4), np.exp(rng.uniform(np.log(0.05), np.log(0.5)))
        if np.abs(a * np.exp(-((c / w) ** 2))) > 0.3:  # at rest
            continue
        count -= 1
        machine = Hopper("r + a*exp(-((r - c)/w)**2)", rest_length=30, parameters={"a": a, "c": c, "w": w})
        force = lambda r, a=a, c=c, w=w: r + a * np.exp(-(((r - c) / w) ** 2))  # noqa: E731
        yield Case(machine, 1, force, np.ones_like, w)


def wiggles(count: int, seed: int) -> Iterator[Case]:
    """Springs and gravities that wiggle within a hop, families 1 and 2."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        M, family, kind = float(np.exp(rng.normal())), 1 + i % 2, i // 2 % 4
        machine = Juggler if kind == 3 else Hopper
        force, gravity, length = (lambda r: r), np.ones_like, 1.0
        if kind == 0:
            p = {"a": rng.uniform(-0.05, 0.2), "b": rng.uniform(0.02, 0.6), "w": rng.uniform(0.5, 6)}
            spring, law = "r*exp(a*r)*(1 + b*cos(w*r))/(1 + b)", "1"
            force = lambda r, a=p["a"], b=p["b"], w=p["w"]: r * np.exp(a * r) * (1 + b * np.cos(w * r)) / (1 + b)  # noqa: E731
            length = 1 / p["w"]
        elif kind == 1:
            p = {
                "s": rng.uniform(0.2, 2),
                "b": rng.uniform(0.2, 2),
                "c": rng.uniform(0.1, 1),
                "d": rng.uniform(0.05, 0.8),
            }
            spring, law = "s*atan(b*r) + c*r + d*sin(r)**2", "1"
            force = lambda r, s=p["s"], b=p["b"], c=p["c"], d=p["d"]: s * np.arctan(b * r) + c * r + d * np.sin(r) ** 2  # noqa: E731
        else:
            p = {"A": rng.uniform(0.05, 0.9), "l": float(np.exp(rng.uniform(np.log(0.3), np.log(8))))}
            spring, law = "r", "1 + A*sin(z/l)"
            gravity = lambda z, A=p["A"], l=p["l"]: 1 + A * np.sin(z / l)  # noqa: E731, E741
            length = min(1.0, 0.2 * p["l"])
        yield Case(
            machine(spring, law, M, rest_length=rng.uniform(5, 20), parameters=p), family, force, gravity, length
        )


@dataclass(frozen=True)
class Family:
    """A family of a machine under constant gravity, whose extension lifts off at `liftoff` and moves in a potential."""

    machine: Hopper | Juggler
    family: int
    potential: Callable
    liftoff: float
    fastest: float

    def turning(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Extensions (n,) outward from lift-off on either side at which launches turn, and the energies (n,) there."""
        sides = []
        for side in (1.0, -1.0):
            r = self.liftoff + side * FARTHEST * np.linspace(0, 1, EXTENSIONS) ** 3
            energy = self.potential(r) - self.potential(self.liftoff)
            before = np.maximum.accumulate(np.append(0.0, energy[:-1]))
            sides.append((r[energy > before], energy[energy > before]))
        return sides

    def lateness(self, alphas: np.ndarray) -> np.ndarray:
        """How much later than mid-flight the family's turn comes after launches (m,); infinite where none comes."""
        energy, rest, times = alphas**2 / 2, self.potential(self.liftoff), []
        for side, (r, energies) in zip((1.0, -1.0), self.turning(), strict=True):
            i = np.searchsorted(energies, energy).clip(max=len(r) - 1)
            low, high = np.append(self.liftoff, r)[i], r[i]
            for _ in range(55):
                middle = 0.5 * (low + high)
                beyond = self.potential(middle) - rest >= energy
                low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
            far = high[:, None] + (self.liftoff - high)[:, None] * SHARES**2
            speed = np.sqrt(2 * np.maximum(energy[:, None] - (self.potential(far) - rest), 1e-300))
            time_there = side * (high - self.liftoff) * ((2 * SHARES / speed) @ WEIGHTS)
            times.append(np.where(energy <= energies[-1], time_there, np.inf))
        return times[0] + self.family * (times[0] + times[1]) - alphas

    def roots(self, beside: np.ndarray) -> np.ndarray:
        """The launch speeds of its orbits, ascending. The grid has places on both sides of launch speeds (k,), so that
        close orbits are seen which it would leave out."""
        each = [energies for _, energies in self.turning()]
        alphas = np.sqrt(2 * np.concatenate([one[one < self.fastest**2 / 2] for one in each]))
        chosen = np.linspace(0, len(alphas) - 1, LAUNCHES).astype(int)
        around = np.outer([1 - BESIDE, 1 + BESIDE], beside).ravel()
        alphas = np.unique(np.concatenate([np.sort(alphas)[chosen], np.linspace(0.01, self.fastest, LAUNCHES), around]))
        late = self.lateness(alphas)
        low, high = ((alphas[:-1], alphas[1:])[k][(late[1:] > 0) != (late[:-1] > 0)] for k in (0, 1))
        rises = self.lateness(high) > 0
        for _ in range(45):
            middle = 0.5 * (low + high)
            beyond = (self.lateness(middle) > 0) == rises
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        return high

    def verdict(self) -> str:
        """What becomes of the family: one of the words that are counted."""
        try:
            orbits = find_all(self.machine, family=self.family, fastest=self.fastest)
        except NoOrbit as error:
            orbits, sure = (), "not complete" not in str(error)
        else:
            sure = orbits[0].known_in_family is not None
        found = np.array([orbit.alpha for orbit in orbits])
        roots = self.roots(found)
        if len(found) == len(roots) and np.allclose(found, roots, rtol=1e-5):
            return "whole"
        return "one too many" if len(found) > len(roots) else "lacks one" if sure else "lacks one and says so"


def families(count: int, seed: int) -> Iterator[Family]:
    """Families 1 to 3 of hoppers and jugglers, on springs of three kinds by turns."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        p, spring, potential = _random_spring(rng, i % 3)
        hops, family = bool(rng.random() < 0.5), int(rng.integers(1, 4))
        machine = (Hopper if hops else Juggler)(spring, mass_ratio=2.0, rest_length=3000.0, parameters=p)
        if hops:
            yield Family(machine, family, potential, find(machine).liftoff_extension, 25.0 + 15 * family)
        else:
            yield Family(machine, family, lambda r, of=potential: of(r) + r, 0.0, 25.0 + 15 * family)


def _random_spring(rng: np.random.Generator, kind: int) -> tuple[dict[str, float], str, Callable]:
    """The parameters, the formula and the potential of a random spring: nearly flat at one extension, with waves, or
    softening before it stiffens."""
    if kind == 0:
        at, above = rng.uniform(3, 40) ** 2, 10 ** rng.uniform(-4, -0.7)
        p = {"b": -2 / at, "d": (1 + above) / at**2}
        return p, "r + b*r**3 + d*r**5", lambda r: r**2 / 2 + p["b"] * r**4 / 4 + p["d"] * r**6 / 6
    if kind == 1:
        p = {"a": rng.uniform(0.05, 0.5), "w": rng.uniform(0.2, 2)}
        return p, "r + a*sin(w*r)", lambda r: r**2 / 2 - p["a"] / p["w"] * np.cos(p["w"] * r)
    p = {"c": np.exp(rng.uniform(-4, 0)), "d": np.exp(rng.uniform(-11, -2))}
    return p, "r/(1 + c*r**2) + d*r**3", lambda r: np.log1p(p["c"] * r**2) / (2 * p["c"]) + p["d"] * r**4 / 4


def judged(case: Case) -> str:
    """What becomes of a case: one of the five words that are counted."""
    try:
        orbit = find(case.machine, case.family)
    except NoOrbit:
        orbit = None
    scanned = case.scanned(orbit.alpha if orbit else np.inf)
    if orbit is None:
        return "refused though there is one" if scanned else "none, as scanned"
    if not case.holds(orbit.alpha, orbit.flight_time / 2):
        return "wrong"
    return "not the lowest" if scanned and scanned[0] < orbit.alpha * (1 - SAME) else "lowest"


def main(bump_count: int = 300, wiggle_count: int = 500, seed: int = 1, family_count: int = 100) -> dict[str, Counter]:
    """How many cases of each kind come to what, printed as they end."""
    found = {}
    for cases, count in ((bumps, bump_count), (wiggles, wiggle_count)):
        began, counts = time.perf_counter(), Counter()
        for i, case in enumerate(cases(count, seed)):
            verdict = judged(case)
            counts[verdict] += 1
            if verdict not in ("lowest", "none, as scanned"):
                print(f"      {i}: {verdict}: {case.machine} family {case.family}")
        print(f"  {cases.__name__:<10}{dict(counts)}   {time.perf_counter() - began:.0f} s")
        found[cases.__name__] = counts
    began, counts = time.perf_counter(), Counter()
    for i, family in enumerate(families(family_count, seed)):
        verdict = family.verdict()
        counts[verdict] += 1
        if verdict != "whole":
            print(f"      {i}: {verdict}: {family.machine} family {family.family}")
    print(f"  families  {dict(counts)}   {time.perf_counter() - began:.0f} s")
    return {**found, "families": counts}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a few cases of each kind")
    parser.add_argument("--seed", type=int, default=1, help="of the random laws")
    arguments = parser.parse_args()
    logging.getLogger("orbits").setLevel(logging.ERROR)
    main(*((1, 4) if arguments.quick else (300, 500)), seed=arguments.seed, family_count=3 if arguments.quick else 100)
