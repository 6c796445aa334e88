"""Models of a hopper, a juggler and a chain whose equations are written by hand, in the units of their modules: what
the models that follow from mechanics are held against, and what the tests break.

M is the mass ratio, c the damping, d the drag, phi the force of the spring and gamma the gravity, as a share of that at
the ground.
"""

from types import SimpleNamespace

import numpy as np

from orbits.model.liftoff import Liftoff
from orbits.model.model import DERIVED_FIELDS, Model
from orbits.model.phase import Affine, Phase
from orbits.periodic.guess import guess
from problems import Chain, Hopper, Juggler

WORDS = dict.fromkeys(("gap", "pull", "separation", "end"), "it is no motion")


class TwoMasses:
    """What the equations of both machines are made of."""

    def __init__(self, machine: Hopper | Juggler, load: float):
        self.machine, self.level, self.gravity = machine, Liftoff(load, "lift-off"), machine.varying_gravity

    def force(self, r, p, q):
        return self.machine.spring.expression(r, p, q)

    def pull(self, z, p):
        return 1 + p["gravity_share"] * (self.gravity.expression(z, p, []) - 1) if self.gravity else 1.0

    def weight(self, z, p):
        """gamma where a mass of coordinate z is that is a rest length above its zero."""
        return self.pull(p.get("rest_length", 0.0) + z, p)

    @staticmethod
    def numbers(p):
        return p["mass_ratio"], p.get("damping", 0.0), p.get("drag", 0.0)

    def fields(self, states, extension, **own) -> dict:
        machine, damped = self.machine, self.machine.damped
        return dict(
            flight=Phase("flight", states, self.flight),
            contact=Phase("contact", states[:2], self.contact, {"contact force": self.contact_force}),
            liftoff=lambda u, p, q: [self.contact_force([u["liftoff"], u["alpha"]], p, q)],
            reversor=None if damped else (1, -1, 1, -1),
            release=lambda alpha, p: self.level.extensions_at(machine.spring, self.damping_at_liftoff(p), alpha),
            touchdown=lambda u, p: [u["liftoff"], -u["alpha"]],
            flight_gradient=self.flight_gradient,
            contact_gradient=self.contact_gradient,
            extension=extension,
            separation=lambda p: Affine(extension.weights, p["rest_length"]) if "rest_length" in p else None,
            contact_speed=Affine((0.0, 1.0)),
            violations=WORDS,
            guess=lambda family, p: guess(machine.model, family, p),
            homotopy="gravity_share" if self.gravity else None,
            conservative=not damped,
            search=machine.model.search,
            **own,
        )


class ByHandHopper(TwoMasses):
    """The hopper of sections 3 and 4: body and foot, its energy in units of m1 g times a length."""

    def __init__(self, machine: Hopper):
        super().__init__(machine, 0.0)

    def flight(self, x, p, q):
        M, c, d = self.numbers(p)
        tension = self.force(x[0] - x[2], p, q) + c * (x[1] - x[3])
        body = -(M * (tension + d * x[1]) + self.weight(x[0], p)) / (1 + M)
        return [x[1], body, x[3], (tension - self.pull(x[2], p) - d * x[3]) / (1 + M)]

    def contact(self, x, p, q):
        M, c, d = self.numbers(p)
        return [x[1], -(M * (self.force(x[0], p, q) + (c + d) * x[1]) + self.weight(x[0], p)) / (1 + M)]

    def contact_force(self, x, p, q):
        return 1 - self.force(x[0], p, q) - self.damping_at_liftoff(p) * x[1]

    def damping_at_liftoff(self, p):
        return self.numbers(p)[1]

    def flight_gradient(self, x, p, q):
        M, tension = p["mass_ratio"], self.force(x[0] - x[2], p, q)
        body, foot = M * tension + self.weight(x[0], p), M * (self.pull(x[2], p) - tension)
        return [body, (1 + M) * x[1], foot, (1 + M) * M * x[3]]

    def contact_gradient(self, x, p, q):
        M = p["mass_ratio"]
        return [M * self.force(x[0], p, q) + self.weight(x[0], p), (1 + M) * x[1]]

    @staticmethod
    def heights(p):
        M, length = p["mass_ratio"], p.get("rest_length", 0.0)
        return {
            "body": Affine((1.0, 0.0, 0.0, 0.0), length),
            "foot": Affine((0.0, 0.0, 1.0, 0.0)),
            "centre of mass": Affine((1 / (1 + M), 0.0, M / (1 + M), 0.0), length / (1 + M)),
        }


