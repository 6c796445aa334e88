"""The multipliers of hops: the eigenvalues of the derivative of the map of launches, and the stability that follows
from them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..errors import NoOrbit, whole_number
from ..io import Document
from ..model import Machine, dimensionless, machine_in_words
from ..result import Axes, Result, Row, shown, stored
from ..running import exclusive
from ..units import LIFTOFF_SPEED, Message, Quantity, Units, without_units
from .impacts import FASTEST_LAUNCH, impacts_of, injected
from .launch_section import LaunchSection
from .multiplier import HopDerivative, hop_derivative, losses_beside

COMES_BACK = 1e-7  # a launch that comes back within this distance, as a share of it, is periodic
ON_CIRCLE = 1e-6  # a multiplier whose modulus differs from 1 by less is on the unit circle, as far as is known


@dataclass(frozen=True, eq=False, repr=False)
class HopMultipliers(Result, what="multipliers", in_line=("values",), document_is_whole=True):
    """The derivative of the launch after some hops with respect to the launch, for a launch of d numbers.

    names : of these numbers
    launch, following : (d,), the launch, and the launch after the hops
    matrix : (d, d), the derivative; column j is the derivative by number j
    hops : the number of hops
    lossless : whether the hops land tangentially, like a lossless orbit
    losses : (2,): along the direction of the multiplier 1, with E the energy above that of a lossless hop, a hop loses
        losses[0] E**(4/3) where E > 0, and losses[1] |E|**(4/3) where E < 0; empty where this is not known
    units : of the launch, by name; empty for a dimensionless machine
    machine : in words and numbers
    loses : whether the hops lose energy in impacts and nothing adds any, so that this launch never comes back

    `values` (d,), by falling modulus, are the multipliers; the columns of `vectors` (d, d) are their directions.
    """

    names: tuple[str, ...]
    launch: np.ndarray
    following: np.ndarray
    matrix: np.ndarray
    hops: int = 1
    lossless: bool = False
    losses: tuple[float, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    machine: Mapping[str, Any] = field(default_factory=dict)
    loses: bool = False

    @cached_property
    def _eigen(self) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = np.linalg.eig(self.matrix)
        # Of a pair of complex multipliers, that with the positive imaginary part is the first.
        order = np.lexsort((-values.imag, -np.abs(values).round(12)))
        return values[order], vectors[:, order]

    @property
    def values(self) -> np.ndarray:
        """The multipliers (d,), by falling modulus."""
        return self._eigen[0]

    @property
    def vectors(self) -> np.ndarray:
        """Their directions (d, d), in columns: changes of the launch."""
        return self._eigen[1]

    @property
    def returns(self) -> bool:
        """Whether the launch comes back after the hops, so that it is periodic."""
        near = np.abs(self.following - self.launch).max() <= COMES_BACK * np.abs(self.launch).max()
        return bool(near) and not self.loses

    @property
    def stability(self) -> str:
        """The stability that follows from the multipliers: "unstable", "linearly stable" or "neutral", or "not
        periodic"."""
        if not self.returns:
            return "not periodic"
        moduli = np.abs(self.values)
        if (moduli > 1 + ON_CIRCLE).any():
            return "unstable"
        return "neutral" if (moduli > 1 - ON_CIRCLE).any() else "linearly stable"

    def title(self) -> str:
        return f"multipliers of {'a hop' if self.hops == 1 else f'{self.hops} hops'} of a {self.machine.get('machine')}"

    def table(self) -> dict[str, np.ndarray]:
        """Columns (d,): the multipliers, their moduli and angles."""
        values = self.values
        return {
            "number": np.arange(len(values)), "real": values.real, "imaginary": values.imag, "modulus": np.abs(values),
            "angle": np.angle(values),
        }  # fmt: skip

    def heads(self) -> list[str]:
        return ["multiplier", "modulus", "launch numbers that change most"]

    def _rows(self) -> Iterator[Row]:
        for i, value in enumerate(self.values):
            text = f"{value.real:.10g}" + (f" {value.imag:+.10g}i" if value.imag else "")
            share = np.abs(self.vectors[:, i])
            most = ", ".join(self.names[j] for j in np.argsort(-share) if share[j] > 0.5 * share.max())
            values = {f"modulus {i}": float(abs(value)), f"direction {i}": most}
            yield Row(text, values, ("{:.10g}", "{}"))

    def summary(self) -> dict[str, Any]:
        """The stability, and the multipliers with their moduli."""
        numbers = {f"{part} {i}": float(x) for part, column in self.table().items() if part != "number"
                   for i, x in enumerate(column)}  # fmt: skip
        return {"stability": self.stability, **numbers}

    def _notes(self) -> list[str]:
        moduli, kind = np.abs(self.values), self.stability
        if kind == "not periodic":
            return ["the launch does not come back: these multipliers of one hop do not determine its stability"]
        outside, on = int((moduli > 1 + ON_CIRCLE).sum()), int((np.abs(moduli - 1) <= ON_CIRCLE).sum())
        if kind == "unstable":
            beside = "outside the unit circle: small changes of the launch grow"
            return [f"unstable: {outside} of {len(moduli)} multipliers {beside}"]
        if kind == "linearly stable":
            return ["linearly stable to first order: all multipliers lie inside the unit circle"]
        notes = [f"neutral to first order: {on} of {len(moduli)} multipliers on the unit circle, none outside"]
        if self.lossless:
            notes.append(
                "the multiplier 1 belongs to the energy: hops lose it only as the power 4/3 of a change of the launch; "
                "launches with less energy than the lossless hop never come to it"
            )
        if self.losses:
            above, below = self.losses
            law = f"{above:.4g} E**(4/3) of an excess energy E > 0, and {below:.4g} |E|**(4/3) of a deficit E < 0"
            notes.append(f"along its direction a hop loses {law}")
        return notes

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the multipliers in the complex plane, with the unit circle; returns the axes."""
        return shown("launch_figures").plot_multipliers(self, axes)

    def document(self) -> Document:
        return {**stored(self), "stability": self.stability, "real": self.values.real.tolist(),
                "imaginary": self.values.imag.tolist()}  # fmt: skip


@exclusive
def multipliers(machine: Machine, launch: Any, *, hops: int = 1, inject: float = 0.0) -> HopMultipliers:
    """The multipliers of hops: eigenvalues of the derivative of the map of launches, `hops` times.

    machine : as for `ReturnMap`
    launch : the numbers of a launch, as an array (d,) or by name; or an orbit or a periodic hop
    inject : as for `ReturnMap`

    The derivative follows from the variational equations, with saltation at impacts and at lift-off. It also exists at
    lossless hops, where the landing is tangential: there the time of landing has no derivative, but the next launch has
    one, since the motions before and after the landing agree to first order. Raises `NoOrbit` where the machine does
    not lift off again, and `InputError` for an invalid launch.

    >>> from orbits import find_all, multipliers
    >>> from problems import Chain
    >>> chain = Chain((1, 1, 1))
    >>> hop = max(find_all(chain, chain.starts(4, 4)), key=lambda hop: hop.admissible)
    >>> multipliers(chain, hop).values.real.round(6).tolist()
    [1.0, -0.789309, 0.267177]
    """
    units = getattr(machine, "units", None)
    speed = units.of(LIFTOFF_SPEED) if units else 1.0
    section = LaunchSection(impacts_of(dimensionless(machine)), units)
    first = section.launch(launch)
    count, added = whole_number("hops", hops, "hops"), injected(inject, speed) / speed
    with without_units(units):
        return derivative_of_hops(section, first, count, added).as_result(machine)


@dataclass(frozen=True, eq=False)
class HopsDerivative:
    """Some hops from a launch (k,), contact states: the launches (hops + 1, k) with the first and the last one, the
    derivative (d, d) of the last, the hops, and the speed that is added at the end of each."""

    section: LaunchSection
    launches: np.ndarray
    matrix: np.ndarray
    hops: tuple[HopDerivative, ...]
    inject: float

    def as_result(self, machine: Machine) -> HopMultipliers:
        """The multipliers, in the units of the machine."""
        section, unit = self.section, self.section.unit
        launch, following = section.free(self.launches[[0, -1]]) * unit
        impacts, tangential = section.impacts, all(hop.tangential for hop in self.hops)
        lossless = impacts.model.conservative and tangential
        loses = impacts.model.conservative and not tangential and impacts.restitution < 1 and not impacts.never_lose
        loses = loses and self.inject == 0 and not impacts.descends
        units: Units | None = getattr(machine, "units", None)
        energy = units.energy if units and units.energy else 1.0
        losses = tuple(c / energy ** (1 / 3) for c in self.energy_loss.coefficients) if self.energy_loss else ()
        texts = units.texts({name: section.dimension(name) for name in section.names}) if units else {}
        matrix = unit[:, None] * self.matrix / unit
        return HopMultipliers(
            section.names, launch, following, matrix, len(self.hops), lossless, losses, texts,
            machine_in_words(machine), loses,
        )  # fmt: skip

    @cached_property
    def energy_loss(self) -> "EnergyLoss | None":
        """What a lossless hop, the only one here, loses near its launch; None where that is not known."""
        impacts, hop, y = self.section.impacts, self.hops[0], self.launches[0]
        if not impacts.model.conservative or len(self.hops) > 1 or not hop.tangential:
            return None
        values, vectors = np.linalg.eig(self.matrix)
        on = np.abs(values - 1) <= ON_CIRCLE
        if on.sum() != 1:
            return None
        direction = vectors[:, on].real.ravel()
        powers = impacts.energy_gradient(impacts.model.embed @ y) @ impacts.model.embed @ self.section.tangent(y)
        power = float(powers @ direction)
        slope = float(hop.gap_slopes @ direction) / power if power else 0.0
        if (losses := losses_beside(impacts, hop, slope, 1.0)) is None:
            return None
        # A landing that is early leads to a bounce, which loses more.
        return EnergyLoss(direction / power, powers, losses if slope > 0 else losses[::-1])


class EnergyLoss(NamedTuple):
    """What a hop loses whose launch is near a lossless one: the direction (d,) of the multiplier 1, by the energy; the
    derivatives (d,) of the energy; and the `losses` of `HopMultipliers`."""

    direction: np.ndarray
    powers: np.ndarray
    coefficients: tuple[float, float]


def derivative_of_hops(section: LaunchSection, y: np.ndarray, count: int, inject: float) -> HopsDerivative:
    """The derivative of `count` hops from a launch (k,); raises `NoOrbit` where the machine does not lift off again."""
    impacts, matrix, launches, hops = section.impacts, np.eye(len(section.names)), [y], list[HopDerivative]()
    for _ in range(count):
        x = impacts.model.embed @ y
        if np.abs(x).max() > FASTEST_LAUNCH or not impacts.opens(x[None])[0]:
            raise NoOrbit(Message("{launch} is not a launch: the contact would not open", launch=section.in_words(y)))
        hop = hop_derivative(impacts, x, impacts.model.embed @ section.tangent(y))
        matrix = section.free(hop.derivative.T).T @ matrix
        (y,) = section.injected(hop.liftoff[None], inject)
        if not np.isfinite(y).all():
            text = "inject = {inject:g}: the contact force vanishes at no '{name}' of the launch"
            raise NoOrbit(Message(text, inject=Quantity(inject, LIFTOFF_SPEED), name=section.dependent))
        launches.append(y)
        hops.append(hop)
    return HopsDerivative(section, np.array(launches), matrix, tuple(hops), inject)
