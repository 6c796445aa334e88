"""Proofs of random wheels and rockers with nonlinear springs, against a plain integration of each.

The orbits are searched for with SciPy alone: the half flight of a wheel ends where the inner body and the wheel are
upright together, that of a rocker where both rest, and the half contact where the spring is at rest. Each machine has
the formulas of `rates_of` and an odd spring; an orbit is a motion where both feet stay off the ground in flight and
press in contact. Of each orbit a true claim is proved, and a false one is refused: another family, a launch speed that
is off by 1e-9 of it and ten times its error, or the orbit of a machine with another angle or another spring.
Run: python studies/proved_steps.py [--count 200] [--seed 1]
"""

import argparse
import json
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import InputError, Mechanism, NoOrbit, find
from orbits.check_proof import check
from orbits.exact import Claim
from orbits.mechanics import Potential, Spring
from orbits.proof import prove_claims
from studies.false_claims import SECONDS, bare

# Odd forces as formulas with a number c, and as functions.
LAWS: dict[str, Callable[[np.ndarray, float], np.ndarray]] = {
    "r + c*r**3": lambda r, c: r + c * r**3,
    "r - c*r**3": lambda r, c: r - c * r**3,
    "tanh(c*r)/c": lambda r, c: np.tanh(c * r) / c,
    "sinh(c*r)/c": lambda r, c: np.sinh(c * r) / c,
    "r/sqrt(1 + c*r**2)": lambda r, c: r / np.sqrt(1 + c * r * r),
    "r + 1.4*sin(c*r)/c": lambda r, c: r + 1.4 * np.sin(c * r) / c,
}
# Launch speeds that are tried, as shares of that of the linear machine, and the accuracy of the integration.
SHARES, RTOL = np.geomspace(0.4, 2.5, 40), 1e-11
# Launch speeds of both methods agree to this share; a motion that comes nearer than this to a violation is not counted.
SAME, CLEAR = 1e-7, 1e-6
# How the second program begins to say that it does not follow a motion, which contradicts nothing.
NOT_ENCLOSED = "the motion is not enclosed"


