"""Random mechanisms against Lagrange's equations in 120 digits, and coefficients whose structure decides."""

import re

import mpmath
import numpy as np
import pytest
from conftest import slow_after
from lagrange import DIGITS, Machine, equations

from orbits import Mechanism, find
from orbits.mechanics import Damper, Inerter, Mass, Potential, Spring, Weight

# A result may err by this much of the sum of the magnitudes of its terms, |M^-1| times those of the forces.
TOLERANCE = 1e-13


def mechanism_of(machine: Machine) -> Mechanism:
    """The machine as the toolkit takes it."""
    kinds = {(True, True): Mass, (True, False): Inerter, (False, True): Weight}
    return Mechanism(
        machine.coordinates,
        [
            *(kinds[moves, weighs](height, mass) for height, mass, moves, weighs in machine.masses),
            *(Spring(extension, force) for extension, force in machine.springs),
            *(Damper(extension, coefficient) for extension, coefficient in machine.dampers),
            *(Potential(energy) for energy in machine.potentials),
        ],
        machine.gap, machine.parameters, gravity=machine.gravity, surface_gravity=machine.surface,
        inertia=machine.inertia, counts=machine.coordinates[0],
    )  # fmt: skip


class Draw:
    """A random machine, of texts, with the values of its parameters."""

    def __init__(self, seed: int):
        self.random, self.parameters = np.random.default_rng(seed), dict[str, float]()
        random = self.random
        self.n = int(random.integers(2, 5))
        self.names = [f"q{i}" for i in range(self.n)]
        self.scale = 10.0 ** float(random.choice([0, 0, 0, 0, -30, 30, -12, 12]))
        self.spread = float(random.choice([0.0, 1.0, 1.0, 3.0, 8.0]))
        self.bent = bool(random.random() < 0.3)

    def pick(self, *values):
        return values[int(self.random.integers(len(values)))]

    def new(self, low: float = 0.5, high: float = 2.0, scale: float = 1.0) -> str:
        """The name of a new parameter between two values."""
        name = f"p{len(self.parameters)}"
        self.parameters[name] = float(self.random.uniform(low, high)) * scale
        return name

    def number(self, scale: float = 1.0) -> str:
        """A decimal."""
        return f"{self.random.uniform(0.5, 2.0) * scale:.3g}"

    def positive(self, scale: float = 1.0) -> str:
        """A formula of parameters, above 0, that is somewhat like the scale."""
        size = scale * 10.0 ** float(self.random.uniform(-self.spread, self.spread))
        match int(self.random.integers(12)):
            case 0:
                return self.number(size)
            case 1:
                return f"1 + {self.new(scale=4e17)}/4e17" if scale == 1 else self.new(scale=size)
            case 2:
                return f"(1e16 + 3 - 1e16)*{self.new(scale=size)}"
            case 3:
                a, b = self.new(scale=size), self.new()
                return f"{a}*{b}/{b}"
            case 4:
                a, b = self.new(1, 2), self.new(0.1, 0.6)
                return f"({a}**2 - {b}**2)/({a} - {b})*{size:.3g}"
            case 5:
                return f"1e16 + {self.new(scale=size)} - 1e16"
            case 6:
                return f"(1 + 1e-17)*{self.new(scale=size)}"
            case 7:
                a, b = self.new(scale=size), self.new(scale=size)
                return f"{a} + {b} - {b}"
            case 8:
                return f"{self.new(scale=1e30 * size)}*1e-30"
            case 9:
                a = self.new()
                return f"(sin({a})**2 + cos({a})**2)*{self.new(scale=size)}"
            case _:
                return self.new(scale=size)

    def lever(self) -> str:
        """A factor before a coordinate."""
        return self.pick(
            "", "", "", "2*", "0.1*", "1.0000000000000001*", "1/3*", f"{self.new()}*", "(1e16 + 3 - 1e16)*"
        )

    def sum(self) -> str:
        """A sum of some coordinates."""
        count = int(self.random.integers(1, self.n + 1))
        places = self.random.permutation(self.n)[:count]
        text = f"{self.lever()}{self.names[places[0]]}"
        for i in places[1:]:
            text += f" {self.pick('+', '-')} {self.lever()}{self.names[i]}"
        if self.random.random() < 0.15:
            extra = self.names[int(self.random.integers(self.n))]
            text += f" + 1e17*{extra} + 2*{extra} - 1e17*{extra}"
        return text

    def bend(self) -> str:
        """A height that is not a sum of coordinates, as that of a knee."""
        a, b = self.random.permutation(self.n)[:2]
        return self.pick(
            f"{self.names[a]} + 2*{self.new()}*sin({self.names[b]}/2)",
            f"{self.names[a]} + sqrt({self.new(4, 9)}**2 - {self.names[b]}**2)",
            f"{self.names[a]} + {self.new()}*cos({self.names[b]})",
            f"{self.names[a]} + {self.number()}*{self.names[b]}**2",
        )

    def heights(self) -> list[str]:
        """Heights of masses that make an inertia which is not singular."""
        names = self.names
        match int(self.random.integers(3)):
            case 0:
                own = list(names)
            case 1:  # each counted from the one before
                own = [" + ".join(names[: i + 1]) for i in range(self.n)]
            case _:
                own = [f"{self.lever()}{names[i]} - {names[i - 1]}" if i else names[0] for i in range(self.n)]
        return own

    def machine(self) -> Machine:
        random, masses = self.random, []
        for height in self.heights():
            masses.append((height, self.positive(self.scale), True, True))
        for _ in range(int(random.integers(0, 3))):
            height = self.bend() if self.bent else self.sum()
            masses.append((height, self.positive(self.scale), True, bool(random.integers(2))))
        if random.random() < 0.2:
            masses.append((self.sum(), self.positive(self.scale), False, True))
        inertia = []
        if random.random() < 0.25:
            inertia = [["0"] * self.n for _ in range(self.n)]
            for i in random.permutation(self.n)[:2]:
                inertia[i][i] = f"4*({self.positive(self.scale)})"
            if random.random() < 0.5:
                entry = f"{self.new(0.1, 0.2)}*{self.scale:g}*cos({self.names[1]})" if self.bent else "0"
                inertia[0][0], inertia[1][1] = (f"4*({self.number(self.scale)})" for _ in range(2))
                inertia[0][1] = inertia[1][0] = entry
        springs = [
            (self.sum() + self.pick("", "", " - 0.3", f" + {self.new()}"), self.law())
            for _ in range(int(random.integers(1, 4)))
        ]
        if random.random() < 0.3:  # along the extension of another one
            springs.append((f"{self.pick('2', '1.0000000000000001', '1/3', '1')}*({springs[0][0]})", self.law()))
        if self.bent and random.random() < 0.4:
            springs.append((self.bend(), self.law()))
        dampers = [(self.sum(), self.positive(self.scale)) for _ in range(int(random.random() < 0.25))]
        potentials = []
        if random.random() < 0.2:
            a, b = random.permutation(self.n)[:2]
            energy = self.pick("{0}**2*{1}", "cos({0}) + {1}**2/3", "{0}*{1}").format(self.names[a], self.names[b])
            potentials.append(f"({self.positive(self.scale)})*({energy})")
        surface = self.pick(
            "1", "9.81", self.new(), f"8 + {self.new(scale=1e-11)}*{self.new(scale=5e22)}/147763360000000000"
        )
        gravity = self.pick("1", "1", f"1/(1 + z/{self.new(20, 60)})**2")
        first, last = self.names[0], self.names[-1]
        gap = self.pick(last, last, f"{first} - {last}", f"0.3*{last} - 0.1*{first}", f"{first}/49*49 + {last}")
        used = " ".join(map(str, [masses, inertia, springs, dampers, potentials, surface, gravity, gap]))
        parameters = {name: value for name, value in self.parameters.items() if _named(name, used)}
        return Machine(
            tuple(self.names), masses, springs, gap, parameters, dampers, potentials, inertia, gravity, surface
        )

    def law(self) -> str:
        k = self.new(scale=self.scale)
        return self.pick(f"{k}*r", f"{k}*r", f"{k}*r + {self.new(scale=self.scale)}*r**3", f"{k}*exp(r) - {k}")


