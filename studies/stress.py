"""The toolkit at its edges: each row ends in a certified orbit that another integrator confirms, or in a named refusal.

Silent wrongness is the only failure. The check integrates the flight again by scipy's DOP853, from lift-off to
mid-flight, where the machine must be at rest and the extension have turned as often as the family says; where a closed
form or a local law is known, that is the truth instead.
Run: python studies/stress.py [--full] [--seed 20]
"""

import argparse
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import METHODS, InputError, NoOrbit, ReturnMap, find, follow
from problems import Hopper, Juggler, springs

# How far another integrator may disagree: its own error, grown over the flight.
AGREES = 1e-7
# A flight that makes more of a small change than this is beyond the check, though not beyond the toolkit.
GROWTH = 1e4


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


def by_another_integrator(machine, family: int) -> Callable:
    """(orbit) -> what is wrong with it: the flight integrated by DOP853 up to its middle."""

    def check(orbit) -> str | None:
        call = machine.model.flight.field
        p = machine.values
        data = []
        if machine.model.flight.pieces:
            breaks, values = machine.model.flight.pieces.table(p)
            weights = np.array(machine.model.flight.pieces.coordinate)
        extension = np.array(machine.model.extension.weights)

        def rates(t, x):
            nonlocal data
            if machine.model.flight.pieces:
                data = list(values[np.clip(np.searchsorted(breaks, weights @ x) - 1, 0, len(values) - 1)])
            return [float(rate) for rate in call(list(x), p, data)]

        turn = lambda t, x: extension @ rates(t, x)  # noqa: E731
        half, size = orbit.flight_time / 2, 1 + np.abs(orbit(np.linspace(0, orbit.flight_time, 50))).max()
        with np.errstate(all="ignore"):  # a trial step that overflows is refused by the integrator
            run = solve_ivp(rates, (0, half), orbit(0.0), "DOP853", rtol=1e-12, atol=1e-13 * size, events=turn)
        if not run.success:
            return f"the other integrator gives up: {run.message}"
        rest = np.abs(run.y[1::2, -1]).max()
        turns = np.sum((run.t_events[0] > 1e-9 * half) & (run.t_events[0] < half * (1 - 1e-6)))
        if orbit.family != family:
            return f"family {orbit.family}, not {family}"
        if rest > AGREES * size * max(1.0, half):
            return f"moves at {rest:.1e} in mid-flight"
        return None if turns == family else f"{turns} turns before mid-flight, not {family}"

    return check


def is_alpha(expected: float, share: float = 1e-12) -> Callable:
    """(orbit) -> what is wrong with its launch speed."""

    def check(orbit):
        off = abs(orbit.alpha - expected)
        return None if off <= share * expected + 2 * orbit.error else f"alpha = {orbit.alpha!r}, not {expected!r}"

    return check


def tangent_root(n: int) -> float:
    """The n-th positive root of alpha = tan alpha."""
    return brentq(lambda a: np.sin(a) - a * np.cos(a), n * np.pi, (n + 0.5) * np.pi, xtol=1e-15, rtol=1e-15)


def beside_alpha(row: Row, full: bool, seed: int):
    """The map from one rounding to 1e-1 beside the lossless launch: its loss against the local law C d^(4/3)."""
    for M in np.logspace(-3, 3, 13 if full else 4):
        step, star = ReturnMap(Hopper(mass_ratio=M)), tangent_root(1)
        C = find(Hopper(mass_ratio=M)).certificate.loss_coefficient
        for d in (*np.spacing(star) * np.arange(1, 4), *np.geomspace(1e-14, 1e-1, 14)):
            for side, factor in ((1, 1), (-1, 10)):

                def check(hop, d=d, side=side, factor=factor, C=C):
                    if hop.status != "lifts_off" and d < 1e-3:
                        return f"status {hop.status}"
                    if hop.loss < 0 or hop.next > hop.alpha:
                        return f"gains: loss {hop.loss}"
                    law = factor * C * 2 * tangent_root(1) * abs(hop.alpha - tangent_root(1)) ** (4 / 3)
                    near = 1e-12 < d < min(1e-6, 1e-4 / C**3)
                    return f"loss {hop.loss} beside {law}" if near and abs(hop.loss / law - 1) > 0.05 else None

                row.attempt(f"M = {M:g}, d = {side * d:g}", lambda step=step, a=star + side * d: step(a), check)


