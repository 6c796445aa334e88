"""Motions for simulators of robots: a table of the places and speeds of joints, and a model in MuJoCo's MJCF.

The model has the machine's bodies, its gravity, and the springs and dampers along sums of the places of the joints. It
has no ground that touches: a simulator replays the table, or integrates a phase without contact.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.etree import ElementTree

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import LARGEST_NUMBER, InputError, as_array_or_nan
from ..io import refusing, write_table, writing
from ..laws import Law, from_key
from ..mechanics import (
    AXES,
    LANDINGS,
    REPEATED,
    Body,
    Damper,
    Force,
    Joint,
    Mass,
    Potential,
    Spring,
    Weight,
    bodies_of,
    moving_masses,
    value_of,
)
from ..model import STEP_LENGTH
from ..result import TABLE_ROWS
from ..running import exclusive
from ..symbolic import MappedFunction
from .cubic_springs import Cubic, cubic_sum
from .plane import cycles_shown, drawing_of, labelled

if TYPE_CHECKING:
    from ..hops import Simulation
    from ..periodic import Orbit

MOTION_FILE, MODEL_FILE, SPRINGS_FILE = "motion.csv", "model.xml", "springs_for_drake.py"


class SimulatorOptions(NamedTuple):
    """The sizes of what a simulator shows, and when its bodies are those of the machine."""

    # Since simulators take none of 0, over its mass times the square of a unit of length.
    inertia_of_point: float = 1e-14
    ground: float = 50.0  # lengths of the machine in the ground that is shown
    thickness: float = 40.0  # lengths of the machine over the thickness of its bodies
    same_weights: float = 1e-12  # weights of joints in an extension that differ by less are equal, or whole numbers
    same_shifts: float = 1e-9  # shifts of extensions that differ by less are equal
    # Share by which the inertia and the weight of the bodies differ from those of the machine at most.
    same_masses: float = 1e-9
    far: float = 1e10  # a length that no tendon reaches
    finer: int = 20  # times of a simulation that its springs cover for one row of its table


SIMULATORS = SimulatorOptions()
UNTOUCHED = {"contype": "0", "conaffinity": "0"}


def export_orbit(orbit: "Orbit", folder: str | Path, t: ArrayLike | None = None) -> Path:
    """Write an orbit's table and model to a folder; see `Orbit.export`."""
    if orbit.source is None:
        raise InputError("an export needs the orbit's machine: pass it, Orbit.load(path, machine)")
    cycles = cycles_shown(orbit)
    end = orbit.flight_time if orbit.contact_time is None else cycles * orbit.period
    whole = np.linspace(0.0, end, cycles * (TABLE_ROWS - 1) + 1)
    t = whole if t is None else _checked_times(t)
    flying = t <= orbit.flight_time if orbit.contact_time is None else np.mod(t, orbit.period) <= orbit.flight_time
    return _export(orbit, t, np.where(flying, "flight", "contact"), folder, whole)


def export_simulation(run: "Simulation", folder: str | Path, t: ArrayLike | None = None) -> Path:
    """Write the table and the model of a simulation to a folder; see `Simulation.export`."""
    whole = np.linspace(0.0, run.end, SIMULATORS.finer * (TABLE_ROWS - 1) + 1)
    t = whole[:: SIMULATORS.finer] if t is None else _checked_times(t)
    return _export(run, t, np.where(run.in_contact(t), "contact", "flight"), folder, whole)


def check_folder(folder: str | Path) -> Path:
    """The path of a folder to write to; raises `InputError` where there is a file, or no folder to make it in."""
    if not isinstance(folder, str | Path) or folder == "":
        raise InputError(f"folder = {folder!r}; it must be the name of a folder")
    with refusing("motion", path := Path(folder)):
        if path.exists() and not path.is_dir():
            raise InputError(f"'{path}' cannot be written to: it is a file, not a folder")
        if not path.parent.is_dir():
            raise InputError(f"'{path}' cannot be made: there is no folder '{path.parent}'")
    return path


def _checked_times(t: ArrayLike) -> np.ndarray:
    """Times (k,) of a table; raises `InputError` for anything but finite numbers, and for none."""
    times = np.ravel(as_array_or_nan(t))
    if not len(times) or not (np.abs(times) <= LARGEST_NUMBER).all():
        raise InputError(f"t = {t!r}; the times of a table must be one or more numbers, up to {LARGEST_NUMBER:.0e}")
    return times


