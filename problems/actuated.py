"""A machine whose spring's end is moved by an actuator, as on the paper's air track (section 10).

The spring acts by phi(r - u), u the displacement of its end, r the extension; its rate w = u' is what is given. The
damper beside the spring works on r' alone, so that with u = 0 the machine is the one it was. The actuator does work on
the machine at the rate -m phi(r - u) w, m the mass ratio, in the units of the machine's energy; lift-off is where the
contact force vanishes, landing where the gap does.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from orbits import InputError
from orbits.model.model import Model
from orbits.model.phase import Affine, Phase

from .machine import DAMPERS, TwoMassMachine

END, RATE = "u", "w"


@dataclass(frozen=True)
class Actuated:
    """A machine with a moved spring's end, as `simulate` takes it; the last of its state is u.

    machine : a `Hopper` or `Juggler` with a smooth spring law
    """

    machine: TwoMassMachine

    def __post_init__(self):
        if not isinstance(self.machine, TwoMassMachine):
            raise InputError(
                f"a {type(self.machine).__name__} is no machine whose spring can be moved, as problems.Hopper()"
            )
        if self.machine.spring.pieces:
            raise InputError(f"spring '{self.machine.spring.text}' is piecewise; an actuator needs a smooth law")
        if taken := {END, RATE, "peak"} & self.machine.parameters.keys():
            raise InputError(f"'{min(taken)}' is the actuator's own name; call the formula's parameter something else")

    @cached_property
    def model(self) -> Model:
        """The machine's own, with u beside each state; machines that differ only in numbers share it."""
        machine = self.machine
        gravity = machine.gravity.key if machine.gravity.key.degree() > 0 else None
        return _actuated_model(type(machine), machine.spring.key, gravity, machine.rest_length is not None)

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name, the spring's end at rest."""
        return {**self.still, RATE: 0.0}

    @property
    def still(self) -> dict[str, float]:
        """The same without the actuator's rate, which is an input."""
        return {**self.machine.values, **{name: float(getattr(self.machine, name)) for name in DAMPERS}}

    restitution = property(lambda self: self.machine.restitution)
    units = property(lambda self: self.machine.units)
    rest_length = property(lambda self: self.machine.rest_length)

    def describe(self) -> dict:
        """The machine as JSON-ready data."""
        return {**self.machine.describe(), "actuated": True}


@lru_cache(maxsize=64)
def _actuated_model(kind: type[TwoMassMachine], spring, gravity, has_length: bool) -> Model:
    """The model of a machine, from the same laws, with the spring's force at r - u."""
    law = spring.expression
    moved = spring._replace(expression=lambda r, p, q: law(r - p[END], p, q), names=(*spring.names, END))
    plain = kind().build(moved, gravity, has_length, True)

    def driven(phase: Phase) -> Phase:
        size = len(phase.states)
        inner = lambda of: lambda x, p, q: of(x[:size], {**p, END: x[size]}, q)  # noqa: E731
        rates = inner(phase.field)
        watch = {name: inner(of) for name, of in phase.watch.items()}
        return Phase(phase.name, (*phase.states, END), lambda x, p, q: [*rates(x, p, q), p[RATE]], watch)

    unmoved = kind().build(spring, gravity, has_length, True)
    onto = Affine(tuple(np.array(plain.extension.weights) @ plain.embed), plain.extension.offset)

    def gradient(of: Callable, extension: Affine) -> Callable:
        def with_end(x, p, q):
            tension = moved.expression(along(extension, x), {**p, END: x[-1]}, q)
            return [*of(x[:-1], {**p, END: x[-1]}, q), -p["mass_ratio"] * tension]

        return with_end

    wide = lambda affine: affine and Affine((*affine.weights, 0.0), affine.offset)  # noqa: E731
    embed = np.zeros(np.add(plain.embed.shape, 1))
    embed[:-1, :-1], embed[-1, -1] = plain.embed, 1.0
    return replace(
        plain,
        flight=driven(plain.flight),
        contact=driven(plain.contact),
        embed=embed,
        launch=lambda u, p: [*unmoved.launch(u, p), 0.0],
        release=unmoved.release,
        liftoff=unmoved.liftoff,
        flight_gradient=gradient(plain.flight_gradient, plain.extension),
        contact_gradient=gradient(plain.contact_gradient, onto),
        extension=wide(plain.extension),
        gap=lambda p: wide(plain.gap(p)),
        separation=lambda p: wide(plain.separation(p)),
        heights=lambda p: {name: wide(height) for name, height in plain.heights(p).items()},
        impact=lambda p: np.append(plain.impact(p), 0.0),
        contact_speed=wide(plain.contact_speed),
        reversor=None,
        reduction=None,
    )


def along(affine: Affine, x):
    """An affine function of a state's expressions."""
    return sum((weight * part for weight, part in zip(affine.weights, x, strict=False) if weight), affine.offset)
