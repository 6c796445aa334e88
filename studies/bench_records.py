"""Random records of test stands: is the true alpha within three stated deviations, or is the record refused with the
choice that it leaves open?

Springs without loss, with dry friction (Jenkins) and viscoelastic (a standard linear solid), driven through 1 to 10
equal or growing cycles, from rest or from a running test, with noise and drift, rounded to 0.1 N, in 8 to 5,000 rows
under six headers. A refusal that names a choice is answered with it, as a user would. The truth is the orbit of the
branch that the text of the law names, without noise, drift and rounding.
Run: python studies/bench_records.py [--count 300] [--seed 1] [--quick]
"""

import argparse
import re
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from orbits import InputError, NoOrbit, find
from orbits.laws import Law
from problems import hopper_in_si, springs

KINDS = ("elastic", "friction", "viscoelastic")
ROWS, CYCLES, STEP, GRAVITY = (8, 5000), 10, 0.1, 9.80665
DENSE = 800  # rows of a half cycle of the truth
HEADERS = (
    "Position (mm);Load (N)",
    "Servo Displacement [mm];Spring Displacement [mm];Force [N]",
    "Weg [mm];Kraft [N]",
    "Displacement [mm];Force Setpoint [N];Force Actual [N]",
    "Deflection;Force",
    "",
)
# The choices of a user whom a message asks for one, in the order in which they are made.
CHOICES = ("columns", "units", "branch", "cycle")


class Stand(NamedTuple):
    """A spring and how it was measured; lengths in m, forces in N, times in cycles.

    kind : one of `KINDS`
    stiffness, cubic, amplitude : force k x + b x**3 up to the largest extension
    friction, slip, relaxing, time : of the friction, where it slips, and of the second spring with its damper
    turns : the extensions at which it turns, from the first row on; `before` those before that
    """

    kind: str
    stiffness: float
    cubic: float
    amplitude: float
    friction: float
    slip: float
    relaxing: float
    time: float
    before: list[float]
    turns: list[float]
    is_sine: bool

    @property
    def cycles(self) -> int:
        return (len(self.turns) - (2 if self.turns[0] == 0.0 else 1)) // 2

    def elastic(self, x: np.ndarray) -> np.ndarray:
        return self.stiffness * x + self.cubic * x**3

    def measured(self, rows: int) -> tuple[np.ndarray, np.ndarray]:
        """Extensions and forces (rows,) of the record at even times, without noise."""
        x, force = self.history()
        first = DENSE * len(self.before)
        times = np.linspace(first, len(x) - 1, rows)
        return np.interp(times, np.arange(len(x)), x), np.interp(times, np.arange(len(x)), force)

    def history(self) -> tuple[np.ndarray, np.ndarray]:
        """Extensions and forces at `DENSE` times of each half cycle, from those before the record on."""
        every = np.array([*self.before, *self.turns])
        place = np.arange(DENSE * (len(every) - 1) + 1) / DENSE
        index = np.clip(place.astype(int), 0, len(every) - 2)
        share = place - index
        if self.is_sine:
            share = np.where(index == 0, np.sin(np.pi / 2 * share) if every[0] == 0 else share, share)
            share = np.where((index > 0) | (every[0] != 0), (1 - np.cos(np.pi * share)) / 2, share)
        x = every[index] + share * (every[index + 1] - every[index])
        steps, more, state = np.diff(x, prepend=x[0]), np.zeros(len(x)), 0.0
        slip, decay = self.friction / self.slip if self.slip else 0.0, np.exp(-1 / (2 * DENSE * self.time))
        for i, step in enumerate(steps):
            if self.kind == "friction":
                state = min(max(state + slip * step, -self.friction), self.friction)
            elif self.kind == "viscoelastic":
                state = decay * state + self.relaxing * self.time * 2 * DENSE * (1 - decay) * step
            more[i] = state
        return x, self.elastic(x) + more


