"""Steered motions of laws with corners, divided where they pass from one piece to the next."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits import simulate
from problems import Hopper, Juggler, springs, steering

SHARP = Hopper(springs.bilinear(ratio=2.0, gap=0.5), mass_ratio=0.5, rest_length=20.0)


def parts_of(leg):
    """The numbers of intervals of the parts of a leg, and their durations."""
    lengths = np.diff(leg.inputs.times)
    parts = np.split(lengths, np.flatnonzero(np.abs(np.diff(lengths)) > 1e-9) + 1)
    return [len(part) for part in parts], [part.sum() for part in parts]


@pytest.mark.slow
def test_a_recovery_is_a_minimum_of_effort():
    """The conditions of Karush, Kuhn and Tucker, with SciPy's integrator on equations of motion that are written out.

    The motion is on the upper piece at lift-off and at both ends of contact, and below the corner between."""
    back = steering.recover(SHARP, 0.1, intervals=8)
    (in_flight, flown), (in_contact, held) = map(parts_of, back.legs)
    assert (len(in_flight), len(in_contact)) == (3, 3)
    counts = np.array([*in_flight, *in_contact])
    rates = np.concatenate([leg.inputs.row("w")[:, 0] for leg in back.legs])
    found, first = np.concatenate([rates, flown, held]), back.legs[0].path(0.0)[:5]

    def missed(z):
        """The conditions (m, 10) of motions with rates and durations z (m, k): at corners, landing and lift-off."""
        y, rows, columns = np.tile(first, (len(z), 1)), [], iter(z.T)
        for part, (count, duration) in enumerate(zip(counts, z[:, len(rates) :].T, strict=True)):

            def tension(y, above=part % 3 != 1):
                r = y[:, 0] - y[:, 2] - y[:, 4]
                return r + (r - 0.5) if above else r

            for rate in (next(columns) for _ in range(count)):

                def motion(s, x, in_air=part < 3, rate=rate, share=duration / count, tension=tension):
                    y = x.reshape(-1, 5)
                    f = tension(y)
                    rows = y[:, 1], (-0.5 * f - 1) / 1.5, y[:, 3], in_air * (f - 1) / 1.5, rate
                    return (np.stack(rows, 1) * share[:, None]).ravel()

                y = solve_ivp(motion, (0, 1), y.ravel(), "DOP853", rtol=1e-12, atol=1e-12).y[:, -1].reshape(-1, 5)
            if part == 2:
                rows += [y[:, 2], y[:, 3], tension(y) - 1]
            elif part < 5:
                rows.append(tension(y) - 0.5)
        return np.stack([*rows, y[:, 0] - 0.75, y[:, 1] - back.parameters["aim"], y[:, 4]], 1)

    assert np.abs(missed(found[None])).max() < 1e-8
    each = np.split(rates**2, counts.cumsum()[:-1])
    durations, effort = found[len(rates) :], [np.mean(squares) for squares in each]
    assert back.cost == pytest.approx(durations @ effort, rel=1e-12)
    gradient = np.concatenate([2 * rates * np.repeat(durations / counts, counts), effort])
    step = 1e-5 * np.eye(len(found))
    slopes = (missed(found + step) - missed(found - step)) / 2e-5
    multipliers = np.linalg.lstsq(slopes, gradient, rcond=None)[0]
    assert np.abs(slopes @ multipliers - gradient).max() < 1e-8


@pytest.mark.slow
def test_the_parts_of_a_phase_are_one_leg():
    kept = steering.keep_hopping(SHARP.with_values(damping=0.01), intervals=14)
    assert [leg.phase for leg in kept.legs] == ["flight", "contact"]
    assert kept.periodic
    places = kept(kept.legs[0].inputs.times[:-1])
    assert np.abs(places[:, 0] - places[:, 2] - places[:, 4] - 0.5).min() < 1e-9  # a change of the rate at the corner
    assert np.all(np.diff(kept.table()["running cost"]) >= 0)
    again = steering.keep_hopping(SHARP.with_values(damping=0.011), intervals=14, guess=kept)
    assert 1.1 < again.cost / kept.cost < 1.3


def test_a_motion_begins_on_a_row_of_a_table_up_to_rounding():
    rows = np.linspace(-12, 12, 25)
    machine = Juggler(springs.table((rows, rows + 0.02 * rows**3), noise=0), mass_ratio=0.5)
    exact = simulate(machine, state=[0.0, 4.0, 0.0, 4.0], hops=1).launches
    for off in (3e-36, -3e-36):
        assert simulate(machine, state=[off, 4.0, off, 4.0], hops=1).launches == pytest.approx(exact, rel=1e-12)
