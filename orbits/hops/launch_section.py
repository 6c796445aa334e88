"""The launches of a machine as the points of a section: contact states in which the contact force vanishes.

A launch of a machine of N coordinates is one of 2(N - 1) states of its contact, with one condition between them, so
that 2N - 3 numbers determine it: the unknowns of the launch but one, which follows from the others.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..model import STEP_LENGTH
from ..numerics import newton_root
from ..periodic import start_in_file
from ..units import UNKNOWNS, Dimension, Message, Units, described, dimension_of_state
from .impacts import Impacts


class LaunchSection:
    """The section of a machine's launches.

    unknowns : names of the unknowns of a launch
    names : those d of them that are free, in this order
    dependent : the one that follows from the others, "liftoff" where the contact force depends on it
    unit, bound_unit : units (d,) of the free unknowns, and that of the other one, for a machine stated in SI

    Contact states are dimensionless; launches that a user states are in the machine's units.
    """

    def __init__(self, impacts: Impacts, units: Units | None = None):
        self.impacts, self.places = impacts, impacts.model.launch_places
        self.unknowns = tuple(self.places)
        sparsity, inside = impacts.force_slope.sparsity_out(0), [*self.places.items()]
        found = [name for name, place in inside if sparsity.has_nz(0, place)]
        self.dependent = min(found, key=lambda name: name == "alpha" or name.endswith("'"))
        self.names = tuple(name for name in self.unknowns if name != self.dependent)
        self.unit = units.of_states(self.names) if units else np.ones(len(self.names))
        self.bound_unit = float(units.of(self.dependent)) if units else 1.0
        # The length of a leg may not be 0.
        at_rest = impacts.model.rest(impacts.values) if impacts.model.sticks and impacts.model.rest else None
        self._usual = 0.0 if at_rest is None else float((impacts.onto_contact @ at_rest)[self.places[self.dependent]])
        self._free, self._bound = [self.places[name] for name in self.names], self.places[self.dependent]

    @staticmethod
    def dimension(name: str) -> Dimension:
        """The dimension of an unknown of a launch."""
        return UNKNOWNS.get(name) or dimension_of_state(name)

    def tangent(self, y: np.ndarray) -> np.ndarray:
        """The derivative (k, d) of the contact state by the free unknowns at a launch (k,)."""
        return self.tangents(self.impacts.force_gradient(y))

    def tangents(self, gradients: np.ndarray) -> np.ndarray:
        """The derivatives (..., k, d) of contact states by the free unknowns at launches where the contact force has
        gradients (..., k)."""
        tangents = np.zeros((*gradients.shape, len(self.names)))
        tangents[..., self._free, range(len(self.names))] = 1.0
        tangents[..., self._bound, :] = -gradients[..., self._free] / gradients[..., [self._bound]]
        return tangents

    def free(self, ys: np.ndarray) -> np.ndarray:
        """The free unknowns (..., d) of launches, contact states (..., k)."""
        return ys[..., self._free]

    def in_words(self, y: np.ndarray) -> Message:
        """The free unknowns of a launch (k,) in a message."""
        return described(self.names, self.free(y))

    def unknowns_of(self, y: np.ndarray) -> dict[str, float]:
        """The unknowns of a launch (k,) by name."""
        return {name: float(y[place]) for name, place in self.places.items()}

    def states(self, launches: np.ndarray, guess: np.ndarray | None = None) -> np.ndarray:
        """The contact states (m, k) of launches (m, d), NaN where there is none: by Newton's method from the values
        `guess` (m,) of the dependent unknown, by default 0, or where the machine sticks that at rest."""
        ys = np.zeros((len(launches), self.impacts.contact.size))
        ys[:, self._free], ys[:, self._bound] = launches, self._usual if guess is None else guess
        for y in ys:
            y[self._bound] = self._solved(y)
        return ys

    def _solved(self, y: np.ndarray) -> float:
        """The dependent unknown of a launch whose contact state is otherwise (k,); NaN where it is not found."""
        contact, y = self.impacts.contact, y.copy()

        def step(place: float) -> float:
            y[self._bound] = place
            gradient, force = self.impacts.force_slope(y, contact.data(y[None], self.impacts.p)[0])
            slope = float(gradient[self._bound])
            return -float(force) / slope if slope != 0 else np.nan

        found = newton_root(step, float(y[self._bound]), float(np.abs(y).max()))
        return np.nan if found is None else found

    def parsed(self, launch: Any) -> tuple[np.ndarray, np.ndarray | None]:
        """Launches (..., d), and values (...) of the dependent unknown if they are stated: from an array (..., d) of
        the free unknowns, a mapping of arrays (...) by name, or an orbit, its file or a periodic hop, which begins with
        a launch. Raises `InputError` for anything else."""
        names, text = self.names, f"a launch of this machine must be an array (..., {len(self.names)}) or a mapping"
        launch = start_in_file(launch) if isinstance(launch, str | Path) else launch
        if callable(launch) and hasattr(launch, "flight_time"):
            launch = self.impacts.model.launch_at(launch(0.0))
        elif hasattr(launch, "launches"):
            launch = launch.launches[0]
        if isinstance(launch, Mapping):
            unknown, missing = sorted(launch.keys() - {*self.unknowns}), [n for n in names if n not in launch]
            # Durations and the step, which the starts of `find` have too, are not part of a launch.
            unknown = [name for name in unknown if name not in (*self.impacts.model.half_unknowns, STEP_LENGTH)]
            if unknown or missing:
                wrong = f"has no '{unknown[0]}'" if unknown else f"needs '{missing[0]}'"
                raise InputError(f"{text} of {', '.join(names)}, but it {wrong}")
            columns = np.broadcast_arrays(*(self._numbers(launch[name]) for name in names))
            own = launch.get(self.dependent)
            return np.stack(columns, axis=-1), None if own is None else self._numbers(own)
        launches = self._numbers(launch)
        if launches.ndim == 0 and len(names) == 1:
            launches = launches[None]
        if not launches.ndim or launches.shape[-1] != len(names):
            raise InputError(f"{text} of {', '.join(names)}, not numbers of the shape {launches.shape}")
        return launches, None

    @staticmethod
    def _numbers(values: Any) -> np.ndarray:
        try:
            return np.array(values, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise InputError(f"launch = {values!r}; a launch must be numbers") from None

    def launch(self, launch: Any) -> np.ndarray:
        """The dimensionless contact state (k,) of one launch, stated as for `parsed`; raises `InputError` for anything
        that is not a launch."""
        launches, guess = self.parsed(launch)
        with np.errstate(over="ignore"):
            own = launches / self.unit
        if launches.ndim != 1 or not np.isfinite(own).all():
            raise InputError(f"launch = {launch!r}; one launch is {len(self.names)} numbers: {', '.join(self.names)}")
        (y,) = self.states(own[None], None if guess is None else np.reshape(guess, 1) / self.bound_unit)
        if not np.isfinite(y).all():
            raise InputError(f"launch = {launches.tolist()}: the contact force vanishes at no '{self.dependent}'")
        return y

    def injected(self, ys: np.ndarray, inject: float) -> np.ndarray:
        """Launches (m, k) with this impulse added to the launch speed: the other free unknowns stay."""
        if inject == 0:
            return ys
        launches = self.free(ys)
        launches[:, self.names.index("alpha")] += inject
        return self.states(launches, ys[:, self._bound])