def random_stand(rng: np.random.Generator) -> Stand:
    kind = KINDS[rng.integers(3)]
    stiffness, amplitude = np.exp(rng.uniform(np.log(500), np.log(3000))), rng.uniform(0.02, 0.04)
    cycles, grows, from_rest = int(rng.integers(1, CYCLES + 1)), rng.random() < 0.4, rng.random() < 0.7
    sizes = np.linspace(0.2, 1.0, cycles) if grows and cycles > 1 else np.ones(cycles)
    turns = [sign * size * amplitude for size in sizes for sign in (1, -1)]
    if from_rest:
        before, turns = [], [0.0, *turns, 0.0]
    else:  # cut out of a running test at a lower extreme
        before, turns = [0.0, turns[0], turns[1], turns[0]], [turns[1], *turns]
    return Stand(
        kind, float(stiffness), rng.uniform(-0.15, 0.5) * stiffness / amplitude**2, amplitude,
        rng.uniform(0.01, 0.15) * stiffness * amplitude, rng.uniform(0.005, 0.1) * amplitude,
        rng.uniform(0.05, 0.3) * stiffness, float(np.exp(rng.uniform(np.log(0.02), np.log(1.0)))),
        before, turns, rng.random() < 0.4,
    )  # fmt: skip


class Outcome(NamedTuple):
    """What became of a record.

    what, kind : the record in words, and its kind
    chosen : the options that messages named and a user chose, in order
    verdict : "within" three deviations, "off", "refused" with a choice, "unnamed" where none is named, or "no orbit"
    off, stated : how many stated deviations alpha is off by, and what share of it is one of them
    text : of the law, or the message
    """

    what: str
    kind: str
    chosen: tuple[str, ...]
    verdict: str
    off: float = 0.0
    stated: float = 0.0
    text: str = ""


def written(path: Path, style: int, x: np.ndarray, force: np.ndarray) -> dict[str, Any]:
    """Write a record in mm and N under a header, and return what a user answers who is asked for its columns."""
    header, places = HEADERS[style], {1: (1, 2), 3: (0, 2)}.get(style, (0, 1))
    columns = 3 if len(header.split(";")) == 3 else 2
    lines = [header] if header else []
    for a, b in zip(1000 * x, force, strict=True):
        cells = [f"{1.03 * a:.4f}" if style == 1 else f"{b + 0.3:.1f}"] * columns
        cells[places[0]], cells[places[1]] = f"{a:.4f}", f"{b:.1f}"
        lines.append(";".join(cells).replace(".", "," if style == 2 else "."))
    path.write_text("\n".join(lines), encoding="utf-8")
    return {"columns": places, "units": ("mm", "N")}


def outcome(rng: np.random.Generator, folder: Path) -> Outcome:
    stand = random_stand(rng)
    rows = round(float(np.exp(rng.uniform(np.log(ROWS[0]), np.log(ROWS[1])))))
    noise, cycles = float(np.exp(rng.uniform(np.log(0.01), np.log(0.3)))), stand.cycles
    drift = rng.choice([0.0, 1.0]) * rng.normal() * 0.01 * stand.stiffness * stand.amplitude
    x, force = stand.measured(rows)
    force = force + noise * rng.normal(size=rows) + drift * np.linspace(0, 1, rows)
    force = np.round(force / STEP) * STEP
    answers = written(folder / "bench.csv", int(rng.integers(len(HEADERS))), x, force)
    answers |= {"branch": rng.choice(["loading", "unloading", "mean"]), "cycle": "last"}
    what = f"{stand.kind}, {rows} rows, {cycles} cycles, {'from rest' if stand.turns[0] == 0 else 'running'}, "
    what += f"{'growing' if stand.turns[1] < 0.99 * stand.amplitude else 'equal'}, noise {noise:.3g}, drift {drift:.3g}"
    options: dict[str, Any] = {} if stand.kind == "elastic" else {"branch": answers["branch"]}
    chosen = list[str]()

    def result(verdict: str, *numbers: float, text: str = "") -> Outcome:
        return Outcome(what, stand.kind, tuple(chosen), verdict, *numbers, text=text)

    while True:
        try:
            law = springs.table(folder / "bench.csv", in_si=True, **options)
            break
        except InputError as error:
            message = str(error)
            named = [name for name in CHOICES if f"{name}=" in message and options.get(name) != answers[name]]
            if other := re.search(r'choose branch="(\w+)"', message):
                named, answers["branch"] = ["branch"], other[1]
            elif "no cycle has the whole branch of mean" in message:  # what remains is another cycle
                return result("refused", text=message)
            elif 'choose cycle="all"' in message and answers["cycle"] != "all":
                named, answers["cycle"] = ["cycle"], "all"
            if not named or len(chosen) > 6:
                return result("refused" if named or "record more rows" in message else "unnamed", text=message)
            options[named[0]] = answers[named[0]]
            chosen.append(named[0])
    foot = rng.uniform(0.4, 0.7) * stand.stiffness * stand.amplitude / (4.6 * GRAVITY)
    masses = (foot * rng.uniform(1.0, 3.0), foot)
    try:
        orbit = find(hopper_in_si(*masses, force=law))
        true = find(hopper_in_si(*masses, force=true_law(stand, law.text, options.get("branch"))))
    except (NoOrbit, InputError) as error:
        return result("no orbit", text=f"...{str(error)[-150:]}; {law.text}")
    c, size = orbit.certificate, np.hypot(noise, STEP / np.sqrt(12))
    stated = float(np.hypot(c.alpha_noise or 0.0, (c.alpha_per_noise or 0.0) * (0 if c.alpha_noise else size)))
    off = (orbit.alpha - true.alpha) / stated
    return result("within" if abs(off) <= 3 else "off", off, stated / true.alpha, text=law.text)