def _export(
    result: "Orbit | Simulation", t: np.ndarray, phases: np.ndarray, folder: str | Path, whole: np.ndarray
) -> Path:
    """Write the rows at times `t`, and the model whose springs cover the motion at the times `whole`."""
    path, machine = check_folder(folder), result.source
    if not hasattr(machine, "stated"):
        raise InputError(f"{machine!r} states no mechanics to derive its bodies from: state an orbits.Mechanism")
    jointed = _Jointed.of(machine)
    places, speeds = jointed.motion(*labelled(result, t))
    rows = np.column_stack([t, places, speeds]).tolist()
    model = jointed.model(jointed.motion(*labelled(result, whole))[0])
    with refusing("motion", path):
        path.mkdir(exist_ok=True)
    lines = ([row[0], phase, *row[1:]] for row, phase in zip(rows, phases, strict=True))
    write_table(jointed.heads, lines, path / MOTION_FILE, "motion")
    with writing("model", path / MODEL_FILE) as target:
        target.write_text(model + "\n", encoding="utf-8")
    with writing("springs", path / SPRINGS_FILE) as target:
        target.write_bytes(Path(__file__).with_name(SPRINGS_FILE).read_bytes())
    return path


class Pull(NamedTuple):
    """A damper, or a spring that is a cubic of its extension.

    weights : (m,) of the joints in the extension
    kind : "stiffness" or "damping"
    force : of the sum of the joints, or of its rate
    """

    weights: np.ndarray
    kind: str
    force: Cubic

    def turned(self) -> "Pull":
        """This pull, along the negative of the sum."""
        place, (a, b, c), side = self.force
        return Pull(-self.weights, self.kind, Cubic(-place, (a, -b, c), -side))

    @property
    def coefficients(self) -> str:
        """The coefficients of the powers from 1 on, up to the last one that is not 0."""
        return _in_text(*np.trim_zeros(self.force.coefficients, "b"))

    @property
    def is_alone(self) -> bool:
        """Whether a joint can have it: the extension is its place, or the negative, up to what does not change."""
        return bool(np.count_nonzero(self.weights) == 1 and abs(self.weights).max() == 1 and not self.force.side)