def mass_ratios(row: Row, full: bool, seed: int):
    """Mass ratios from 1e-8 to 1e8: alpha does not depend on them."""
    for M in np.logspace(-8, 8, 17):
        for n in (1, 2, 5):
            for kind in (Hopper, Juggler):
                row.attempt(f"M = {M:g}", lambda M=M, n=n, k=kind: find(k(mass_ratio=M), n), is_alpha(tangent_root(n)))


def long_families(row: Row, full: bool, seed: int):
    """Families up to 1000, linear against alpha = tan alpha, cubic against the other integrator."""
    for n in (1, 10, 100, 300, 1000):
        row.attempt(f"linear {n}", lambda n=n: find(Hopper(), n), is_alpha(tangent_root(n)))
        row.attempt(f"relative {n}", lambda n=n: find(Hopper(), n, method="relative"), is_alpha(tangent_root(n)))
    for n in (10, 40, 100, 1000) if full else (10, 40):
        machine = Hopper("cubic")
        row.attempt(f"cubic {n}", lambda m=machine, n=n: find(m, n), by_another_integrator(machine, n))


def stiffnesses(row: Row, full: bool, seed: int):
    """Stiffness up to 1e8, of lines and of hardening springs."""
    for k in np.logspace(-4, 8, 13):
        expected = tangent_root(1) / np.sqrt(k)
        row.attempt(f"k = {k:g}", lambda k=k: find(Hopper("k*r", parameters={"k": k})), is_alpha(expected))
        machine = Hopper("r + k*r**3", parameters={"k": k})
        row.attempt(f"r + {k:g} r^3", lambda m=machine: find(m), by_another_integrator(machine, 1))
        machine = Hopper("sinh(k*r)/k", parameters={"k": min(k, 500.0)})
        row.attempt(f"sinh({k:g} r)", lambda m=machine: find(m), by_another_integrator(machine, 1))


def hardly_lifting(row: Row, full: bool, seed: int):
    """Springs whose largest tension is 1 + 10^-k."""
    for k in range(1, 16):
        top = 1 + 10.0**-k
        b = 4 / (27 * top**2)  # the largest of r - b r^3
        machine = Hopper("r - b*r**3 + b**3*r**7", parameters={"b": b})
        row.attempt(f"r - b r^3, 1 + 1e-{k}", lambda m=machine: find(m), by_another_integrator(machine, 1))
        machine = Hopper("r/(1 + (r/(2*c))**2) + r**3/1e4", parameters={"c": top})
        row.attempt(f"falling again, 1 + 1e-{k}", lambda m=machine: find(m), by_another_integrator(machine, 1))


def collapsing(row: Row, full: bool, seed: int):
    """Either side of where the contact collapses: an admissible orbit before, a named violation after."""
    machine = Hopper("cubic", parameters={"beta": 0.0})
    family = follow(machine, "beta", -0.0105)
    for event in (event for event in family.events if event.kind == "collapse"):
        for d in np.geomspace(1e-3, 1e-12, 10) * abs(event.point.value):
            for side in (1, -1):
                here = machine.with_values(beta=event.point.value + side * d)

                def check(orbit, side=side):
                    ended = orbit.contact_time is not None
                    return None if ended == (side > 0) else "the contact " + ("ends" if ended else "does not end")

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
    """Gravity that falls to 1e-3 and less within the hop."""
    for law, name, values in (
        ("1/(1 + z/R)**2", "R", (100.0, 30.0, 15.0, 10.0, 8.0, 6.0, 4.0)),
        ("exp(-z/R)", "R", (100.0, 30.0, 15.0, 10.0, 8.0, 6.0, 4.0)),
        ("1 - k*z", "k", (0.01, 0.05, 0.1, 0.12, 0.15, 0.18, 0.2)),
    ):
        for value in values:
            for length in (2.0, 9.0):
                machine = Hopper("r", law, rest_length=length, parameters={name: value})
                what = f"{law}, {name} = {value:g}, length {length:g}"
                row.attempt(what, lambda m=machine: find(m), by_another_integrator(machine, 1))


