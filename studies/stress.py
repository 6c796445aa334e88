"""The toolkit at its edges: each row ends in a certified orbit that another integrator confirms, or in a named refusal.

Silent wrongness is the only failure. What is certified is held against `oracle`: scipy's integrator on the launch, the
flight and the contact, the orbit's own error figure among what is checked; a closed form, or a map in 45 digits, where
there is one.
Run: python studies/stress.py [--full] [--seed 20]
"""

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import mpmath as mp
import numpy as np
from scipy.optimize import brentq

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from orbits import InputError, NoOrbit, ReturnMap, find, follow
from orbits.shooting import METHODS
from problems import Hopper, Juggler
from problems.laws import springs
from studies.oracle import bisected, by_another_integrator, landed

# Of a launch speed that is known in closed form, the largest share that an orbit may say it is off by.
LARGEST_ERROR = 1e-9


@dataclass
class Row:
    """What was tried, and how it ended."""

    name: str
    certified: int = 0
    refused: int = 0
    wrong: list[str] = field(default_factory=list)

    @property
    def tried(self) -> int:
        return self.certified + self.refused + len(self.wrong)

    def attempt(self, what: str, make: Callable, check: Callable = lambda orbit: None):
        """Count one attempt: `make` an answer, `check` it; the check returns what is wrong, in words."""
        try:
            complaint = check(make())
        except (NoOrbit, InputError) as error:
            self.refused += 1
            if len(str(error)) < 20:
                self.wrong.append(f"{what}: refused without a reason")
            return
        except Exception as error:
            self.wrong.append(f"{what}: {type(error).__name__}: {error}")
            return
        if complaint:
            self.wrong.append(f"{what}: {complaint}")
        else:
            self.certified += 1


def some(values: tuple[float, ...], full: bool, k: int) -> tuple[float, ...]:
    """All values in full, else one of them, each in turn."""
    return values if full else (values[k % len(values)],)


def is_alpha(expected: float, share: float = 1e-12) -> Callable:
    """(orbit) -> what is wrong with its launch speed."""

    def check(orbit):
        off = abs(orbit.alpha - expected)
        if not orbit.error <= LARGEST_ERROR * orbit.alpha:
            return f"alpha is known to {orbit.error:.1e} only"
        return None if off <= share * expected + 2 * orbit.error else f"alpha = {orbit.alpha!r}, not {expected!r}"

    return check


def tangent_root(n: int) -> float:
    """The n-th positive root of alpha = tan alpha."""
    return brentq(lambda a: np.sin(a) - a * np.cos(a), n * np.pi, (n + 0.5) * np.pi, xtol=1e-15, rtol=1e-15)


def beside_alpha(row: Row, full: bool, seed: int):
    """The map from one rounding to 1e-1 beside the lossless launch, against 45 digits."""
    star = tangent_root(1)
    for M in np.logspace(-3, 3, 13 if full else 4):
        step = ReturnMap(Hopper(mass_ratio=M))
        for d in (*np.spacing(star) * np.arange(1, 4), *np.geomspace(1e-14, 1e-1, 14)):
            for alpha in (star + d, star - d):

                def check(hop, d=d, M=M):
                    loss, impacts = landed(float(hop.alpha), M)
                    if not abs(hop.loss / loss - 1) <= 1e-13 + 4e-15 / d:
                        return f"loss {hop.loss}, not {loss}"
                    if hop.impacts != impacts:
                        return f"{hop.impacts} impacts, not {impacts}"
                    lifts = hop.alpha**2 > loss
                    if (hop.status == "lifts_off") != lifts:
                        return f"status {hop.status}"
                    off = lifts and not abs(hop.next - np.sqrt(hop.alpha**2 - hop.loss)) <= 1e-15 * hop.alpha
                    return f"next {hop.next}" if off else None

                row.attempt(f"M = {M:g}, alpha = {alpha!r}", lambda step=step, a=alpha: step(a), check)


def mass_ratios(row: Row, full: bool, seed: int):
    """Mass ratios from 1e-8 to 1e8: alpha does not depend on them, the contact's time does as a sine has it."""
    for M in np.logspace(-8, 8, 17):
        for n in (1, 2, 5):
            for kind in (Hopper, Juggler):

                def check(orbit, M=M, n=n):
                    omega = np.sqrt(M / (1 + M))
                    contact = 2 * (np.pi - np.arctan(tangent_root(n) * omega)) / omega
                    if not abs(orbit.contact_time / contact - 1) <= 1e-12:
                        return f"contact time {orbit.contact_time!r}, not {contact!r}"
                    return is_alpha(tangent_root(n))(orbit)

                row.attempt(f"{kind.kind}, M = {M:g}", lambda M=M, n=n, k=kind: find(k(mass_ratio=M), n), check)


