"""A chain: N masses in a column joined by springs; the lowest mass lands plastically.

Units: whatever the masses, the springs' forces and their extensions are stated in, with gravity 1. Flight state
(y1, y1', ..., yN, yN'), from the top, positions counted from the unstretched column with its lowest mass on the ground;
r_i = y_i - y_{i+1} is the extension of spring i with force phi_i, and in flight

    m_i y_i'' = phi_{i-1}(r_{i-1}) - phi_i(r_i) - m_i,

in contact the same with y_N = 0, until the lowest spring carries the lowest mass, phi_{N-1}(y_{N-1}) = m_N. A lossless
hop is its own mirror image in time, from rest in mid-contact to rest in mid-flight. For N = 2 the chain is the hopper
with mass ratio m2/m1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from orbits import Mechanism, start_from_rest, starts
from orbits.continuation import Starts
from orbits.errors import InputError
from orbits.io import one_line
from orbits.laws import Law, LawLike, coefficient_of_restitution, number
from orbits.mechanics import Mass, Spring, joined_values
from orbits.model import Model, Stated
from orbits.running import exclusive, exclusive_property

from ..laws import as_spring
from .parameters import checked_numbers, refuse_taken

MOST_MASSES = 12
WORDS_OF_CHAINS = {
    "liftoff": "the weight of the lowest mass",
    "gap": "lowest mass below ground",
    "pull": "the ground would have to pull",
    "separation": "the masses pass through each other",
    "end": "contact: the springs collapse, the lowest mass never lifts off again",
}


@dataclass(frozen=True, repr=False)
class Chain(Stated):
    """N masses in a column joined by N - 1 springs.

    masses : (N,), from the top, N from 2 to 12
    springs : a smooth spring as in `TwoMassMachine`, for all, or (N - 1,) of them, from the top; one may be a table or
        another law in pieces; parameters of the same name are the same parameter
    restitution : of the impacts of the lowest mass, 0 <= e <= 1
    parameters : values of the formulas' names

    All numbers are dimensionless, with gravity 1. Raises `InputError` for invalid masses, springs and parameters.

    >>> from orbits import find_all
    >>> from problems import Chain
    >>> chain = Chain(masses=(1, 1, 1))
    >>> len(find_all(chain, chain.starts(half_contact=5, half_flight=5)))
    6
    """

    masses: Sequence[float] = (1.0, 1.0, 1.0)
    springs: tuple[Law, ...] = "r"  # type: ignore[assignment]
    restitution: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)

    if TYPE_CHECKING:  # laws are stated in several ways

        def __init__(
            self, masses: Sequence[float] = ..., springs: LawLike | Sequence[LawLike] = "r", restitution: float = 0.0,
            parameters: Mapping[str, float] = ...,
        ): ...  # fmt: skip

    units = None
    rest_length = None

    @exclusive
    def __post_init__(self) -> None:
        parameters = checked_numbers(self.parameters)
        masses = tuple(mass_parameters(self.masses, 2, MOST_MASSES).values())
        restitution = coefficient_of_restitution(self.restitution)
        laws = self.springs if isinstance(self.springs, list | tuple) else [self.springs] * (len(masses) - 1)
        if len(laws) != len(masses) - 1:
            raise InputError(f"{len(masses)} masses are joined by {len(masses) - 1} springs, not {len(laws)}")
        springs = tuple(as_spring(law, parameters, shared=True) for law in laws)
        if len(piecewise := [law.text for law in springs if law.pieces]) > 1:
            reason, both = (
                "a motion is followed along the breakpoints of one extension alone",
                " and ".join(map(repr, piecewise)),
            )
            raise InputError(
                f"springs {both} are in pieces: a chain takes one such spring, as {reason}; fit a formula to the others"
            )
        known = self._common_parameters(springs, _mass_names(len(masses)))
        self._store(masses=masses, springs=springs, restitution=restitution, parameters=known)

    def _common_parameters(self, springs: tuple[Law, ...], masses: tuple[str, ...]) -> dict[str, float]:
        """The parameters of all springs; raises `InputError` for unknown, reserved and ambiguous names."""
        known = {name: value for law in springs for name, value in law.parameters.items()}
        if unknown := [name for name in self.parameters if name not in known]:
            raise InputError(f"no spring has a parameter '{unknown[0]}'; the chain has {', '.join([*masses, *known])}")
        refuse_taken(masses, known, "a mass")
        return joined_values(((law.text, law.parameters) for law in springs), {})

    @exclusive_property
    def model(self) -> Model:
        """The phases and orbits of the chain; chains that differ only in numbers share it."""
        return self.mechanism.model

    @exclusive_property
    def mechanism(self) -> Mechanism:
        """The chain as a mechanism."""
        names, masses = [f"y{i}" for i in range(1, len(self.masses) + 1)], _mass_names(len(self.masses))
        weighted = [f"{mass}*{name}" for mass, name in zip(masses, names, strict=True)]
        pairs = zip(names[:-1], names[1:], self.springs, strict=True)
        return Mechanism(
            name=f"chain of {len(masses)} masses",
            coordinates=names,
            elements=[
                *(Mass(name, mass) for name, mass in zip(names, masses, strict=True)),
                *(Spring(f"{upper} - {lower}", spring) for upper, lower, spring in pairs),
            ],
            gap=names[-1],
            counts=f"{names[-2]} - {names[-1]}",
            heights={
                **{f"mass {i}": name for i, name in enumerate(names, 1)},
                "centre of mass": f"({' + '.join(weighted)})/({' + '.join(masses)})",
            },
            words=WORDS_OF_CHAINS,
            parameters=self.values,
            restitution=self.restitution,
        )

    def stated(self) -> Mechanism:
        """The chain as a mechanism, with the values of its parameters."""
        return self.mechanism

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name: the masses, then the springs' parameters."""
        return {**dict(zip(_mass_names(len(self.masses)), self.masses, strict=True)), **self.parameters}

    def with_values(self, **values: float) -> "Chain":
        """This chain with other values of m1, ..., mN or of the springs' parameters."""
        names = _mass_names(len(self.masses))
        masses = tuple(values.get(name, mass) for name, mass in zip(names, self.masses, strict=True))
        rest = {name: value for name, value in values.items() if name not in names}
        return replace(self, masses=masses, parameters={**self.parameters, **rest})

    def __repr__(self) -> str:
        texts = tuple(law.text for law in self.springs)
        springs = texts if len(set(texts)) > 1 else texts[0]
        bounces = {"restitution": self.restitution} if self.restitution else {}
        return one_line(self, {**self.parameters, "masses": self.masses, "springs": springs, **bounces})

    def describe(self) -> dict[str, Any]:
        """The chain as JSON-ready data."""
        texts = [law.text for law in self.springs]
        return {
            "machine": f"chain of {len(self.masses)} masses",
            "spring": texts[0] if len(set(texts)) == 1 else "; ".join(texts),
            "gravity": "1",
            "mass_ratio": None,
            "rest_length": None,
            "restitution": self.restitution,
            "parameters": self.values,
            "laws_in": "units of the machine",
        }

    def start(self, positions: Sequence[float], half_contact: float, half_flight: float) -> dict[str, float]:
        """A start for `find`, the unknowns by name, from a guess of the state of rest in mid-contact and of the
        durations.

        positions : (N - 1,), of all masses but the lowest, at rest in mid-contact
        half_contact, half_flight : half durations of contact and of flight

        Raises `NoOrbit` when the motion from there cannot be integrated.
        """
        return start_from_rest(self, positions, half_contact, half_flight)

    def starts(
        self, half_contact: float | None = None, half_flight: float | None = None, seed: int = 0, **options: Any
    ) -> Starts:
        """Starts for `find_all`: the hops with half durations of contact and of flight up to these; see
        `orbits.starts`, also for the `options`."""
        return starts(self.mechanism, half_contact, half_flight, seed, **options)


def _mass_names(count: int) -> tuple[str, ...]:
    return tuple(f"m{i}" for i in range(1, count + 1))


def mass_parameters(masses: Sequence[float], fewest: int, most: int) -> dict[str, float]:
    """The masses of a column by name; raises `InputError` unless it is a list of `fewest` to `most` masses above 0."""
    masses = masses.tolist() if isinstance(masses, np.ndarray) else masses
    if isinstance(masses, str | bytes) or not isinstance(masses, Sequence):
        raise InputError(f"masses = {masses!r}; they must be a list of masses, from the top")
    if not fewest <= len(masses) <= most:
        bounds = f"from {fewest} to {most}" if fewest < most else f"{most}"
        raise InputError(f"there are {bounds} masses, not {len(masses)}")
    return {name: number(name, m, low=0) for name, m in zip(_mass_names(len(masses)), masses, strict=True)}
