"""Quantities of orbits against their documents and closed forms."""

import math

import numpy as np
import pytest
from conftest import slow_after
from plane import wheel
from steps import closed_form

from orbits import InputError, NoOrbit, Orbit, find, follow, quantities, sensitivities, sweep
from problems import Hopper, Juggler, hopper_in_si, rimless_wheel, rocking_block, shuttle


def test_linear_hopper_has_its_closed_forms():
    """Flight time 2 alpha, rise of the centre of mass alpha^2/2/(1 + M), period and stroke by hand."""
    M, alpha = 0.3, 4.493409457909064
    values = quantities(Hopper(mass_ratio=M), find(Hopper(mass_ratio=M)))
    depth = -1 / M - (1 + M) / M * math.sqrt(1 + M / (1 + M) * alpha**2)
    assert values["centre_of_mass_rise"] == pytest.approx(alpha**2 / 2 / (1 + M), rel=1e-12)
    assert values["stroke"] == pytest.approx(math.sqrt(1 + alpha**2) - depth, rel=1e-12)
    assert values["largest_spring_force"] == pytest.approx(-depth, rel=1e-12)
    assert values["landing_sensitivity"] * (1 + M) == pytest.approx(2 * alpha - math.sin(2 * alpha), rel=1e-12)


BLOCK = rocking_block(2.0, 0.1, 0.3, 0.3, 0.3, 20.0, friction=0.6)
LEG = hopper_in_si(60.0, 3.0, force="k*r + 2e6*r**3", rest_length=0.8, parameters={"k": 8000.0})
STEPS = {
    "wheel": (rimless_wheel(inertia_ratio=0.7, gravity_ratio=0.5, angle=0.3, share=0.8), 1, "angle"),
    "shuttle": (shuttle(inertia_ratio=1.0, gravity_ratio=0.5), 2, "gravity_ratio"),
    "block": (BLOCK, 2, "half_width"),
}


@pytest.mark.parametrize(
    ("machine", "name", "side"), [(LEG, "k", "below"), (LEG, "foot_mass", "below"), (wheel(), "kappa", "above")]
)
def test_robustness_is_the_width_of_the_table(machine, name, side):
    """Of the certificate: C^-3, or less where the bounce is above. Its slope is that of neighbouring orbits."""
    orbit = find(machine)
    certificate = orbit.certificate
    assert certificate.bounce_side == side
    lost = (certificate.bounce_factor if side == "above" else 1) * certificate.loss_coefficient
    assert certificate.robustness == pytest.approx(lost**-3, rel=1e-14)
    assert certificate.robustness == pytest.approx(certificate.attraction_width(), rel=1e-14)
    assert quantities(machine, orbit)["robustness"] == pytest.approx(lost**-3, rel=1e-9)
    if certificate.robustness < 0.05 * orbit.alpha:
        unit = f" {orbit.units['alpha']}" if orbit.units else ""
        assert f"up to {certificate.robustness:.2g}{unit} above alpha" in str(orbit)

    def near(value: float) -> float:
        return find(machine.with_values(**{name: value}), start=orbit).certificate.robustness

    slope = by_differences(near, machine.values[name], 1e-4)
    assert sensitivities(machine, orbit, name, "robustness")["robustness"][name] == pytest.approx(slope, rel=1e-7)


OF_CYCLES = ["period", "frequency", "duty_factor", "stroke", "peak_force_in_weights", "body_apex", "foot_apex"]


@pytest.mark.parametrize(("machine", "name"), [(LEG, "k"), (Juggler("cubic", rest_length=20.0), "mass_ratio")])
def test_what_a_bench_measures(machine, name):
    """Numbers of the whole cycle, of the motion on a fine mesh, in every result, and their derivatives."""
    orbit, (upper, lower, *_) = find(machine), machine.model.heights(machine.values)
    names = [each.replace("body", upper).replace("foot", lower) for each in OF_CYCLES]
    times = np.linspace(0, orbit.period, 400_001)
    states, force = orbit(times), orbit.contact_force(times)
    extension = states[:, 0] - states[:, 2] if upper == "body" else states[:, 2]
    length, weight = machine.rest_length, 63 * 9.80665 if upper == "body" else 1 / machine.mass_ratio
    period, contact = orbit.flight_time + orbit.contact_time, orbit.contact_time
    apexes = [length + states[:, 0].max(), states[:, 2].max() + (0.0 if upper == "body" else length)]
    expected = [period, 1 / period, contact / period, np.ptp(extension), force.max() / weight, *apexes]
    document, apex = orbit.document(), {f"{of}_apex": height for of, height in orbit.apexes.items()}
    assert [{**document, **apex}[each] for each in names] == pytest.approx(expected, rel=1e-9)
    assert [*quantities(machine, orbit, names).values()] == pytest.approx(expected, rel=1e-9)
    swept = sweep(machine, {name: [machine.values[name]]}, quantities=names, progress=False)
    assert [swept[each][0] for each in names] == pytest.approx(expected, rel=1e-9)
    family = follow(machine, name, 1.1 * machine.values[name], most=3)
    assert [family.column(each)[0] for each in names] == pytest.approx(expected, rel=1e-9)
    assert Orbit.of_saved(orbit.saved()).numbers["stroke"] == orbit.stroke

    def near(value: float) -> list[float]:
        other = machine.with_values(**{name: value})
        return [*quantities(other, find(other, start=orbit), names).values()]

    slopes, found = by_differences(near, machine.values[name]), sensitivities(machine, orbit, name, names)
    assert [found[each][name] for each in names] == pytest.approx(slopes, rel=1e-7, abs=1e-9)