def long_families(row: Row, full: bool, seed: int):
    """Families up to 1000, linear against alpha = tan alpha, cubic against the other integrator."""
    for n in (1, 10, 100, 300, 1000):
        row.attempt(f"linear {n}", lambda n=n: find(Hopper(), n), is_alpha(tangent_root(n)))
        row.attempt(f"relative {n}", lambda n=n: find(Hopper(), n, method="relative"), is_alpha(tangent_root(n)))
    for n in (10, 40, 100, 1000) if full else (40,):
        machine = Hopper("cubic")
        row.attempt(f"cubic {n}", lambda m=machine, n=n: find(m, n), by_another_integrator(machine, n))


def stiffnesses(row: Row, full: bool, seed: int):
    """Stiffness up to 1e8, of lines and of hardening springs."""
    for k in np.logspace(-4, 8, 13 if full else 5):
        expected = tangent_root(1) / np.sqrt(k)
        row.attempt(f"k = {k:g}", lambda k=k: find(Hopper("k*r", parameters={"k": k})), is_alpha(expected))
        machine = Hopper("r + k*r**3", parameters={"k": k})
        row.attempt(f"r + {k:g} r^3", lambda m=machine: find(m), by_another_integrator(machine, 1))
        machine = Hopper("sinh(k*r)/k", parameters={"k": k ** (1 / 3)})
        row.attempt(f"sinh, {k ** (1 / 3):g}", lambda m=machine: find(m), by_another_integrator(machine, 1))


def hardly_lifting(row: Row, full: bool, seed: int):
    """Springs whose tension rises to 1 + 10^-k, falls and rises again later: lift-off is at the first."""
    for k in range(1, 13, 1 if full else 2):
        for c in some((0.5, 1.0), full, k):
            top, s = 1 + 10.0**-k, 0.2
            q = (top - s * c**5) / c**2
            with mp.workdps(40):
                excess = lambda r, top=top, q=q, c=c, s=s: 1 - mp.mpf(top) + mp.mpf(q) * (r - c) ** 2 - s * (r - c) ** 5  # noqa: E731
                rho = float(bisected(excess, mp.mpf(0), mp.mpf(c)))
            machine = Hopper(f"{top!r} - {q!r}*(r - {c})**2 + {s}*(r - {c})**5")

            def check(orbit, machine=machine, rho=rho, k=k):
                if not abs(orbit.liftoff_extension - rho) <= 1e-14 * 10.0 ** (k / 2) * 10:
                    return f"lifts off at {orbit.liftoff_extension!r}, not {rho!r}"
                return by_another_integrator(machine, 1)(orbit)

            row.attempt(f"top 1 + 1e-{k} at {c}", lambda m=machine: find(m), check)


def collapsing(row: Row, full: bool, seed: int):
    """Either side of where the contact collapses: an admissible orbit before, a named violation after."""
    machine = Hopper("cubic", parameters={"beta": 0.0})
    family = follow(machine, "beta", -0.0105)
    for event in (event for event in family.events if event.kind == "collapse"):
        for d in np.geomspace(1e-3, 1e-12, 10) * abs(event.point.value):
            for side in (1, -1):
                here = machine.with_values(beta=event.point.value + side * d)

                def check(orbit, side=side):
                    ended, said = orbit.contact_time is not None, "collapses" in " ".join(orbit.violations)
                    if ended != (side > 0) or said == ended:
                        return f"the contact {'ends' if ended else 'does not end'}, violations {orbit.violations}"
                    return None

                row.attempt(f"beta {side * d:+.1e}", lambda m=here: find(m), check)


def escaping(row: Row, full: bool, seed: int):
    """Saturating springs up to 1e-9 of where family n escapes, b = 1/(2 n + 1), and beyond it."""
    for n in (1, 2, 3) if full else (1,):
        for k in range(1, 10):
            for side in (-1, 1):
                machine = Hopper("tanh", parameters={"b": 1 / (2 * n + 1) + side * 10.0**-k})
                check = by_another_integrator(machine, n) if side < 0 else lambda orbit: "beyond its end"
                row.attempt(f"tanh {n}, {side * 10.0**-k:+.0e}", lambda m=machine, n=n: find(m, n), check)


