"""What a mechanism states, evaluated element by element: forces, masses, energies, gaps and maps.

Nothing here solves Lagrange's equations, so it can show whether results derived from them are right. Along each
coordinate the elements balance (d'Alembert's principle): with q the places, h a height, an extension or a place across,
h'' its second derivative in a motion, m the mass that moves along it, and f a force along a function r,

    sum of m h'' dh/dq  +  sum of f dr/dq  =  F dg/dq,

F being the contact force along the gap g, 0 in flight.
"""

from collections.abc import Iterator, Mapping

import casadi as ca
import numpy as np

from ..laws import Key, Parameters
from ..model import data_at
from ..symbolic import MappedFunction
from .elements import Damper, Force, Inerter, Mass, Potential, Scalar, Spring, Weight, paths_of, value_of
from .mechanism import Mechanism


class Balance:
    """A mechanism with its numbers as functions of flight states x (N, 2 n + k) and accelerations a (N, n).

    exact : extensions change along one another where what is across is at most this share
    rest : (2 n + k,), the state in which it rests with the springs unloaded

    A call returns arrays by name:
    terms : (N, n, count), the summands of the balance along each coordinate
    ground : (N, 2, 1), the forces across and along the ground that all masses need
    kinetic, stored, power : (N, 1, 1), the kinetic energy, that of weights and potentials, and the power that the
        forces take from the motion
    gradient : (N, 2 n + k, 1), of the energy
    inertia : (N, n, n)
    gap, landing_gap : (N, 1, 1); the first has the largest weight 1; along_gap, along_landing_gap : (N, n, 1)
    lengths : (N, k, 1), the gap, the landing gap, the separation, 0 where none is stated, the extension that is
        counted, and the heights
    centre, places : (N, 1, 1) and (N, k, 1), the heights of the centre of mass, 0 without masses, and of each mass
    across : (N, 3, 1), the place of the centre of mass along the ground, its speed, and the weight on the ground
    rates, by_rates, turning : (N, k, 1), (N, n, k) and (N, n, 1), the speeds of masses at heights and then across, the
        momentum per each of them, and that of all else along the coordinates
    tension, springs : (N, 1, 1) and (N, k, 1), the force of all springs along the extension that is counted, and of
        each
    reversed, relabelled : (N, 2 n + k, 1), the images of the state under the maps that are stated
    """

    def __init__(self, stated: Mechanism, exact: float):
        self.stated, self.p, self.count, self.exact = stated, stated.values, len(stated.coordinates), exact
        moved = (*stated.coordinates, *stated.actuators)
        self.q, self.v, self.a = (ca.SX.sym(name, len(moved)) for name in "qva")
        self.places, self.rates = (dict(zip(moved, ca.vertsplit(each), strict=True)) for each in (self.q, self.v))
        n, energies = self.count, {**self._balance(), **self._energies(), **self._momenta()}
        found = {**energies, **self._geometry(), **self._springs()}
        inner = ca.Function("stated", [self.q, self.v, self.a], [ca.densify(each) for each in found.values()])
        x, a = ca.SX.sym("x", n + len(moved)), ca.SX.sym("a", n)
        # The displacement of an actuator has a rate that is a parameter, and no acceleration.
        speeds = ca.vertcat(x[1 : 2 * n : 2], *(self.p[rate] for rate in stated.actuators.values()))
        accelerations = ca.vertcat(a, ca.SX.zeros(len(stated.actuators)))
        results = inner.call([self._places(x), speeds, accelerations])
        still = [part for name in stated.coordinates for part in (self._stands_at(name), 0.0)]
        self.rest = np.array([*still, *[0.0] * len(stated.actuators)])
        self.function = ca.Function("balance", [x, a], results, ["x", "a"], list(found))
        self.names, self._mapped = list(found), MappedFunction(self.function)

    def __call__(self, x: np.ndarray, a: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """The arrays at states, without accelerations where none are given."""
        a = np.zeros((len(x), self.count)) if a is None else a
        return dict(zip(self.names, self._mapped(x, a), strict=True))

    def power(self, x: ca.SX) -> ca.SX:
        """The power that the forces take from the motion in a flight state."""
        return self.function(x=x)["power"]

    def _balance(self) -> dict[str, ca.SX]:
        """The summands of the balance; those of a stated inertia I are (I v)' less half the gradient of v . I v."""
        n, inertia = self.count, self._stated_inertia()
        turning = ca.bilin(inertia, self.v, self.v) / 2
        summands = [self._change(inertia @ self.v) - self._slope(turning)]
        summands += [mass * self._second(h) * self._slope(h) for h, mass in self._moving()]
        summands += [force * self._slope(r) for r, force in self._forces(Mass, Spring, Potential, Damper, Force)]
        across, along = ca.SX(0), ca.SX(0)
        for each in self.stated.elements:
            if isinstance(each, Mass):
                across += self._at(each.mass) * self._second(self._at(each.height))
                along += self._at(each.mass) * self._second(self._at(each.across)) if each.across is not None else 0
        across += sum(force for _, force in self._forces(Mass))
        return {"terms": ca.horzcat(*summands)[:n, :], "ground": ca.vertcat(across, along)}

    def _energies(self) -> dict[str, ca.SX]:
        n, v = self.count, self.v
        kinetic = ca.bilin(self._stated_inertia(), v, v) / 2
        kinetic += sum(mass * self._rate(h) ** 2 / 2 for h, mass in self._moving())
        forces = self._forces(Mass, Spring, Potential, Damper, Force)
        keeping = sum(
            (force * self._slope(r) for r, force in self._forces(Mass, Spring, Potential)), ca.SX(v.numel(), 1)
        )
        momentum, static = ca.gradient(kinetic, v), self._slope(kinetic) + keeping
        pairs = [part for i in range(n) for part in (static[i], momentum[i])]
        return {
            "kinetic": kinetic,
            "stored": sum((r * force for r, force in self._forces(Mass, Potential)), ca.SX(0)),
            "power": sum((force * ca.dot(self._slope(r)[:n], v[:n]) for r, force in forces), ca.SX(0)),
            "gradient": ca.vertcat(*pairs, static[n:]),
            "inertia": ca.jacobian(momentum[:n], v[:n]),
        }

    def _geometry(self) -> dict[str, ca.SX]:
        m = self.stated
        assert m.gap is not None  # a machine without one is refused
        opens = self._at(m.gap)
        back, forward = self._image(m.reversor or {}, -1.0), self._image(m.symmetry, 1.0)
        lands = self._at([*m.gaps.values()][1]) if len(m.gaps) > 1 else ca.substitute(opens, self.q, self._places(back))
        gaps = {"gap": opens, "landing_gap": lands}
        gaps = {name: gap / ca.mmax(self._slope(opens)) for name, gap in gaps.items()}
        along = {f"along_{name}": self._slope(gap)[: self.count] for name, gap in gaps.items()}
        separation = self._at(0.0 if m.separation is None else m.separation)
        lengths = [separation, self._counted(), *map(self._at, (m.heights or {}).values())]
        heights = [(self._at(each.height), self._at(each.mass)) for each in m.elements if isinstance(each, Mass)]
        mass = sum((mass for _, mass in heights), ca.SX(0))
        return {
            **gaps,
            **along,
            "lengths": ca.vertcat(*gaps.values(), *lengths),
            "centre": sum((mass * h for h, mass in heights), ca.SX(0)) / mass if heights else ca.SX(0),
            "places": ca.vertcat(*(h for h, _ in heights), ca.SX(0, 1)),
            "reversed": back,
            "relabelled": forward,
        }

    def _momenta(self) -> dict[str, ca.SX]:
        n, masses = self.count, [each for each in self.stated.elements if isinstance(each, Mass)]
        paths = [(self._at(each.height), self._at(each.mass)) for each in masses]
        beside = [(self._at(each.across), self._at(each.mass)) for each in masses if each.across is not None]
        whole, at_ground = ca.SX(0), _law(self.stated.gravity, ca.SX(0), self.p) * self._at(self.stated.surface_gravity)
        for each in self.stated.elements:
            whole += self._at(each.mass) * at_ground if isinstance(each, Mass | Weight) else 0
        centre = sum((mass * x for x, mass in beside), ca.SX(0))
        centre /= sum((mass for _, mass in paths), ca.SX(0)) if beside else 1
        turning = (self._stated_inertia() @ self.v)[:n]
        for each in self.stated.elements:
            if isinstance(each, Inerter):
                r = self._at(each.extension)
                turning += self._at(each.inertance) * self._rate(r) * self._slope(r)[:n]
        return {
            "across": ca.vertcat(centre, self._rate(centre), whole),
            "rates": ca.vertcat(*(self._rate(path) for path, _ in (*paths, *beside)), ca.SX(0, 1)),
            "by_rates": ca.horzcat(*(mass * self._slope(path)[:n] for path, mass in (*paths, *beside)), ca.SX(n, 0)),
            "turning": turning,
        }

    def _springs(self) -> dict[str, ca.SX]:
        """The forces of springs; the tension is that of all whose extensions change with the one that is counted."""
        along, tension, forces = self._slope(self._counted())[: self.count], ca.SX(0), list[ca.SX]()
        for r, force in self._forces(Spring):
            slope = self._slope(r)[: self.count]
            ratio = ca.dot(slope, along) / ca.sumsqr(along)
            parallel = ca.sumsqr(slope - ratio * along) < self.exact**2 * ca.sumsqr(slope)
            tension += ca.if_else(parallel, ratio * force, 0)
            forces.append(force)
        return {"tension": tension, "springs": ca.vertcat(*forces, ca.SX(0, 1))}

    def _counted(self) -> ca.SX:
        """The extension whose stationary points count the family: the first spring's unless another one is stated."""
        extensions = (each.extension for each in self.stated.elements if isinstance(each, Spring))
        return self._at(next(extensions, 0.0) if self.stated.counts is None else self.stated.counts)

    def _stands_at(self, name: str) -> float:
        """Where a coordinate rests with the springs unloaded."""
        return float(ca.evalf(ca.SX(value_of(self.stated.rest.get(name, 0.0), {}, self.p))))

    def _places(self, x: ca.SX) -> ca.SX:
        """The places with an actuator's displacement in a flight state."""
        return ca.vertcat(x[: 2 * self.count : 2], x[2 * self.count :])

    def _image(self, stated: Mapping[str, Scalar], time: float) -> ca.SX:
        """The image of a state under a map of places, and of time to its negative where that is -1."""
        images = [self._at(stated.get(name, name)) for name in self.stated.coordinates]
        pairs = [part for image in images for part in (image, time * self._rate(image))]
        return ca.vertcat(*pairs, self.q[self.count :])

    def _moving(self) -> Iterator[tuple[ca.SX, ca.SX]]:
        """The functions along which something with a mass moves, and the masses."""
        for each in self.stated.elements:
            if isinstance(each, Mass):
                yield from ((self._at(path), self._at(each.mass)) for path in paths_of(each))
            elif isinstance(each, Inerter):
                yield self._at(each.extension), self._at(each.inertance)

    def _forces(self, *kinds: type) -> Iterator[tuple[ca.SX, ca.SX]]:
        """The functions along which elements of some kinds have forces, and the forces; a `Mass` stands for weights."""
        for each in self.stated.elements:
            match each:
                case Mass(height=height, mass=mass) | Weight(height=height, mass=mass) if Mass in kinds:
                    pull = _law(self.stated.gravity, self._at(height), self.p)
                    yield self._at(height), self._at(mass) * self._at(self.stated.surface_gravity) * pull
                case Spring() if Spring in kinds:
                    yield self._at(each.extension), _law(each.force, self._at(each.extension), self.p)
                case Potential() if Potential in kinds:
                    yield self._at(each.energy), ca.SX(1)
                case Damper() if Damper in kinds:
                    yield self._at(each.extension), self._at(each.coefficient) * self._rate(self._at(each.extension))
                case Force() if Force in kinds:
                    yield self._at(each.along), -ca.SX(each.force(self.places, self.rates, self.p))

    def _stated_inertia(self) -> ca.SX:
        """The inertia (n + k, n + k) in addition to that of the elements."""
        whole = ca.SX(self.q.numel(), self.q.numel())
        for i, row in enumerate(self.stated.inertia):
            for j, each in enumerate(row):
                whole[i, j] = self._at(each)
        return whole

    def _at(self, expression: Scalar) -> ca.SX:
        return ca.SX(value_of(expression, self.places, self.p))

    def _slope(self, function: ca.SX) -> ca.SX:
        return ca.gradient(function, self.q)

    def _rate(self, function: ca.SX) -> ca.SX:
        return ca.jtimes(function, self.q, self.v)

    def _change(self, function: ca.SX) -> ca.SX:
        """The rate of a function of places and speeds."""
        return ca.jtimes(function, ca.vertcat(self.q, self.v), ca.vertcat(self.v, self.a))

    def _second(self, function: ca.SX) -> ca.SX:
        return self._change(self._rate(function))


def _law(key: Key, place: ca.SX, p: Parameters) -> ca.SX:
    """The value of a law at a place, on whichever piece that is."""
    pieces = key.pieces
    data = data_at(place * pieces.units(p) - pieces.origins(p), *pieces.table(p)) if pieces else []
    return key.expression(place, p, data)