def true_law(stand: Stand, text: str, branch: str | None) -> Law:
    """The branch of the cycle that the text of a law names, of the last one where it names none.

    The first loading of a record from rest is a virgin curve: the branches of its first cycle are those of the second.
    """
    if stand.kind == "elastic":
        return springs.formula("k*r + b*r**3", k=stand.stiffness, b=stand.cubic)
    found = re.search(r"cycle (\d+) of \d+", text)
    number = int(found[1]) if found else stand.cycles
    if stand.turns[0] == 0.0:
        stand = stand._replace(turns=[*stand.turns[:-1], *stand.turns[-3:-1]])
        number = max(number, 2)
    x, force = stand.history()
    first = DENSE * (len(stand.before) + 2 * number - 2)
    (up, above), (down, below) = (
        (x[start + 1 : start + DENSE + 1], force[start + 1 : start + DENSE + 1]) for start in (first, first + DENSE)
    )
    r = {"loading": up, "unloading": down[::-1]}.get(str(branch))
    if r is None:
        r = np.linspace(max(up[0], down[-1]), min(up[-1], down[0]), DENSE)
    curves = {"loading": np.interp(r, up, above), "unloading": np.interp(r, down[::-1], below[::-1])}
    return springs.table((r, curves.get(str(branch), sum(curves.values()) / 2)), in_si=True, noise=0)


def main(count: int, seed: int, quick: bool = False, verbose: bool = False) -> list[Outcome]:
    found = list[Outcome]()
    with tempfile.TemporaryDirectory() as folder:
        for i in range(4 if quick else count):
            each = outcome(np.random.default_rng([seed, i]), Path(folder))
            found.append(each)
            if verbose or each.verdict in ("off", "unnamed"):
                print(
                    i,
                    each.verdict,
                    f"{each.off:.2f} sd of {each.stated:.1e};",
                    each.what,
                    each.chosen,
                    each.text[:260],
                    flush=True,
                )
    print(f"{'':14}{'records':>8}{'within 3':>10}{'off':>6}{'refused':>9}{'no orbit':>10}   median deviation of alpha")
    for kind in (*KINDS, "all"):
        group = [each for each in found if kind in (each.kind, "all")]
        counts = Counter(each.verdict for each in group)
        stated = [each.stated for each in group if each.stated]
        print(
            f"{kind:14}{len(group):8}{counts['within']:10}{counts['off'] + counts['unnamed']:6}{counts['refused']:9}"
            f"{counts['no orbit']:10}   {np.median(stated) if stated else 0:.2e}"
        )
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    main(**vars(parser.parse_args()))