@dataclass(frozen=True)
class Stepper:
    """A wheel or a rocker: mu = J/A, kappa = M g l/k (M g h/k), the angle, and the spring over its stiffness."""

    kind: str
    mu: float
    kappa: float
    angle: float
    law: str
    c: float

    @property
    def machine(self) -> Mechanism:
        """The machine of the toolkit; the coordinates are counted from the closed gap."""
        wheel = self.kind == "wheel"
        energy = "kappa*cos(theta - angle)" if wheel else "kappa*(cos(theta) + tan(angle)*sin(theta))"
        feet = {"rear foot": "theta", "front foot": "2*angle - theta"}
        maps = {
            "reversor": {"theta": "2*angle - theta", "phi": "2*angle - phi"} if wheel else {},
            "symmetry": {name: f"{name} - 2*angle" if wheel else f"-{name}" for name in ("theta", "phi")},
            "gaps": feet if wheel else {"foot": "theta"},
        }
        numbers = {"mu": self.mu, "kappa": self.kappa, "angle": self.angle, "c": self.c}
        return Mechanism(
            ("phi", "theta"), [Spring("phi - theta", self.law), Potential(energy)], name=self.kind,
            inertia={"phi": 1.0, "theta": "1/mu"}, parameters=numbers, **maps,
        )  # fmt: skip

    def force(self, r: Any) -> Any:
        """The torque of the spring."""
        return LAWS[self.law](r, self.c)

    def weight(self, theta: Any) -> Any:
        """The torque of gravity."""
        if self.kind == "wheel":
            return self.kappa * np.sin(theta - self.angle)
        return self.kappa * (np.sin(theta) - np.tan(self.angle) * np.cos(theta))

    @property
    def liftoff(self) -> float:
        """The extension at lift-off; raises `ValueError` where the spring does not reach it."""
        level = -float(self.weight(0.0))
        return brentq(lambda r: float(self.force(r)) - level, 0.0, 20 * level, xtol=1e-15)

    def flight(self, speed: float, turns: int) -> Any:
        """The motion (phi, phi', theta, theta') from lift-off to the turn of this number: of a wheel, where the spring
        is at rest, of a rocker, where its rate is 0."""
        odd = self.kind == "wheel"

        def rates(t: float, x: np.ndarray) -> list[float]:
            pull = float(self.force(x[0] - x[2]))
            return [x[1], -pull, x[3], self.mu * (float(self.weight(x[2])) + pull)]

        def turned(t: float, x: np.ndarray) -> float:
            return x[0] - x[2] if odd else x[1] - x[3]

        turned.terminal = turns  # type: ignore[attr-defined]
        away = lambda t, x: 10.0 - abs(x[2]) - abs(x[0])  # noqa: E731
        away.terminal = True  # type: ignore[attr-defined]
        start = [self.liftoff, speed, 0.0, 0.0]
        return solve_ivp(
            rates, (0, 1e3), start, "DOP853", events=(turned, away), rtol=RTOL, atol=1e-13, dense_output=True
        )

    def miss(self, speed: float, family: int) -> float:
        """What vanishes on an orbit; no number where the flight has no such turn."""
        odd = self.kind == "wheel"
        flown = self.flight(speed, family if odd else family + 1)
        if len(flown.t_events[0]) < (family if odd else family + 1):
            return math.nan
        return flown.y[2, -1] - self.angle if odd else flown.y[3, -1]

    def orbit(self, family: int, near: float) -> "Found | None":
        """The orbit of a family whose launch speed is nearest to this one; None where there is none among `SHARES`."""
        speeds = near * SHARES
        misses = np.array([self.miss(speed, family) for speed in speeds])
        places = [i for i in range(len(speeds) - 1) if misses[i] * misses[i + 1] < 0]
        if not places:
            return None
        i = min(places, key=lambda i: abs(math.log(SHARES[i])))
        speed = brentq(self.miss, speeds[i], speeds[i + 1], args=(family,), xtol=1e-14, rtol=1e-14)
        return self.measured(speed, family)

    def measured(self, speed: float, family: int) -> "Found":
        """The rest of an orbit of this launch speed."""
        flown = self.flight(speed, family if self.kind == "wheel" else family + 1)
        half, r0 = flown.t[-1], self.liftoff
        middle = lambda t, x: x[0]  # noqa: E731
        middle.terminal = True  # type: ignore[attr-defined]
        contact = lambda t, x: [x[1], -float(self.force(x[0]))]  # noqa: E731
        stood = solve_ivp(contact, (0, 1e3), [-r0, speed], "DOP853", events=middle, rtol=RTOL, atol=1e-13)
        theta = flown.sol(np.linspace(0, half, 4001))[2][1:]
        gaps = [theta[20:], 2 * self.angle - theta] if self.kind == "wheel" else [theta[20:]]
        level = self.force(r0)
        forces = [level - self.force(stood.y[0]), (level + self.force(stood.y[0]))[1:]]
        rate = np.diff(np.sign(np.diff(flown.sol(np.linspace(0, half, 4001))[[0, 2]].T @ [1.0, -1.0])))
        ends = bool(stood.t_events[0].size)
        least = min(*(gap.min() / self.angle for gap in gaps), *(force.min() / level for force in forces))
        return Found(speed, half, stood.t[-1], int((rate != 0).sum()), least if ends else -1.0)


@dataclass(frozen=True)
class Found:
    """An orbit by SciPy: launch speed, half times, turns of the spring within the half flight, and the least gap over
    the angle or force over that at lift-off, below 0 where it is no motion."""

    speed: float
    flight: float
    contact: float
    turns: int
    least: float


def rates_of(mu: float, kappa: float) -> tuple[float, float]:
    """p and q, with p^2 and -q^2 the eigenvalues of the linear flight."""
    trace, product = mu * kappa - 1 - mu, -mu * kappa
    root = math.sqrt(trace * trace - 4 * product)
    return math.sqrt((trace + root) / 2), math.sqrt((root - trace) / 2)


def linear_speed(kind: str, mu: float, kappa: float, family: int) -> float:
    """The launch speed of the linear machine, over its angle."""
    p, q = rates_of(mu, kappa)
    c = p * p * q * q / (mu * (p * p + q * q))
    if kind == "rocker":
        ends = family * math.pi / q, (family + 0.5) * math.pi / q
        half = brentq(lambda s: p * math.sin(q * s) - q * math.tanh(p * s) * math.cos(q * s), *ends, xtol=1e-15)
        return c * (p * math.tanh(p * half) + q * math.tan(q * half))
    ends = (family - 0.5) * math.pi / q, family * math.pi / q
    half = brentq(lambda s: q * math.sin(q * s) + p * math.tanh(p * s) * math.cos(q * s), *ends, xtol=1e-15)
    return c * (p / math.tanh(p * half) - q / math.tan(q * half))