def falling_gravity(row: Row, full: bool, seed: int):
    """Gravity that falls to 1e-3, and far below it, within the hop."""
    for law, values in (
        ("1/(1 + z/R)**2", (100.0, 10.0, 4.0, 1.0, 0.3, 0.1, 0.03)),
        ("1/(1 + (z/R)**4)", (20.0, 10.0, 5.0, 3.0, 2.0, 1.5, 1.0)),
        ("exp(-z/R)", (100.0, 10.0, 4.0, 2.0, 1.0, 0.5)),
        ("exp(-(z/R)**2)", (20.0, 6.0, 4.0, 3.0, 2.0, 1.5)),
        ("1 - z/R", (100.0, 20.0, 10.0, 8.0, 7.0, 6.0)),
    ):
        for k, value in enumerate(values if full else values[::2]):
            for length in some((2.0, 9.0), full, k):
                machine = Hopper("r", law, rest_length=length, parameters={"R": value})
                what = f"{law}, R = {value:g}, length {length:g}"
                row.attempt(what, lambda m=machine: find(m), by_another_integrator(machine, 1))


def breakpoints(row: Row, full: bool, seed: int):
    """Breakpoints exactly at rest and at the lift-off extension, and one rounding beside."""
    for k, at in enumerate((0.0, 1.0, np.nextafter(1.0, 0), np.nextafter(1.0, 2), 1e-12, -1.0)):
        for ratio in some((0.5, 3.0, 100.0), full, k):
            law = springs.function(
                lambda r, at=at, ratio=ratio: r + (ratio - 1) * ((r - at) + abs(r - at)) / 2, breakpoints=(at,)
            )
            machine = Hopper(law)
            row.attempt(f"kink at {at!r}, {ratio:g}", lambda m=machine: find(m), by_another_integrator(machine, 1))
    for gap in (0.0, 0.5, 1.0, 2.0) if full else (0.0, 1.0):
        for spring in ("bilinear", "end_stops"):
            machine = lambda gap=gap, spring=spring: Hopper(spring, parameters={"gap": gap})  # noqa: E731
            check = lambda orbit, m=machine: by_another_integrator(m(), 1)(orbit)  # noqa: E731
            row.attempt(f"{spring} {gap}", lambda m=machine: find(m()), check)


def tables(row: Row, full: bool, seed: int):
    """Measured tables: noisy, with few, repeated and unsorted rows."""
    rng, ordered = np.random.default_rng(seed), {}
    for count in (2, 3, 4, 5, 8, 20, 100):
        r = np.linspace(-12, 8, count)
        for noise in (0.0, 1e-6, 1e-2, 0.3):
            force = r + 0.02 * r**3 + noise * rng.normal(size=count)
            for name, order in (
                ("sorted", np.arange(count)),
                ("shuffled", rng.permutation(count)),
                ("repeated", np.sort(np.r_[np.arange(count), 0])),
            ):
                what, pairs = f"{count} rows, noise {noise:g}, {name}", (r[order], force[order])
                if count < 4:
                    row.attempt(what, lambda pairs=pairs: springs.table(pairs))
                    continue
                machine = Hopper(springs.table(pairs))
                alphas = ordered.setdefault((count, noise), [])

                def check(orbit, machine=machine, alphas=alphas):
                    alphas.append(orbit.alpha)
                    if not np.ptp(alphas) <= 1e-12 * orbit.alpha:
                        return f"the order of rows matters: {alphas}"
                    return by_another_integrator(machine, 1)(orbit)

                row.attempt(what, lambda m=machine: find(m), check)


def singular(row: Row, full: bool, seed: int):
    """Formulas whose derivative is singular at rest, or that have no value beyond some extension."""
    for text in (
        "r*abs(r)**0.5",
        "r*abs(r)**(-0.5)",
        "r*abs(r)**(-0.9)",
        "abs(r)*r",
        "sqrt(r)",
        "log(1 + r)",
        "log(20 + r) - log(20)",
        "r/sqrt(1 + r**2) + 0.1*r",
        "r/(1 - r/3)",
        "1/(3 - r) - 1/3",
        "tan(r/4)*4",
        "exp(exp(r)) - exp(1)",
        "r**(1/3)",
        "r + 1/(r + 9) - 1/9",
    ):
        machine = Hopper(text)
        row.attempt(text, lambda m=machine: find(m), by_another_integrator(machine, 1))


def methods(row: Row, full: bool, seed: int):
    """Every way against every other."""
    for machine in (
        Hopper(),
        Hopper("cubic", mass_ratio=0.2),
        Hopper("sinh", "1/(1 + z/80)**2", rest_length=12),
        Juggler("r + 0.2*r**3", "1/(1 + z/200)**2", rest_length=12),
        Juggler("tanh"),
    ):
        for family in (1, 2, 3) if full else (1,):
            alphas, reasons = {}, {}
            for method in METHODS:
                try:
                    alphas[method] = find(machine, family, method=method).alpha
                except InputError:  # not for this machine
                    continue
                except NoOrbit as error:
                    reasons[method] = error
            for method, reason in reasons.items():  # one way that refuses where another answers is wrong
                row.attempt(f"{machine.kind} {method}", lambda e=reason: _raise(e), lambda _: None)
                if alphas:
                    row.wrong.append(f"{machine.kind} {method} refuses: {reason}, {', '.join(alphas)} do not")
            first = next(iter(alphas.values()), None)
            for method, alpha in alphas.items():
                off = abs(alpha / first - 1)
                wrong = f"off by {off:.1e}" if not off <= 1e-11 else None
                row.attempt(f"{machine.kind} {method}", lambda: None, lambda _, wrong=wrong: wrong)