def hopper(machine: Hopper) -> dict:
    """The hopper's fields, and what follows from them."""
    equations = ByHandHopper(machine)
    return equations.fields(
        ("y1", "y1'", "y2", "y2'"),
        Affine((1.0, 0.0, -1.0, 0.0)),
        name="hopper",
        launch=lambda u, p: [u["liftoff"], u["alpha"], 0.0, 0.0],
        landing=lambda u, x, p: [x[2], x[3], x[0] - u["liftoff"]],
        embed=np.eye(4, 2),
        gap=lambda p: Affine((0.0, 0.0, 1.0, 0.0)),
        heights=equations.heights,
        impact_mass=lambda x, p: p["mass_ratio"] * (1 + p["mass_ratio"]),
        impact=lambda x, p: [0.0, 0.0, 0.0, 1.0],
        springs=(("foot", "body"),),
        tension=lambda x, p, q: equations.force(x[0] - x[2], p, q),
    )


class ByHandJuggler(TwoMasses):
    """The juggler of sections 5 and 6: ball and hand, its energy in units of m1 g times a length."""

    def __init__(self, machine: Juggler):
        super().__init__(machine, 1.0)

    def flight(self, x, p, q):
        M, c, d = self.numbers(p)
        held = self.force(x[2], p, q) + (c + d) * x[3]
        return [x[1], -M * d * x[1] - self.weight(x[0], p), x[3], -held - self.weight(x[2], p)]

    def contact(self, x, p, q):
        M, c, d = self.numbers(p)
        return [x[1], -M / (1 + M) * (self.force(x[0], p, q) + (c + 2 * d) * x[1]) - self.weight(x[0], p)]

    def contact_force(self, x, p, q):
        return -(self.force(x[0], p, q) + self.damping_at_liftoff(p) * x[1]) / (1 + p["mass_ratio"])

    def damping_at_liftoff(self, p):
        M, c, d = self.numbers(p)
        return c + (1 - M) * d

    def flight_gradient(self, x, p, q):
        M = p["mass_ratio"]
        return [self.weight(x[0], p), x[1], M * (self.force(x[2], p, q) + self.weight(x[2], p)), M * x[3]]

    def contact_gradient(self, x, p, q):
        M = p["mass_ratio"]
        return [M * self.force(x[0], p, q) + (1 + M) * self.weight(x[0], p), (1 + M) * x[1]]

    @staticmethod
    def heights(p):
        length = p.get("rest_length", 0.0)
        return {"ball": Affine((1.0, 0.0, 0.0, 0.0), length), "hand": Affine((0.0, 0.0, 1.0, 0.0), length)}


def juggler(machine: Juggler) -> dict:
    """The juggler's fields, and what follows from them."""
    equations = ByHandJuggler(machine)
    share = lambda p: p["mass_ratio"] / (1 + p["mass_ratio"])  # noqa: E731
    return equations.fields(
        ("w1", "w1'", "w2", "w2'"),
        Affine((0.0, 0.0, 1.0, 0.0)),
        name="juggler",
        launch=lambda u, p: [u["liftoff"], u["alpha"], u["liftoff"], u["alpha"]],
        landing=lambda u, x, p: [x[0] - x[2], x[1] - x[3], x[2] - u["liftoff"]],
        embed=np.tile(np.eye(2), (2, 1)),
        gap=lambda p: Affine((1.0, 0.0, -1.0, 0.0)),
        heights=equations.heights,
        impact_mass=lambda x, p: share(p),
        impact=lambda x, p: [0.0, share(p), 0.0, share(p) - 1],
        springs=((None, "hand"),),
        tension=lambda x, p, q: equations.force(x[2], p, q),
    )