def _named(name: str, text: str) -> bool:
    return re.search(rf"\b{name}\b", text) is not None


def flat(machine: Machine, place, rates, held) -> tuple[list, list]:
    """What follows from Lagrange's equations, each number with the sum of the magnitudes of its terms: accelerations in
    flight, those of the contact's coordinates in contact, the contact force, the impact, and its mass."""
    closed, closed_rates, kept = held
    with mpmath.workdps(DIGITS):
        free = equations(machine, place, rates)
        inside = equations(machine, closed, closed_rates)
        flight, flight_sizes = free.flight()
        contact, contact_sizes, force, force_size = inside.contact()
        impact, mass = free.impact()
        values = [*flight, *(contact[i] for i in kept), force, *impact, mass]
        impact_sizes = [abs(each) + max(map(abs, impact)) * mpmath.mpf(10) ** -60 for each in impact]
        sizes = [*flight_sizes, *(contact_sizes[i] for i in kept), force_size, *impact_sizes, mass]
    return values, sizes


def ours(model, machine: Machine, place, rates, held) -> list[float]:
    """The equations as the toolkit derives them."""
    p = dict(machine.parameters) | ({"gravity_share": 1.0} if model.homotopy else {})
    closed, closed_rates, kept = held
    x = [part for pair in zip(place, rates, strict=True) for part in pair]
    s = [float(part) for i in kept for part in (closed[i], closed_rates[i])]
    found = [
        *model.flight.field(x, p, [])[1::2],
        *model.contact.field(s, p, [])[1::2],
        model.contact.watch["contact force"](s, p, []),
        *model.impact(x, p)[1::2],
        model.impact_mass(x, p),
    ]
    return [float(each) for each in found]