def _raise(error: Exception):
    raise error


def half_steps(row: Row, full: bool, seed: int):
    """Families at half the step: the same events at the same places, the same orbits at the same values."""
    for spring, name, stop in (
        ("cubic", "beta", 3.0),
        ("cubic", "beta", -0.0107),
        ("tanh", "b", 0.3),
        ("sinh", "b", 2.0),
        ("toda", "b", 0.4),
        ("bilinear", "ratio", 6.0),
    ):
        machine = Hopper(spring, rest_length=30.0)
        start = 0.0 if spring == "cubic" else 1.0 if spring == "bilinear" else 0.05
        asked = tuple(np.linspace(start, stop, 5)[1:-1])
        walk = lambda longest, m=machine, n=name, s=stop, b=start, a=asked: follow(m, n, s, b, at=a, longest=longest)  # noqa: E731

        def check(families):
            one, two = families
            if [e.kind for e in one.events] != [e.kind for e in two.events] or one.end.kind != two.end.kind:
                return f"{[e.kind for e in one.events]}, {one.end}; {[e.kind for e in two.events]}, {two.end}"
            for a, b in zip(one.events, two.events, strict=True):
                if not abs(a.point.alpha / b.point.alpha - 1) <= (1e-7 if a.kind == "fold" else 1e-10):
                    return f"{a.kind} at {a.point.alpha!r} and {b.point.alpha!r}"
            return None

        row.attempt(f"{spring} to {stop:g}", lambda w=walk: (w(0.02), w(0.01)), check)


def random_laws(count: int, seed: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Smooth springs that reach the foot's weight: polynomials, hyperbolic tangents and exponentials."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        kind = rng.integers(4)
        if kind == 0:
            a, b, c = rng.normal(0, 0.05), rng.normal(0.1, 0.15), abs(rng.normal(0, 0.02))
            yield "r + a*r**2 + b*r**3 + c*r**5", {"a": a, "b": b, "c": c}
        elif kind == 1:
            yield "tanh(b*r)/b + c*r**3", {"b": rng.uniform(0.05, 0.6), "c": rng.uniform(0, 0.2)}
        elif kind == 2:
            b = rng.choice([-1, 1]) * rng.uniform(0.02, 0.6)
            yield "(exp(b*r) - 1)/b", {"b": b}
        else:
            yield "s*r + (1 - s)*sinh(b*r)/b", {"s": rng.uniform(0, 1), "b": rng.uniform(0.1, 1.5)}


def laws(row: Row, full: bool, seed: int):
    """Random laws, families 1 to 3: in full 2,000 by four seeds."""
    seeds, each = ((seed, seed + 1, seed + 2, seed + 3), 500) if full else ((seed,), 60)
    for index, (text, parameters) in enumerate(law for one in seeds for law in random_laws(each, one)):
        family = index % 3 + 1
        machine = Hopper(text, parameters=parameters, mass_ratio=0.3 + index % 5, rest_length=500)
        check = by_another_integrator(machine, family)
        row.attempt(f"family {family} of {text} {parameters}", lambda m=machine, n=family: find(m, n), check)


ROWS: tuple[Callable, ...] = (
    beside_alpha, mass_ratios, long_families, stiffnesses, hardly_lifting, collapsing, escaping, falling_gravity,
    breakpoints, tables, singular, methods, half_steps, laws,
)  # fmt: skip


def main(full: bool = False, seed: int = 20, rows: Iterable[Callable] = ROWS) -> list[Row]:
    """The rows, each printed as it ends."""
    found = []
    print(f"  {'what':<22}{'tried':>7}{'certified':>11}{'refused':>9}{'wrong':>7}{'seconds':>9}")
    for fill in rows:
        began, row = time.perf_counter(), Row(fill.__name__.replace("_", " "))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            fill(row, full, seed)
        seconds = time.perf_counter() - began
        print(f"  {row.name:<22}{row.tried:>7}{row.certified:>11}{row.refused:>9}{len(row.wrong):>7}{seconds:>9.1f}")
        for complaint in row.wrong:
            print(f"      {complaint}")
        found.append(row)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--full", action="store_true", help="2,000 random laws and more of everything")
    parser.add_argument("--seed", type=int, default=20, help="of the random laws and tables")
    arguments = parser.parse_args()
    raise SystemExit(any(row.wrong for row in main(arguments.full, arguments.seed)))