def random_stepper(rng: np.random.Generator, family: int) -> tuple[Stepper, float]:
    """A machine with a spring that is clearly nonlinear in its orbit of a family, and the linear launch speed."""
    number = lambda low, high: float(f"{math.exp(rng.uniform(math.log(low), math.log(high))):.4g}")  # noqa: E731
    kind, mu, kappa = str(rng.choice(["wheel", "rocker"])), number(0.08, 12.0), number(0.08, 4.0)
    angle, law = round(rng.uniform(0.1, 0.6), 4), str(rng.choice([*LAWS]))
    speed = linear_speed(kind, mu, kappa, family) * angle
    reach, share = max(speed, kappa * angle), number(0.03, 0.3 if law == "r - c*r**3" else 8.0)
    c = share / reach if "(c*r)" in law else share / reach**2
    return Stepper(kind, mu, kappa, angle, law, float(f"{c:.4g}")), speed


def false_of(claim: Claim, stepper: Stepper, index: int) -> tuple[str, Claim]:
    """A false claim, made of a true one."""
    match index % 4:
        case 0:
            return "family", replace(claim, family=claim.family + 1)
        case 1:
            return "alpha", replace(claim, alpha=claim.alpha * (1 + 1e-9) + 10 * claim.error)
        case 2:
            return "angle", replace(claim, machine=replace(stepper, angle=stepper.angle * (1 + 1e-9)).machine)
    return "spring", replace(claim, machine=stepper.machine.with_springs([f"{stepper.law} + 1e-20*r**2"]))


def proved(claim: Claim) -> tuple[Any, str]:
    """The proof of a claim, None where the machine is refused, and its verdict."""
    try:
        proof = prove_claims([claim], limit=SECONDS)[0]
    except InputError as error:
        return None, str(error)
    return proof, "proved" if proof.proved else "; ".join(proof.reasons)


def main(count: int = 200, seed: int = 1, second: int = 10) -> dict[str, int]:
    """How many orbits were motions, proved, and falsely proved; each theorem of `second` is also verified by the second
    program."""
    rng, numbers, index = np.random.default_rng(seed), Counter[str](), 0
    while numbers["orbits"] < count:
        family = int(rng.integers(1, 4))
        stepper, near = random_stepper(rng, family)
        try:
            truth = stepper.orbit(family, near)
        except ValueError:  # the spring is too weak to lift off
            truth = None
        if truth is None or abs(truth.least) < CLEAR or truth.turns != family:
            numbers["no orbit"] += 1
            continue
        start = {"liftoff": stepper.liftoff, "alpha": truth.speed, "duration": truth.flight}
        try:
            orbit = find(stepper.machine, start=start | {"contact_duration": truth.contact})
        except NoOrbit as error:
            print(f"not found: {stepper}, {error}", flush=True)
            numbers["not found"] += 1
            continue
        numbers["orbits"] += 1
        claim = replace(bare(orbit, stepper.machine), violations=(), family=family)
        proof, verdict = proved(claim)
        numbers["motions"] += truth.least > 0
        numbers["motions by certificates, or not, as here"] += (not orbit.violations) == (truth.least > 0)
        numbers["motions proved"] += truth.least > 0 and verdict == "proved"
        off = abs(orbit.alpha - truth.speed) > SAME * truth.speed
        numbers["false"] += verdict == "proved" and (truth.least < 0 or off)
        numbers["no motions, refuted"] += truth.least < 0 and "refuted" in proof.conditions.values()
        if (verdict == "proved") != (truth.least > 0):
            print(f"{stepper}, family {family}, {truth}: {verdict}", flush=True)
        if verdict == "proved" and index % second == 0:
            reasons = check(json.loads(json.dumps(proof.document())))
            not_enclosed = bool(reasons) and reasons[0].startswith(NOT_ENCLOSED)
            if reasons:
                print(f"{stepper}, family {family}, not verified: {reasons[0]}", flush=True)
            numbers["verified"] += not reasons
            numbers["not enclosed"] += not_enclosed
            numbers["second program"] += 1
        if verdict == "proved":
            what, false = false_of(claim, stepper, index)
            wrong = proved(false)[1] == "proved"
            numbers["false claims"] += 1
            numbers["false claims proved"] += wrong
            if wrong:
                print(f"{stepper}: proved with a wrong {what}", flush=True)
            index += 1
    found = {name: int(number) for name, number in numbers.items()}
    print(found)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--second", type=int, default=10)
    main(**vars(parser.parse_args()))