def state_of(machine: Machine, seed: int):
    """A random state of the flight, and one of the contact: all coordinates, and which of them its state has."""
    random, n = np.random.default_rng(seed + 10**6), len(machine.coordinates)
    place, rates = random.uniform(-0.5, 0.5, (2, n)).tolist()
    with mpmath.workdps(DIGITS):
        gap = equations(machine, place, rates).gap
        eliminated = max(range(n), key=lambda i: gap[i])
        kept = [i for i in range(n) if i != eliminated]
        closed, closed_rates = ([mpmath.mpf(each) for each in part] for part in (place, rates))
        for part in (closed, closed_rates):
            part[eliminated] = -sum(gap[i] * part[i] for i in kept)
    return place, rates, (closed, closed_rates, kept)


def largest_error(seed: int) -> float:
    """The largest error of a random machine, over the sum of the magnitudes of the terms."""
    machine = Draw(seed).machine()
    model, (place, rates, held) = mechanism_of(machine).model, state_of(machine, seed)
    found, (truth, sizes) = ours(model, machine, place, rates, held), flat(machine, place, rates, held)
    assert np.isfinite(found).all()
    return max(float(abs(a - b) / size) if size else abs(a) for a, b, size in zip(found, truth, sizes, strict=True))


@pytest.mark.parametrize("seed", slow_after(5, range(8)))
def test_random_mechanisms(seed):
    assert largest_error(seed) < TOLERANCE


def test_three_links_on_a_foot():
    """Each link ends in a mass, which moves up and across; their inertia varies with all angles."""
    angles, masses, elements = ("t1", "t2", "t3"), [("z", "m0", True, True)], [Mass("z", "m0")]
    for k in (1, 2, 3):
        up = "z + " + " + ".join(f"l{i}*cos(t{i})" for i in range(1, k + 1))
        across = " + ".join(f"l{i}*sin(t{i})" for i in range(1, k + 1))
        masses += [(up, f"m{k}", True, True), (across, f"m{k}", True, False)]
        elements.append(Mass(up, f"m{k}", across=across))
    elements += [Spring(angle, "k*r") for angle in angles]
    sizes = {"m0": 0.3, "m1": 1.0, "m2": 1e-9, "m3": 2.0, "l1": 1.0, "l2": 0.8, "l3": 1.3, "k": 20.0}
    springs = [(angle, "k*r") for angle in angles]
    machine = Machine(("z", *angles), masses, springs, "z", sizes, [], [], [], "1", "1")
    model = Mechanism(
        machine.coordinates, elements, "z", sizes, gravity=1.0, counts="t1", launch="t3", angles=angles
    ).model  # fmt: skip
    place, rates, held = state_of(machine, 3)
    found, (truth, sizes) = ours(model, machine, place, rates, held), flat(machine, place, rates, held)
    assert max(float(abs(a - b) / size) for a, b, size in zip(found, truth, sizes, strict=True) if size) < TOLERANCE


def hopper(body="m1", foot="m2", *, extension="body - foot", more=(), **stated) -> Mechanism:
    """A hopper with a linear spring."""
    parameters = {"m1": 2.0, "m2": 0.5, "k": 3.0} | stated.pop("parameters", {})
    elements = [Mass("body", body), Mass("foot", foot), Spring(extension, "k*r"), *more]
    used = " ".join(map(str, [elements, stated.get("surface_gravity", "")]))
    parameters = {name: value for name, value in parameters.items() if _named(name, used)}
    return Mechanism(("body", "foot"), elements, "foot", parameters, **stated)


C, G, MOON = {"c": 4e17}, 6.674e-11, 7.3e22


@pytest.mark.parametrize(
    ("stated", "plain"),
    [
        (hopper(foot="1 + c/4e17", parameters=C), hopper(foot="2")),
        (hopper(body="c/4e17 + 1", parameters=C), hopper(body="2")),
        (hopper(foot="(1e16 + 3 - 1e16)*m2"), hopper(foot="3*m2")),
        (hopper(foot="1e16 + m2 - 1e16"), hopper()),
        (hopper(foot="1e-30*c", parameters={"c": 5e29}), hopper()),
        (hopper(extension="1e17*body - foot - 1e17*body + body"), hopper()),
        (hopper(extension="body/49*49 - foot"), hopper()),
        (hopper(more=[Spring("1.0000000000000001*body - foot", "0.5*r")]), hopper(parameters={"k": 3.5})),
        (hopper(more=[Spring("2*body - 2*foot", "0.5*r")]), hopper(parameters={"k": 5.0})),
        (hopper(parameters={"m1": 2e-30, "m2": 5e-31, "k": 3e-30}), hopper()),
        (hopper(parameters={"m1": 2e30, "m2": 5e29, "k": 3e30}), hopper()),
        (
            hopper(surface_gravity="8 + G*moon/147763360000000000", parameters={"G": G, "moon": MOON}),
            hopper(surface_gravity=8 + G * MOON / 147763360000000000),
        ),
    ],
)
def test_the_same_machine_by_other_numbers(stated, plain):
    """A constant beside a parameter, numerals that cancel, and numbers far from 1 make no other machine."""
    ours, theirs = find(stated), find(plain)
    for name in ("alpha", "flight_time", "contact_time", "liftoff_extension"):
        assert getattr(ours, name) == pytest.approx(getattr(theirs, name), rel=1e-12), name