def test_what_is_not_known_is_refused():
    with pytest.raises(InputError, match="'body_apex' here: the machine states no length"):
        quantities(Hopper(), find(Hopper()), "body_apex")
    with pytest.raises(InputError, match="'loop_energy' here: it is a loss on the spring's measured loop"):
        quantities(LEG, find(LEG), "loop_energy")
    with pytest.raises(InputError, match=r"'duty_factor' here: two points of a .* take turns"):
        quantities(BLOCK, find(BLOCK), "duty_factor")
    with pytest.raises(
        InputError, match=r"'peak_force_in_weights' here: the weight on the contact of a .* is not known"
    ):
        quantities(BLOCK, find(BLOCK), "peak_force_in_weights")


def by_differences(of, value: float, size: float = 1e-3) -> np.ndarray:
    """Derivatives of numbers by a parameter, by differences of fourth order."""
    step = size * value
    low, before, after, high = (np.array(of(value + k * step)) for k in (-2, -1, 1, 2))
    return (low - 8 * before + 8 * after - high) / (12 * step)


class TestSteps:
    """Machines whose points of contact take turns."""

    @pytest.mark.parametrize("kind", slow_after(2, ["wheel", "rocker", "shuttle"]))
    def test_straight_lines_have_closed_forms(self, kind):
        """Half flight, launch speed and contact, and their derivatives by the two ratios."""
        machine = {"wheel": rimless_wheel, "rocker": rocking_block, "shuttle": shuttle}[kind]()
        texts, ratios = ["flight_time/2", "alpha", "contact_time"], ["inertia_ratio", "gravity_ratio"]
        found = sensitivities(machine, 1, ratios, texts)
        assert [found.at[text] for text in texts] == pytest.approx(closed_form(kind, 1.0, 0.5, 1), rel=1e-13)
        by_inertia = by_differences(lambda mu: closed_form(kind, mu, 0.5, 1), 1.0)
        by_gravity = by_differences(lambda kappa: closed_form(kind, 1.0, kappa, 1), 0.5)
        assert [found[text]["inertia_ratio"] for text in texts] == pytest.approx(by_inertia, rel=1e-10)
        assert [found[text]["gravity_ratio"] for text in texts] == pytest.approx(by_gravity, rel=1e-10)

    @pytest.mark.slow
    @pytest.mark.parametrize("kind", slow_after(1, STEPS))
    def test_all_quantities_with_their_derivatives(self, kind):
        """The quantities of documents, of neighbouring orbits, and of states on a fine mesh of the whole step."""
        machine, family, name = STEPS[kind]
        orbit = find(machine, family)
        values, document = quantities(machine, orbit), orbit.document()
        rises = {f"{of.replace(' ', '_')}_rise": rise for of, rise in orbit.rises.items()}
        for each in values.keys() & {*document, *rises}:
            assert values[each] == pytest.approx({**document, **rises}[each], rel=1e-9), each
        assert {"clearance", "loss_coefficient"} <= values.keys() if kind == "shuttle" else "friction_needed" in values
        states = orbit(np.linspace(0, orbit.period, 20001))
        assert values["stroke"] == pytest.approx(np.ptp(states[:, 0] - states[:, 2]), rel=1e-6)
        found = sensitivities(machine, orbit, name, [*values])

        def near(value: float) -> list[float]:
            other = machine.with_values(**{name: value})
            return [*quantities(other, find(other, start=orbit), [*values]).values()]

        expected = by_differences(near, machine.values[name], 1e-4)
        for each, slope in zip(values, expected.tolist(), strict=True):
            size = max(abs(slope), abs(values[each]))
            assert found[each][name] == pytest.approx(slope, abs=1e-7 * size), each

    def test_what_a_step_does_not_have(self):
        wheel = rimless_wheel()
        orbit = find(wheel)
        assert "loss_coefficient" not in quantities(wheel, orbit)
        with pytest.raises(NoOrbit, match=r"no loss_coefficient: .*, or a landing keeps nearly all of it"):
            quantities(wheel, orbit, "loss_coefficient")
        with pytest.raises(InputError, match="'friction_left' here: the machine states no friction"):
            quantities(wheel, orbit, "friction_left")
        with pytest.raises(InputError, match=r"'friction_needed' here: a .* states no places"):
            quantities(shuttle(), find(shuttle()), "friction_needed")
