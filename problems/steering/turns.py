"""How often an extension turns in flight, by which kinds of hops are distinguished."""

from collections.abc import Iterable

import numpy as np

from orbits import Orbit
from orbits.control import ControlledLeg
from orbits.model import Affine
from orbits.numerics import derivative, piecewise_roots

# Two turns with less between them than this share of the extension's range may merge, or appear, on the way from the
# lossless orbit to a motion of the same kind.
SHALLOW = 0.05
SAMPLES_OF_FLIGHT = 1001  # of an orbit's flight


def turns_of_orbit(orbit: Orbit, extension: Affine) -> tuple[int, int]:
    """The number of an orbit's turns in flight that are not shallow, and of all; the last state is the actuator's."""
    states = orbit(np.linspace(0.0, float(orbit.flight_time), SAMPLES_OF_FLIGHT))
    return deep_turns(extension(np.pad(states, ((0, 0), (0, 1))))), 2 * orbit.family + 1


def turns_of_leg(flight: ControlledLeg, extension: Affine) -> tuple[int, int]:
    """The number of turns of a controlled flight that are not shallow, and of all."""
    path = flight.path
    series = extension.series(path.coefficients[:, : len(extension.weights)])
    turns = [path.times[piece] + since for piece, since in piecewise_roots(derivative(series), path.steps)]
    states = path(np.array([0.0, *turns, flight.duration]))
    return deep_turns(extension(states[:, : len(extension.weights)])), len(turns)


def deep_turns(values: Iterable[float]) -> int:
    """How often a sequence turns by more than the share `SHALLOW` of its range."""
    sequence = np.asarray(values, dtype=float)
    least, extreme, way, turns = SHALLOW * np.ptp(sequence), sequence[0], 0.0, 0
    for value in sequence.tolist():
        moved = value - extreme
        if moved * way > 0:
            extreme = value
        elif abs(moved) > least:
            turns += way != 0
            extreme, way = value, 1.0 if moved > 0 else -1.0
    return turns