def breakpoints(row: Row, full: bool, seed: int):
    """Breakpoints exactly at rest and at the lift-off extension, and one rounding beside."""
    for at in (0.0, 1.0, np.nextafter(1.0, 0), np.nextafter(1.0, 2), 1e-12, -1.0):
        for ratio in (0.5, 3.0, 100.0):
            law = springs.function(
                lambda r, at=at, ratio=ratio: r + (ratio - 1) * ((r - at) + abs(r - at)) / 2, breakpoints=(at,)
            )
            machine = Hopper(law)
            row.attempt(f"kink at {at!r}, {ratio:g}", lambda m=machine: find(m), _confirmed(machine, ratio, at))
    for gap in (0.0, 0.5, 1.0, 2.0):
        row.attempt(f"bilinear {gap}", lambda g=gap: find(Hopper("bilinear", parameters={"gap": g})))
        row.attempt(f"end stops {gap}", lambda g=gap: find(Hopper("end_stops", parameters={"gap": g})))


def _confirmed(machine, ratio: float, at: float) -> Callable:
    force = lambda r: r + (ratio - 1) * max(r - at, 0.0)  # noqa: E731

    def check(orbit):
        kink = lambda t, x: x[0] - at  # noqa: E731
        run = solve_ivp(
            lambda t, x: [x[1], -force(x[0])], (0, orbit.alpha), [orbit.liftoff_extension, orbit.alpha], "DOP853",
            rtol=1e-11, atol=1e-12, max_step=0.02 * orbit.alpha, events=kink,
        )  # fmt: skip
        return None if abs(run.y[1, -1]) < 1e-5 * (1 + orbit.alpha) else f"moves at {run.y[1, -1]:.1e} in mid-flight"

    return check


def tables(row: Row, full: bool, seed: int):
    """Measured tables: noisy, with few, repeated and unsorted rows."""
    rng = np.random.default_rng(seed)
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
                row.attempt(what, lambda m=machine: find(m), by_another_integrator(machine, 1))


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
        row.attempt(text, lambda t=text: find(Hopper(t)), lambda orbit: _equation(orbit))


def _equation(orbit) -> str | None:
    if not (np.isfinite(orbit.alpha) and orbit.error <= 1e-8 * (1 + orbit.alpha)):
        return f"alpha = {orbit.alpha} +- {orbit.error}"
    return None


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
            alphas = {}
            for method in METHODS:
                try:
                    alphas[method] = find(machine, family, method=method).alpha
                except InputError:  # not for this machine
                    continue
                except NoOrbit as error:
                    row.attempt(f"{machine.kind} {method}", lambda e=error: (_ for _ in ()).throw(e))
            first = next(iter(alphas.values()), None)  # none where there is no such family
            for method, alpha in alphas.items():
                off = abs(alpha / first - 1)
                row.attempt(
                    f"{machine.kind} {method}", lambda: None, lambda _, off=off: off > 1e-11 and f"off by {off:.1e}"
                )


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
    """Random laws, families 1 to 3: 2,000 in full."""
    for index, (text, parameters) in enumerate(random_laws(2000 if full else 60, seed)):
        family = index % 3 + 1
        machine = Hopper(text, parameters=parameters, mass_ratio=0.3 + index % 5, rest_length=500)
        check = by_another_integrator(machine, family)
        row.attempt(f"family {family} of {text} {parameters}", lambda m=machine, n=family: find(m, n), check)


ROWS: tuple[Callable, ...] = (
    beside_alpha, mass_ratios, long_families, stiffnesses, hardly_lifting, collapsing, escaping, falling_gravity,
    breakpoints, tables, singular, methods, laws,
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