def chain(machine: Chain) -> dict:
    """The fields of a chain, and what follows. Mass i, from the top, has the parameter "mi"; y_N is 0 in contact."""
    count, springs, eye = len(machine.masses), machine.springs, np.eye(2 * len(machine.masses))
    masses, above = [f"m{i}" for i in range(1, count + 1)], 2 * count - 4  # the state of the mass above the lowest
    states = tuple(f"y{i}{dot}" for i in range(1, count + 1) for dot in ("", "'"))
    launched = [*states[:above], "liftoff", "alpha"]

    def moving(x, p, q):
        """(m, velocity, upward force) of each mass, in contact without the lowest."""
        y = [*x[::2], 0.0][:count]
        pulls = [law.expression(y[i] - y[i + 1], p, q) for i, law in enumerate(springs)]
        forces = [up - down - p[m] for m, up, down in zip(masses, [0, *pulls], [*pulls, 0], strict=True)]
        return [(p[m], v, force) for m, v, force in zip(masses, x[1::2], forces, strict=False)]

    def field(x, p, q):
        return [rate for m, v, force in moving(x, p, q) for rate in (v, force / m)]

    def gradient(x, p, q):
        return [part for m, v, force in moving(x, p, q) for part in (-force, m * v)]

    def contact_force(x, p, q):
        return p[masses[-1]] - springs[-1].expression(x[-2], p, q)

    def landing(u, x, p):
        """The lowest mass touches the ground, without speed and without acceleration."""
        third = x[above] - u["liftoff"] if count == 2 else field(x, p, [])[-1]
        return [x[-2], x[-1], third]

    def heights(p):
        centre = sum(p[m] * eye[2 * i] for i, m in enumerate(masses)) / sum(p[m] for m in masses)
        each = {f"mass {i + 1}": Affine(tuple(eye[2 * i])) for i in range(count)}
        return {**each, "centre of mass": Affine(tuple(centre))}

    return dict(  # noqa: C408 -- as the arguments of a Model are written
        name=f"chain of {count} masses",
        flight=Phase("flight", states, field),
        contact=Phase("contact", states[:-2], field, {"contact force": contact_force}),
        launch=lambda u, p: [*(u[name] for name in launched), 0.0, 0.0],
        launch_unknowns=("liftoff", "alpha", *states[:above]),
        liftoff=lambda u, p, q: [contact_force([u["liftoff"], u["alpha"]], p, q)],
        landing=landing,
        reversor=(1, -1) * count,
        release=machine.model.release,
        touchdown=lambda u, p: [sign * u[name] for name, sign in zip(launched, (1, -1) * (count - 1), strict=True)],
        embed=eye[:, :-2],
        flight_gradient=gradient,
        contact_gradient=gradient,
        extension=Affine(tuple(eye[above] - eye[-2])),
        gap=lambda p: Affine(tuple(eye[-2])),
        separation=lambda p: None,
        heights=heights,
        impact_mass=lambda x, p: p[masses[-1]],
        impact=lambda x, p: eye[-1].tolist(),
        contact_speed=Affine(tuple(eye[above + 1, :-2])),
        violations=WORDS,
        springs=tuple((f"mass {i + 2}", f"mass {i + 1}") for i in range(count - 1)),
    )


FIELDS = {Hopper: hopper, Juggler: juggler, Chain: chain}


def by_hand(machine: Hopper | Juggler | Chain) -> Model:
    """The model of a machine, written by hand."""
    return Model(**{name: part for name, part in FIELDS[type(machine)](machine).items() if name not in DERIVED_FIELDS})


def written(machine: Hopper | Juggler | Chain) -> SimpleNamespace:
    """All that is written by hand of a machine, also what follows from the rest of its model."""
    model, fields = by_hand(machine), FIELDS[type(machine)](machine)
    return SimpleNamespace(**{**vars(model), "one_speed": model.one_speed, **fields})