@dataclass(frozen=True)
class _Jointed:
    """A `Mechanism` with its bodies and the values p of its parameters."""

    mechanism: Any
    bodies: Sequence[Body]
    p: Mapping[str, float]

    @classmethod
    def of(cls, machine: Any) -> "_Jointed":
        """That of a machine which is stated by its mechanics."""
        mechanism = machine.stated()
        p = {**mechanism.parameters, **machine.values}
        return cls(mechanism, bodies_of(mechanism, {**p, STEP_LENGTH: 0.0}), p)

    @property
    def joints(self) -> list[Joint]:
        """All joints, as the model has them."""
        return [joint for body in self.bodies for joint in body.joints]

    @property
    def heads(self) -> list[str]:
        """The names of the table's columns with their units."""
        units = [("rad" if joint.axis == "turn" else "m") if self.mechanism.in_si else "" for joint in self.joints]
        named = [(joint.name, unit) for joint, unit in zip(self.joints, units, strict=True)]
        places = [f"{name} ({unit})" if unit else name for name, unit in named]
        speeds = [f"{name}' ({unit}/s)" if unit else f"{name}'" for name, unit in named]
        return ["time (s)" if self.mechanism.in_si else "time", "phase", *places, *speeds]

    def number(self, expression: Any) -> float:
        """The value of a formula of the parameters."""
        return float(value_of(expression, {}, self.p))

    @cached_property
    def _symbols(self) -> dict[str, ca.SX]:
        """Of the coordinates, of the landings and of the step; the displacements of actuators are 0."""
        symbols = {name: ca.SX.sym(name) for name in (*self.mechanism.coordinates, LANDINGS, STEP_LENGTH)}
        return symbols | dict.fromkeys(self.mechanism.actuators, ca.SX(0))

    @cached_property
    def _coordinates(self) -> ca.SX:
        return ca.vertcat(*(self._symbols[name] for name in self.mechanism.coordinates))

    @cached_property
    def _places(self) -> ca.SX:
        return ca.vertcat(*(self._symbolic(joint.place) for joint in self.joints))

    def _symbolic(self, expression: Any) -> ca.SX:
        return ca.SX(value_of(expression, self._symbols, self.p))

    def _seen(self, *results: ca.SX) -> list[list[np.ndarray]]:
        """The values of expressions at two places of the coordinates, before any landing."""
        y = self._coordinates
        steps = self._symbols[LANDINGS], self._symbols[STEP_LENGTH]
        function = ca.Function("seen", [y, *steps], list(map(ca.densify, results)))
        places = np.random.default_rng(0).uniform(0.3, 1.2, (2, y.numel()))
        return [[each.full() for each in function(place, 0.0, 0.0)] for place in places]

    @exclusive
    def motion(self, seen: Any, states: np.ndarray, landings: np.ndarray) -> list[np.ndarray]:
        """The places and the speeds (k, m) of the joints in flight states (k, n) after these numbers of landings (k,),
        as `labelled` has them."""
        y, v, n = self._coordinates, ca.SX.sym("v", self._coordinates.numel()), 2 * len(self.mechanism.coordinates)
        results = [self._places, ca.jtimes(self._places, y, v)]
        steps = np.broadcast_to(seen.values.get(STEP_LENGTH, 0.0), len(states)), landings.astype(float)
        inputs = [y, v, self._symbols[STEP_LENGTH], self._symbols[LANDINGS]]
        function = MappedFunction(ca.Function("motion", inputs, results))
        found = function(states[:, :n:2], states[:, 1:n:2], *(each[:, None] for each in steps))
        return [np.asarray(each).reshape(len(states), -1) for each in found]

    @property
    def _tilt(self) -> float:
        """The angle by which the ground falls, along which the first joints are then."""
        drawing = drawing_of(self.mechanism)
        return self.number(drawing.tilt) if drawing else 0.0

    def _moving(self) -> list[tuple[Body, ca.SX, ca.SX]]:
        """The bodies, with the places (2,), across and up, of their centres of mass, and the angles of their turns."""
        frames: dict[str | None, tuple[ca.SX, ca.SX]] = {None: (ca.SX(2, 1), ca.SX(0))}
        found = list[tuple[Body, ca.SX, ca.SX]]()
        for body in self.bodies:
            place, angle = frames[body.carrier]
            place = place + _turned_by(angle, *map(self.number, body.place))
            for joint in body.joints:
                (across, turns, up), by = AXES[joint.axis], self._symbolic(joint.place)
                place, angle = place + _turned_by(angle, across * by, up * by), angle + turns * by
            frames[body.name] = place, angle
            found.append((body, place + _turned_by(angle, *map(self.number, body.centre)), angle))
        return found

    @exclusive
    def weight_beside(self) -> list[str]:
        """In words, the weight that the machine has in addition to that of its bodies; raises `InputError` where their
        inertia is not the machine's."""
        m, y, bodies = self.mechanism, self._coordinates, self._moving()
        own = [(self._symbolic(place), self.number(mass)) for place, mass in moving_masses(m.elements)]
        theirs = [(path, self.number(body.mass)) for body, centre, _ in bodies for path in ca.vertsplit(centre)]
        theirs += [(angle, self.number(body.inertia)) for body, _, angle in bodies]
        stated = [ca.horzcat(*map(self._symbolic, row)) for row in m.inertia]
        down = ca.SX([-np.sin(self._tilt), np.cos(self._tilt)])
        weighing = [each for each in m.elements if isinstance(each, Mass | Weight)]
        heights = [sum((self.number(each.mass) * self._symbolic(each.height) for each in weighing), ca.SX(0))]
        heights += [sum((self.number(body.mass) * ca.dot(down, centre) for body, centre, _ in bodies), ca.SX(0))]
        inertias = [ca.vertcat(*stated) if stated else ca.SX(y.numel(), y.numel()), ca.SX(y.numel(), y.numel())]
        for i, paths in enumerate((own, theirs)):
            for path, mass in paths:
                inertias[i] += mass * ca.jacobian(path, y).T @ ca.jacobian(path, y)
        seen = self._seen(*inertias, *(ca.gradient(height, y) for height in heights))
        for inertia, built, _, _ in seen:
            scale = np.sqrt(abs(np.outer(np.diag(inertia), np.diag(inertia))))
            if (odd := np.argwhere(~(abs(inertia - built) <= SIMULATORS.same_masses * scale))).size:
                i, j = odd[0]
                moved = " and ".join(dict.fromkeys((m.coordinates[i], m.coordinates[j])))
                raise InputError(
                    f"the inertia of {moved} is {built[i, j]:.6g} in the bodies of the {m.name}, but "
                    f"{inertia[i, j]:.6g} in its mechanics: correct the masses, inertias and joints of bodies="
                )
        alike = all(
            np.allclose(a, b, rtol=0, atol=SIMULATORS.same_masses * abs(np.append(a, b)).max()) for *_, a, b in seen
        )
        return [] if alike else ["the part of the weight that differs from that of the bodies"]

    @exclusive
    def weights(self, extension: Any) -> tuple[np.ndarray, float] | None:
        """The weights (m,) of the joints in an extension, and the rest of it; None where it is not such a sum."""
        y, seen, whole = self._coordinates, list[tuple[np.ndarray, float]](), self._symbolic(extension)
        results = self._seen(whole, self._places, ca.jacobian(whole, y), ca.jacobian(self._places, y))
        for value, places, slopes, frame in results:
            weights = np.linalg.lstsq(frame.T, slopes.ravel(), rcond=None)[0]
            whole_numbers = np.round(weights)
            weights = np.where(abs(weights - whole_numbers) < SIMULATORS.same_weights, whole_numbers, weights)
            if not np.allclose(frame.T @ weights, slopes.ravel(), atol=SIMULATORS.same_weights):
                return None
            seen.append((weights, float(value[0, 0] - weights @ places.ravel())))
        (first, shift), (second, other) = seen
        alike = np.allclose(first, second, atol=SIMULATORS.same_weights) and np.isclose(
            shift, other, atol=SIMULATORS.same_shifts
        )
        return (first, shift) if alike else None

    def pulls(self, places: np.ndarray) -> tuple[list[Pull], list[str], list[str]]:
        """The springs and dampers on a motion through places (k, m) of the joints; and in words what else of the
        machine has no place in the model, and what is there with an error."""
        found, left, near = list[Pull](), list[str](), list[str]()

        def pull_by(law: Law, extension: Any, words: str) -> None:
            known = self.weights(extension)
            along = places @ known[0] + known[1] if known else np.zeros(1)
            fitted = cubic_sum(law, float(along.min()), float(along.max())) if known else None
            if known is None or fitted is None:
                left.append(words)
                return
            moved = (cubic._replace(place=cubic.place - known[1]) for cubic in fitted.cubics)
            found.extend(Pull(known[0], "stiffness", cubic) for cubic in moved)
            near.extend([f"{words} is {fitted.words}"] if fitted.words else [])

        for each in self.mechanism.elements:
            words = f"the {type(each).__name__.lower()}"
            if isinstance(each, Potential | Force):
                left.append(words)
            elif isinstance(each, Damper):
                if known := self.weights(each.extension):
                    found.append(Pull(known[0], "damping", Cubic(0.0, (self.number(each.coefficient), 0.0, 0.0))))
                else:
                    left.append(f"{words} along {each.extension}")
            elif isinstance(each, Spring):
                words += f" along {each.extension} with the force {each.force.text}"
                pull_by(from_key(each.force, self.p), each.extension, words)
                left += [f"the loop of {words}, but its mean is"] if each.force.branches else []
            elif isinstance(each, Mass | Weight) and self.mechanism.gravity.degree():
                law = self._change_of_gravity(each.mass)
                pull_by(law, each.height, f"the change of gravity {law.text} with the height {each.height}")
        left += [f"the displacement of the actuator '{name}'" for name in self.mechanism.actuators]
        return found, [*left, *self.weight_beside()], near

    def _change_of_gravity(self, mass: Any) -> Law:
        """The weight of a mass at a height, less that at the ground."""
        law, ground = from_key(self.mechanism.gravity, self.p), self.number(self.mechanism.surface_gravity)
        size, ratio = self.number(mass) * ground, law.expression
        return replace(law, expression=lambda z, p, q: size * (ratio(z, p, q) - ratio(0.0, p, q)))

    def model(self, places: np.ndarray) -> str:
        """The model as MJCF for a motion through places (k, m) of the joints, which say how large it is where nothing
        is shown of its bodies."""
        pulls, left, near = self.pulls(places)
        root = ElementTree.Element("mujoco", model=self.mechanism.name.replace(" ", "_"))
        units = "kg, m, s and rad" if self.mechanism.in_si else "units of the machine, without dimensions"
        notes = [
            f"Numbers are in {units}.",
            f"{MOTION_FILE} has qpos and qvel in this order.",
            "Nothing collides with the ground.",
        ]
        notes += [f"Not in this model: {each}." for each in left]
        notes += [f"Approximate: {each}." for each in near]
        root.append(ElementTree.Comment(f" {' '.join(notes)} ".replace("--", "- -")))
        _node(root, "compiler", angle="radian", inertiafromgeom="false")
        gravity = self.number(self.mechanism.surface_gravity) * float(from_key(self.mechanism.gravity, self.p)(0.0))
        down = _in_text(gravity * np.sin(self._tilt), 0.0, -gravity * np.cos(self._tilt))
        _node(root, "option", gravity=down, integrator="RK4", timestep="0.001")
        world, size = _node(root, "worldbody"), self._size(places)
        ground = _in_text(SIMULATORS.ground * size, SIMULATORS.ground * size, size)
        _node(world, "geom", name="ground", type="plane", size=ground, rgba="0.8 0.8 0.8 1", **UNTOUCHED)
        nodes: dict[str | None, ElementTree.Element] = {None: world}
        alone, tendons = dict[tuple, Pull](), list[Pull]()
        for pull in pulls:  # a joint has one spring and one damper, and none of 0
            where = (*np.flatnonzero(pull.weights), pull.kind)
            if pull.is_alone and where not in alone and pull.coefficients:
                alone[where] = pull
            elif pull.coefficients:
                tendons.append(pull)
        for body in self.bodies:
            nodes[body.name] = self._body(nodes[body.carrier], body, [*alone.values()], size)
        parent = _node(root, "tendon") if tendons else root
        for pull in tendons:
            self._tendon(parent, pull)
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode")

    def _body(
        self, carrier: ElementTree.Element, body: Body, pulls: Sequence[Pull], size: float
    ) -> ElementTree.Element:
        """A body with its joints, the springs and dampers of single joints among these, and what is shown of it."""
        (x, z), (across, up) = (map(self.number, pair) for pair in (body.place, body.centre))
        node, lines = _node(carrier, "body", name=body.name, pos=_in_text(x, 0, z)), self._lines(body)
        mass = self.number(body.mass)
        if not 0 < mass < np.inf:
            raise InputError(f"body '{body.name}' has the mass {mass:g}; a simulator needs a mass above 0")
        about = max(self.number(body.inertia), SIMULATORS.inertia_of_point * mass)
        inertia = _in_text(about, about, about)
        _node(node, "inertial", pos=_in_text(across, 0, up), mass=_in_text(mass), diaginertia=inertia)
        for joint in body.joints:
            place, own = self.joints.index(joint), dict[str, str]()
            for pull in pulls:
                if sign := pull.weights[place]:
                    along = pull if sign > 0 else pull.turned()
                    own[along.kind] = along.coefficients
                    own |= {"springref": _in_text(along.force.place)} if along.kind == "stiffness" else {}
            kind = "hinge" if joint.axis == "turn" else "slide"
            _node(node, "joint", name=joint.name, type=kind, axis=_in_text(*AXES[joint.axis]), **own)
        for a, b in lines:
            ends = _in_text(a[0], 0, a[1], b[0], 0, b[1])
            _node(
                node,
                "geom",
                type="capsule",
                fromto=ends,
                size=_in_text(size / SIMULATORS.thickness),
                mass="0",
                **UNTOUCHED,
            )
        if not lines:
            _node(node, "geom", type="sphere", size=_in_text(2 * size / SIMULATORS.thickness), mass="0", **UNTOUCHED)
        return node

    def _tendon(self, parent: ElementTree.Element, pull: Pull) -> None:
        """A spring or a damper of several joints, or one that acts on one side of a place. A length of -1 would stand
        for that at the start, so that signs are turned over where it is below 0."""
        pull = pull.turned() if pull.force.place < 0 else pull
        place, _, side = pull.force
        rest = {0: [place], 1: [-SIMULATORS.far, place], -1: [place, SIMULATORS.far]}[side]
        own = {"springlength": _in_text(*rest)} if pull.kind == "stiffness" else {}
        node = _node(parent, "fixed", **{pull.kind: pull.coefficients}, **own)
        for joint, weight in zip(self.joints, pull.weights, strict=True):
            if weight:
                _node(node, "joint", joint=joint.name, coef=_in_text(weight))

    def _lines(self, body: Body) -> list[tuple[list[float], list[float]]]:
        """The lines that are shown of a body, in its frame."""
        found = list[tuple[list[float], list[float]]]()
        for outline in body.outlines:
            for i in range(round(self.number(outline.repeat))):
                at = {REPEATED: float(i)}
                points = [[float(value_of(value, at, self.p)) for value in point] for point in outline.points]
                closing = points[:1] if outline.closed else []
                found += [pair for pair in zip(points, [*points[1:], *closing], strict=False) if pair[0] != pair[1]]
        return found

    def _size(self, places: np.ndarray) -> float:
        """A length of the machine: that of the longest line that is shown, or how far the joints move."""
        lengths = [float(np.hypot(*np.subtract(*pair))) for body in self.bodies for pair in self._lines(body)]
        return max(lengths, default=float(np.ptp(places))) or 1.0


def _turned_by(angle: ca.SX, across: Any, up: Any) -> ca.SX:
    """A vector (2,), across and up, turned clockwise."""
    return ca.vertcat(ca.cos(angle) * across + ca.sin(angle) * up, ca.cos(angle) * up - ca.sin(angle) * across)


def _node(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _in_text(*values: float) -> str:
    return " ".join(f"{float(value) + 0.0:.17g}" for value in values)
