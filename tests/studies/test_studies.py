"""Every study runs in its quick mode, draws a figure that can be read, and gives the number it is for."""

import ast
import re
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from conftest import leave
from legibility import faults, smallest_text
from matplotlib.figure import Figure
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from orbits import find
from orbits.show import STYLE, new_axes, save_figure
from problems import Hopper
from studies import (
    air_track,
    asteroid,
    attraction,
    basins,
    bifurcations,
    brachiator,
    chain,
    chain_hand,
    checked_proofs,
    checker_mutations,
    claims,
    damaged_files,
    damped_hopper,
    design,
    existence,
    figure_3,
    figure_4,
    figure_5,
    figure_6,
    figure_7,
    figure_8,
    gravity_families,
    held_hops,
    inerter,
    knee,
    mutations,
    narrow_features,
    period_four,
    plate,
    proved_steps,
    reproduction,
    robot_leg,
    rocker,
    runner,
    series,
    spring_families,
    start_up,
    stress,
    sweeps,
    theorems,
    tolerances,
    tutorial,
    walker,
    walker_two_legs,
)
from studies.oracle import by_another_integrator
from studies.paper import printed

# The studies whose command says where the figures go, and whether few points are enough.
STUDIES = {
    study.__name__.rpartition(".")[2]: study
    for study in (
        *(
            asteroid,
            attraction,
            basins,
            bifurcations,
            brachiator,
            chain,
            chain_hand,
            damped_hopper,
            design,
            existence,
            figure_5,
        ),
        *(figure_8, gravity_families, inerter, knee, period_four, plate, robot_leg, rocker, runner, series),
        *(held_hops, spring_families, start_up, theorems, tolerances, tutorial, walker, walker_two_legs),
    )
}
# Those that have no quick mode.
WHOLE = ("air_track", "figure_3", "figure_4", "figure_6", "figure_7")
WIDTH, SMALLEST = 900, 9  # pixels: of the figures in the README, and of their type


@pytest.fixture(autouse=True)
def left_for_the_site(request, figures_of_site):
    """The figures that a study has drawn are those that the site shows of it; none is empty."""
    name = request.node.name.removeprefix("test_")
    drawn = request.getfixturevalue("tmp_path") if name in (*STUDIES, *WHOLE) else None
    yield
    if drawn:
        sizes = [path.stat().st_size for path in drawn.glob("*.png")]
        assert min(sizes) > 10_000
        leave(drawn, figures_of_site, name)


@pytest.fixture(autouse=True)
def legible(monkeypatch):
    """Fails where a figure that a study saves has faults."""
    save, found = Figure.savefig, []

    def saved(figure, path, *arguments, **options):
        save(figure, path, *arguments, **options)
        if options.get("format") != "rgba":  # and no frame of an animation
            if str(path).endswith(".png"):
                # All is where it was drawn just now, at this resolution: nothing has to be placed once more.
                figure.dpi, figure.stale = options.get("dpi", figure.dpi), False
            found.extend(f"{path}: {fault}" for fault in faults(figure))
            if (size := smallest_text(figure, WIDTH)) < SMALLEST:
                found.append(f"{path}: type of {size:.1f} pixels where the figure is {WIDTH} pixels wide")

    monkeypatch.setattr(Figure, "savefig", saved)
    yield
    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", STUDIES)
def test_a_command_has_its_options(name, monkeypatch, tmp_path):
    """What is called as a program calls what the tests call, with the folder and the mode that are asked for."""
    study, asked = STUDIES[name], []
    *_, program = ast.parse(Path(study.__file__).read_text(encoding="utf-8")).body
    assert ast.unparse(program.test) == "__name__ == '__main__'"
    monkeypatch.setattr(sys, "argv", [study.__file__, "--quick", "--output", str(tmp_path)])
    names = {**vars(study), "main": lambda folder, quick=False, *_: asked.append((folder, quick))}
    exec(compile(ast.Module(program.body, []), study.__file__, "exec"), names)
    assert asked == [(tmp_path, True)]


@pytest.mark.slow
def test_air_track(tmp_path, capsys):
    """Section 10: A1/A2 = 1.517 and 0.103 m, beside the measured 1.523 and 0.099 m."""
    numbers = air_track.main(tmp_path)
    assert numbers["ratio"] == pytest.approx(1.517, abs=5e-4)
    assert numbers["amplitude"] == pytest.approx(0.103, abs=5e-4)
    assert "1.523" in capsys.readouterr().out


def test_air_track_amplitudes_are_equation_14():
    orbit, first, second = air_track.amplitudes()
    M, a, length = orbit.machine["mass_ratio"], orbit.dimensionless().alpha, orbit.scales.length
    top, hand, depth = a**2 / 2, -1 + (1 + a**2) ** 0.5, (1 + M) / M * (1 + (1 + M / (1 + M) * a**2) ** 0.5)
    assert first == pytest.approx(length * (top + depth), rel=1e-7)
    assert second == pytest.approx(length * (hand + depth), rel=1e-7)


@pytest.mark.slow
def test_theorems(tmp_path):
    """Every hop is proved or refuted, and no wrong claim is proved; an enclosure is hardly wider than what it holds."""
    numbers = theorems.main(tmp_path, quick=True)
    assert numbers["proved"] == numbers["hops"] > 4
    assert numbers["wrong_proved"] == numbers["out_of_time"] == 0
    assert 1 <= numbers["width_ratio"] < 10


@pytest.mark.slow
def test_the_numbers_of_the_paper():
    assert printed.differences() == []


@pytest.mark.slow
def test_damaged_files(capsys):
    """No damaged file is read as another one, and no old file is lost."""
    found = damaged_files.main(quick=True)
    assert found["faults"] == 0
    assert sum(found["files"].values(), Counter())["refused"] > 20
    assert "faults: 0" in capsys.readouterr().out


@pytest.mark.slow
def test_checked_proofs():
    """Each proof is verified by the second program; falsified in one place it is refused by both."""
    assert set(checked_proofs.main(quick=True).values()) == {2}


@pytest.mark.slow
def test_proved_steps():
    """Motions of random wheels and rockers are proved, and no false claims."""
    found = proved_steps.main(count=3, second=2)
    assert found["motions proved"] == found["motions"] > 1
    assert found["false"] == found["false claims proved"] == 0
    assert found["false claims"] == found["motions"]
    assert found["verified"] == found["second program"] > 0


@pytest.mark.slow
def test_checker_mutations():
    """Either program sees a fault of the other."""
    assert set(checker_mutations.main(quick=True).values()) == {1}


@pytest.mark.slow
def test_tolerances(tmp_path, capsys):
    """The model's A1 is 4 % above the measured one, within the authors' bounds; the ratio does not know the units."""
    found = tolerances.main(tmp_path, quick=True)
    ratio, ball = found["spread"].sweep[tolerances.RATIO], found["spread"].sweep[tolerances.BALL]
    assert found["spread"].mean[tolerances.RATIO] == pytest.approx(1.517, abs=5e-4)
    assert found["spread"].mean[tolerances.BALL] == pytest.approx(0.1034, abs=5e-4)
    assert np.ptp(ratio) / np.mean(ratio) < 0.004
    assert 0.1 < np.ptp(ball) / np.mean(ball) < 0.18
    for name in ("stiffness", "surface_gravity"):  # the ratio follows from the masses alone
        assert found["blame"][tolerances.RATIO][name]["total"] < 1e-6
    assert "1.517" in capsys.readouterr().out


@pytest.mark.slow
def test_robot_leg(tmp_path, capsys):
    found = robot_leg.main(tmp_path, quick=True)
    legs, good = found["legs"], found["good"]
    assert len(good) > 10
    assert (np.abs(legs["centre_of_mass_rise"][good] / 0.2 - 1) < 0.1).all()
    assert legs["loss_coefficient"][good].min() == legs["loss_coefficient"][legs["k"] == found["best"]["k"]][0]
    orbit = find(robot_leg.LEG.with_values(**found["best"]), robot_leg.FAMILY)
    assert orbit.admissible
    assert orbit.certificate.loss_coefficient == pytest.approx(legs["loss_coefficient"][good].min(), rel=1e-9)
    assert (tmp_path / "robot_leg.png").stat().st_size > 20_000
    assert "most forgiving" in capsys.readouterr().out


@pytest.mark.slow
def test_asteroid(tmp_path, capsys):
    numbers = asteroid.main(tmp_path, quick=True)
    assert numbers["family"] == 51
    assert numbers["rise"] == pytest.approx(9.857, abs=1e-3)
    assert numbers["constant_gravity_off"] == pytest.approx(0.067, abs=1e-3)
    assert "nearest 10 m" in capsys.readouterr().out


@pytest.mark.slow
def test_existence(tmp_path):
    """The saturating spring alone: the first family exists up to b = 1/3 (the limit of the tanh families), and where it
    does not, any second spring c > 0 beside it brings it back, from far away; so c is a little below 0 here."""
    found = existence.main(tmp_path, quick=True)
    diagram = found["hopper, tanh(b*r)/b + c*r"]
    for row, b in enumerate(diagram.values):
        alone = any(low <= -1e-6 <= high for low, high, _ in diagram.stretches(row))
        assert alone == (b < 1 / 3)


@pytest.mark.slow
def test_figure_7(tmp_path):
    """The inflection on the ground is the lossless hop: two ways to one launch speed."""
    numbers = figure_7.main(tmp_path)
    assert numbers["alpha"] == pytest.approx(numbers["expected"], rel=1e-12)
    assert numbers["pairs"] == [0, 0, 1, 1]


@pytest.mark.slow
def test_spring_families(tmp_path):
    """Saturation ends a family where the force of rest balances that of n oscillations: limits in closed form,
    1/(2n + 1), 1/(n + 1), -1/n and 1.4 (n + 1) for family n, here 1."""
    found = spring_families.main(tmp_path, quick=True)
    for title, limit in (
        ("saturating, tanh(b·r)/b", 1 / 3),
        ("Toda, hard in compression", 1 / 2),
        ("Toda, hard in tension", -1.0),
        ("air spring, by 1/length", 1.4 * 2),
    ):
        (family,) = found[title]
        assert family.end.kind == "escaped"
        assert family.end.limit == pytest.approx(limit, rel=1e-4)


@pytest.mark.slow
def test_gravity_families(tmp_path):
    """In a gradient the hopper ends where the tide stretches the spring to lift-off, the juggler where gravity ends."""
    found = gravity_families.main(tmp_path, quick=True)
    length = gravity_families.REST_LENGTH
    assert found["hopper", "1 - k*z", 1].end.limit == pytest.approx(2 / (length + 1), rel=1e-5)
    assert "the launch speed falls to zero" in found["hopper", "1 - k*z", 1].end.reason
    assert found["juggler", "1 - k*z", 1].end.limit == pytest.approx(1 / length, rel=1e-5)
    assert found["hopper", "1/(1 + z*k)**2", 1].end.kind == "reached"


@pytest.mark.slow
def test_figure_3(tmp_path):
    numbers = figure_3.main(tmp_path)
    assert numbers["ratio"] == pytest.approx(2.0, rel=1e-13)
    assert numbers["difference"] < 1e-13
    assert numbers["periods"][0] == pytest.approx(numbers["periods"][1], rel=1e-14)


def last_bouncing() -> float:
    """The throw from the hand's acceleration g that bounces once and is back there after two periods."""
    hand = lambda t, a: mp.cos(t) - 1 + a * mp.sin(t)  # noqa: E731
    speed = lambda t, a: a * mp.cos(t) - mp.sin(t)  # noqa: E731

    def missed(a, t):
        rest = 4 * mp.pi - t
        return [a * t - t**2 / 2 - hand(t, a), hand(t, a) + speed(t, a) * rest - rest**2 / 2]

    return float(mp.findroot(missed, (3.7, 6.9))[0])


@pytest.mark.slow
def test_figure_4(tmp_path):
    numbers = figure_4.main(tmp_path)
    assert [numbers[name] < -1e-9 for name in figure_4.LANDINGS] == [False, False, True, True, False]
    assert numbers["launch speed"] == figure_4.ALPHA


@pytest.mark.slow
def test_the_page_of_the_paper_fits_a_small_screen(tmp_path):
    """The page has the width of the screen: pictures, and nothing else, are moved in frames of their own, at a size at
    which their type can be read; and the cells of the table name their columns, since its head is left out there."""
    axes = new_axes(0.4, STYLE.page)
    axes.plot([0, 1], [0, 1])
    axes.set(xlabel="time", ylabel="height")
    picture = save_figure(axes, tmp_path / "chain.png")
    rows = [claims.Claim("8", "alpha* < 5", 4.493409, 4.4934094, 1e-6), claims.Claim("9", "stable", True, True, 0)]
    text = reproduction.page([(reproduction.PARTS[0], rows, [("Chains", "N masses", picture)])], quick=False)
    assert "name='viewport' content='width=device-width, initial-scale=1'" in text
    (image,) = re.findall("<div class='figure' tabindex='0'[^>]*>(<img [^>]*>)</div>", text)
    assert text.count("<img") == 1
    low, high = (float(re.search(f"{which}-width:([0-9]+)px", image)[1]) for which in ("min", "max"))
    assert smallest_text(axes.figure, low) > 9
    assert low < 900 < high
    heads = re.findall("<th[^>]*>([a-z]+)</th>", text)
    assert re.findall("<td class='n?' data-head='([a-z]+)'>", text) == 2 * heads
    assert "alpha* &lt; 5" in text
    assert "prefers-color-scheme: dark" in text


@pytest.mark.slow
def test_the_papers_claims():
    wrong = [row for row in reproduction.all_claims() if not row.ok]
    assert not wrong


@pytest.mark.slow
def test_figure_5(tmp_path):
    """Where long bouncing ends was counted in 45 digits too: 100 impacts at 3.71, 2 at 3.73."""
    numbers = figure_5.main(tmp_path, quick=True)
    assert numbers["next at 4"] == pytest.approx(2.07360256000564579, rel=1e-14)
    assert numbers["impacts at 3.4"] == 44
    assert numbers["edge 1000"] == pytest.approx(3.72074, abs=1e-5)
    assert numbers["edge inf"] == pytest.approx(last_bouncing(), abs=1e-9)
    assert numbers["light loss"] == pytest.approx(numbers["lighter loss"], rel=0.1)  # in proportion to M


@pytest.mark.slow
def test_figure_6(tmp_path):
    numbers = figure_6.main(tmp_path)
    assert numbers["typical speed"] > 1
    assert numbers["typical asymmetry"] > 0.1
    assert numbers["lossless speed"] < 1e-8
    assert numbers["lossless asymmetry"] < 1e-4


@pytest.mark.slow
def test_figure_8(tmp_path):
    """Curve (d), and what comes beyond it."""
    numbers = figure_8.main(tmp_path, quick=True)
    assert numbers["eps"] == pytest.approx(0.071587384137, abs=1e-11)
    lows, highs = np.transpose([figure_8.basin(eps) for eps in np.linspace(0.01, numbers["eps"], 6)])
    assert (np.diff(lows) < 0).all()
    assert (np.diff(highs) > 0).all()
    assert highs[-1] - lows[-1] == pytest.approx(numbers["basin"], rel=1e-12)
    assert numbers["stable"] == pytest.approx(4.541763272853, abs=1e-11)
    assert numbers["unstable"] == pytest.approx(4.481341946645, abs=1e-11)
    assert numbers["last cycle"] == pytest.approx(0.113429246523, abs=1e-10)
    assert numbers["stays"] < numbers["crisis"] < numbers["stays"] + 0.002  # the grid's width


@pytest.mark.slow
def test_period_four(tmp_path):
    """The flips and the crisis beyond Fig. 8, with Feigenbaum's ratio, and the flips where M = 2."""
    numbers = period_four.main(tmp_path, quick=True)
    assert numbers["flip of one"] == pytest.approx(0.071587384137, abs=1e-11)
    assert numbers["flip of two"] == pytest.approx(0.113429246523, abs=1e-11)
    assert numbers["fold of four"] < numbers["flip of four"] < numbers["flip of two"]
    assert numbers["crisis"] == pytest.approx(0.138812339792, abs=1e-11)  # to where hops go on, see figure_8
    assert numbers["ratio"] == pytest.approx(period_four.FEIGENBAUM, rel=0.1)  # of the first two gaps
    numbers_of_curve = numbers["flip of 1 at M = 2"], numbers["flip of 2 at M = 2"]
    assert numbers_of_curve == pytest.approx((0.102076351991, 0.162923593866), abs=1e-10)  # by `bifurcations` there


@pytest.mark.slow
def test_bifurcations(tmp_path, capsys):
    """The period doubles at curve (d) of Fig. 8, and the hops of period two are stable up to 0.113429246523; then one
    of them is lossless, after which the next launch is faster by the injection alone."""
    found = bifurcations.main(tmp_path, quick=True)["inject"]
    assert [event.kind for event in found.events] == ["fold", "flip", "flip", "border collision"]
    *values, border = [event.value for event in found.events]
    assert values == pytest.approx([0.0, 0.071587384137, 0.113429246523], abs=1e-10)
    assert sorted(found.events[-1].alphas) == pytest.approx([4.493409457909064, 4.493409457909064 + border], abs=1e-9)
    assert "hops of period two begin here, stable" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_a_diagram_against_brute_force(capsys):
    """Of 30 diagrams the one whose flips were listed twice."""
    assert bifurcations.compare(bifurcations.CASES[1:2]) == []
    assert "1 diagrams against brute force: 0 branches wrong, missing or double" in capsys.readouterr().out


@pytest.mark.slow
def test_design(tmp_path):
    """The first family cannot hop 0.2 m with 0.25 m of stroke; the second can, with C = 1.857 (m/s)**(-1/3)."""
    numbers = design.main(tmp_path, quick=True)
    assert "'centre_of_mass_rise == 0.2' is missed by 0.09413" in numbers["designs"][1]
    assert numbers["winner"].objective == pytest.approx(1.857414700, rel=1e-8)
    assert numbers["curve"].slopes[0] == pytest.approx(-1.547845583, rel=1e-8)
    heights = -numbers["fronts"][2].values[:, 0]
    assert heights.max() == pytest.approx(0.206531, abs=1e-6)


@pytest.mark.slow
def test_basins(tmp_path):
    """Shares by pieces of the map are those of simulated launches, up to the number of these."""
    assert all(off < 0.06 for off in basins.main(tmp_path, quick=True).values())


@pytest.mark.slow
def test_attraction(tmp_path):
    """Little is attracted at M = 1, all at extreme mass ratios, and C is the same for M and 1/M."""
    numbers = attraction.main(tmp_path, quick=True)
    shares = dict(zip(numbers["ratios"], numbers["shares"], strict=True))
    assert shares[1.0] < 0.1
    assert shares[1e-3] == shares[1e3] == 1.0
    assert all(error > 0.005 for error in numbers["errors"])


# Rows that take a second or two, with how many of their attempts are certified and refused; the others have tests of
# their own in smaller numbers.
STRESS = {
    stress.beside_alpha: (136, 0), stress.mass_ratios: (102, 0), stress.long_families: (11, 0),
    stress.stiffnesses: (15, 0), stress.hardly_lifting: (6, 0), stress.collapsing: (20, 0),
    stress.falling_gravity: (17, 0), stress.breakpoints: (8, 2), stress.singular: (7, 7), stress.methods: (14, 0),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("fill", STRESS, ids=lambda fill: fill.__name__)
def test_stress(fill):
    (row,) = stress.main(rows=[fill])
    assert not row.wrong
    assert (row.certified, row.refused) == STRESS[fill]


@pytest.mark.slow
def test_narrow_features():
    """Bumps and steps of random widths from 1e-2 to 1e-9, against integrals of the energy in 40 digits."""
    found = narrow_features.main(narrow_features.cases(5, 1))
    assert found == {"right": 5}


@pytest.mark.parametrize("change", ["alpha", "flight_time", "contact_time", "liftoff_extension", "family"])
def test_the_oracle_sees_what_is_wrong(change):
    """An orbit that says something else than it is."""
    machine = Hopper("cubic")
    orbit, check = find(machine), by_another_integrator(machine, 1)
    assert check(orbit) is None
    if change == "family":
        assert "family 2" in check(replace(orbit, certificate=replace(orbit.certificate, family=2)))
        return
    other = getattr(orbit, change) * (1 + 1e-5)
    moved = replace(orbit, **{change: other})
    if change == "alpha":
        moved = replace(moved, flight=replace(orbit.flight, coefficients=orbit.flight.coefficients * (1 + 1e-5)))
    assert check(moved)


def test_the_first_of_two_lift_offs_is_taken():
    """A force that just reaches the weight, falls, and reaches it again three times as far out."""
    machine = Hopper("1.001 - 3.979*(r - 0.5)**2 + 0.2*(r - 0.5)**5")
    assert find(machine).liftoff_extension == pytest.approx(0.484145, abs=1e-5)


@pytest.mark.slow
def test_damped_hopper(tmp_path):
    """The effort goes with the square of the damping, above its bound, and the work is the dissipation: that of the
    lossless hop, in closed form."""
    numbers = damped_hopper.main(tmp_path, quick=True)
    assert numbers["exponent"] == pytest.approx(2, abs=1e-5)
    assert numbers["effort over c^2"] == pytest.approx(125.81085, abs=1e-5)
    assert numbers["effort over c^2"] > numbers["plastic effort over c^2"] > numbers["bound over c^2"]
    a = find(Hopper()).alpha
    flight = 2 * a * (1 + a**2) / 2 - (1 - a**2) * mp.sin(4 * a) / 4 - a * (1 - mp.cos(4 * a)) / 2
    w, top = mp.sqrt(0.5), 2.0  # in contact y1 = -1 + 2 cos w t + (a/w) sin w t up to lift-off, mirrored
    half = mp.pi / w - mp.atan(a / w / top) / w
    contact = 2 * mp.quad(lambda t: (mp.sqrt(top**2 + (a / w) ** 2) * w * mp.sin(w * t)) ** 2, [0, half])
    assert numbers["dissipation over c"] == pytest.approx(float(flight + contact), rel=1e-10)
    assert numbers["work over c"] == pytest.approx(numbers["dissipation over c"], rel=1e-5)
    assert numbers["injected work over c"] == pytest.approx(numbers["dissipation over c"], rel=1e-3)
    assert numbers["missed"] < 1e-8


@pytest.mark.slow
def test_held_hops(tmp_path):
    """All launches come back within the limits, and the printed multipliers are those of the simulated cycles."""
    numbers = held_hops.main(tmp_path, quick=True)
    assert numbers["machines"] == 4
    assert numbers["share"] == 1.0
    assert numbers["multipliers"] < 1e-3


@pytest.mark.slow
def test_start_up(tmp_path):
    """A start onto the lossless hop, which goes on; recovery costs the square of what is missing."""
    numbers = start_up.main(tmp_path, quick=True)
    assert numbers["start"] == pytest.approx(8.0371, abs=1e-3)
    assert numbers["launches"] < 1e-8
    assert numbers["recovery exponent"] == pytest.approx(2, abs=1e-2)
    assert numbers["any recovery over d^2"] < numbers["recovery over d^2"]
    assert numbers["too fast over any recovery"] < 0.06
    assert numbers["missed"] < 1e-8


@pytest.mark.slow
def test_chain(tmp_path):
    """Equal chains of two masses are the hopper; beside a hop of three the loss has the power 4/3 all round."""
    numbers = chain.main(tmp_path, quick=True)
    assert (numbers["hops 2"], numbers["motions 2"]) == (4, 4)  # half flights 3.18, 5.46, 7.71, 9.95 of those up to 10
    assert numbers["alpha"] == pytest.approx(6.347862743800, rel=1e-12)
    assert numbers["law above"] == pytest.approx(1.0, abs=0.01)
    assert numbers["law below"] == pytest.approx(10.0, rel=0.01)
    for name in ("y1", "y1'"):
        assert numbers[f"exponent {name}"] == pytest.approx(4 / 3, abs=5e-3)


@pytest.mark.slow
def test_inerter(tmp_path):
    """With a linear spring the rise is x^2 g (mu + b)/(2 k), x = tan x: that of an oscillation in the time of flight. A
    softer spring reaches the same rise with more than the stroke."""
    numbers = inerter.main(tmp_path, quick=True)
    x = mp.findroot(lambda x: mp.tan(x) - x, 4.5)
    per_mass = float(x**2 * inerter.GRAVITY / (2 * inerter.STIFFNESS))
    assert numbers["rise over mu + b"] == pytest.approx(per_mass, rel=1e-12)
    assert numbers["spread of it"] < 1e-12 * per_mass
    assert numbers["stroke, inerter, linear spring"] < 0.65 * numbers["stroke, softer linear spring, no inerter"]
    assert (tmp_path / "inerter.png").stat().st_size > 20_000


@pytest.mark.slow
def test_tutorial(tmp_path):
    """In mid-flight the extension is at rest, by another integrator; what is lost in the hops is rounding."""
    numbers = tutorial.main(tmp_path, quick=True)
    m1, m2, k, c, b = 60.0, 3.0, 8000.0, 2e6, 0.5
    level, mass = (m2 + b * (m1 + m2) / m1) * 9.81, m1 * m2 / (m1 + m2) + b
    start = brentq(lambda r: k * r + c * r**3 - level, 0.0, 0.1, xtol=1e-16)
    half = numbers["alpha"] * m1 / (m1 + m2) / 9.81
    assert numbers["flight time"] == pytest.approx(2 * half, rel=1e-13)
    rates = lambda t, x: [x[1], -(k * x[0] + c * x[0] ** 3) / mass]  # noqa: E731
    run = solve_ivp(rates, (0, half), [start, numbers["alpha"]], "DOP853", rtol=1e-13, atol=1e-15)
    assert run.y[1, -1] == pytest.approx(0.0, abs=1e-10)
    assert abs(numbers["lost"]) < 1e-9
    for name in ("tutorial_family.png", "tutorial_best.png"):
        assert (tmp_path / name).stat().st_size > 10_000


@pytest.mark.slow
def test_knee(tmp_path):
    """The launch speed is that of small swings, whatever the links; where the knee folds through in mid-contact, the
    energy of lift-off has become height and torque: theta = 0 at rest."""
    numbers = knee.main(tmp_path, quick=True)
    assert [numbers[f"off {n}"] < 0.006 for n in (1, 2, 3)] == [True] * 3
    p = knee.LEG.values
    for family in (2, 3):
        link = numbers[f"folds {family}"]
        orbit = find(knee.LEG.with_values(link=link), family)
        theta, alpha = orbit.liftoff_extension, orbit.alpha
        standing = p["body_mass"] * (link * np.cos(theta / 2) * alpha) ** 2 / 2
        standing += p["body_mass"] * p["surface_gravity"] * 2 * link * np.sin(theta / 2)
        turned = p["stiffness"] * (p["rest_angle"] ** 2 - (theta - p["rest_angle"]) ** 2) / 2
        assert standing == pytest.approx(turned, rel=1e-9)
    for name in ("knee.png", "knee.gif"):
        assert (tmp_path / name).stat().st_size > 10_000


@pytest.mark.slow
def test_sweeps():
    """Every member of four sweeps is what `find` says of it."""
    assert sweeps.main(members=4, checked=40, samples=3)["wrong"] == 0


@pytest.mark.slow
def test_mutations(tmp_path):
    """A change of a module of numerics is made in a copy, and the tests of the module notice it."""
    sources = [path.read_bytes() for path in sorted(mutations.ROOT.glob("orbits/*/*.py"))]
    assert mutations.main(tmp_path, quick=True) == {"run": 1, "caught": 1}
    assert len((tmp_path / "mutations.jsonl").read_text(encoding="utf-8").splitlines()) == 1
    assert [path.read_bytes() for path in sorted(mutations.ROOT.glob("orbits/*/*.py"))] == sources


def test_mutations_name_tests_in_classes_as_pytest_does(tmp_path):
    copy = mutations.Copy(tmp_path, {})
    for name in ("test_endings.py::TestStatuses::test_a", "test_simulation.py::test_b[1.0-x]"):
        *place, test = f"tests/hops/{name}".replace(".py", "").split("::")
        assert copy._named(".".join(place).replace("/", "."), test) == f"tests/hops/{name}"


@pytest.mark.slow
def test_plate(tmp_path, capsys):
    """The limits of a heavy and of a stiff plate by their laws, and a motion at every stiffness that is tried."""
    numbers = plate.main(tmp_path, quick=True)
    assert numbers["heavy 10000"] == pytest.approx(1.0, abs=2e-3)
    assert 1 - numbers["stiff 64"] == pytest.approx((1 - numbers["stiff 16"]) / 4, rel=0.1)
    assert numbers["fewest motions"] >= 1
    assert numbers["farthest from the plain hop"] < 0.15
    assert "the plate would have to pull the foot" in capsys.readouterr().out


@pytest.mark.slow
def test_chain_hand(tmp_path, capsys):
    """The share s^2 m3/(2 m2) by which a small mass between the springs makes the launch faster."""
    numbers = chain_hand.main(tmp_path, quick=True)
    assert numbers["series 0.001"] == pytest.approx(1.0, abs=2e-3)
    assert numbers["throws"] == 2
    assert "to b = 0.3: reached" in capsys.readouterr().out


@pytest.mark.slow
def test_series(tmp_path, capsys):
    """What a small unsprung mass changes beyond the first order goes with the power 3/2 of it."""
    numbers = series.main(tmp_path, quick=True)
    assert numbers["largest vibration"] < 1.0
    assert "the ground would have to pull" in capsys.readouterr().out


@pytest.mark.slow
def test_runner(tmp_path):
    """A run in SI is that in units of m g/k; friction is least where DOP853 finds it; a branch point is that of 34
    digits."""
    numbers = runner.main(tmp_path, quick=True)
    run, heavy = numbers["run"], numbers["in SI"]
    length = run.source.values["rest_length"]  # of a leg of 1 m, in units of m g/k
    assert run.step == pytest.approx(1.5909532388282215, rel=1e-11)
    assert heavy.step == pytest.approx(run.step / length, rel=1e-10)
    inertia, stiffness = (run.source.values[name] for name in runner.TUNED)
    assert heavy.source.values["inertia"] == pytest.approx(inertia * runner.BODY / length**2, rel=1e-10)
    tuned = stiffness * runner.BODY * runner.EARTH / length
    assert heavy.source.values["hip_stiffness"] == pytest.approx(tuned, rel=1e-10)
    assert numbers["friction 0.1"][3.7] == pytest.approx(0.25404979012958, rel=1e-11)
    assert numbers["end 3.7"] == ("reached", 0.5)
    assert (tmp_path / "runner.gif").stat().st_size > 5_000  # of four instants


@pytest.mark.slow
def test_walker_two_legs(tmp_path):
    """Walks that two other programs found; the one in SI is that in legs; a damper works as a sum over times does."""
    numbers = walker_two_legs.main(tmp_path, quick=True)
    assert numbers["end, legs of 0.1"] == ("reached", pytest.approx(0.31))
    walk, heavy = numbers["walks"]["legs of 0.1"], numbers["in SI"]
    assert walk.half_stance == pytest.approx(2.3901085903795560, abs=1e-11)
    assert heavy.step == pytest.approx(2 * 0.9 * np.sin(0.3), rel=1e-12)
    assert heavy.mean_speed / np.sqrt(9.80665 * 0.9) == pytest.approx(0.10912879026238445, rel=1e-9)
    t = (np.arange(20_000) + 0.5) / 20_000 * walk.period
    _, lean, _, angle, _, torso = walk(t).T
    work = np.mean((torso - lean - angle) ** 2 + (torso - lean + angle) ** 2) * walk.period
    work *= np.sqrt(2 * walk.tuned["hip_stiffness"] * walk.tuned["torso_inertia"])
    assert numbers["costs"]["legs of 0.1"] == pytest.approx(work / walk.step, rel=1e-5)
    assert (tmp_path / "walker_two_legs.gif").stat().st_size > 5_000


@pytest.mark.slow
def test_walker(tmp_path):
    """Beside the lossless walk the law of losses, the first split of the launches and the range that goes on."""
    numbers = walker.main(tmp_path, quick=True)
    assert walker.speed(np.pi / 8, numbers["orbits"][1].period) == pytest.approx(0.4377, abs=5e-5)
    assert numbers["off the law"] < 0.06
    assert numbers["splits"] == pytest.approx(1.8e-6, rel=0.01)
    assert 4e-5 < numbers["goes on"] < 1.5e-4  # the basin is narrow
    assert [numbers[f"slope {slope:g}"] for slope in walker.SLOPES] == [4, 4, 4, 0]
    for name in ("walker.png", "walker_injection.png", "walker.gif"):
        assert (tmp_path / name).stat().st_size > 10_000


@pytest.mark.slow
def test_walker_is_the_wheel_of_other_integrators():
    k, inertia = walker.MASS * walker.GRAVITY * walker.LENGTH / 0.5, walker.INERTIA
    sine = walker.wheel().with_values(stiffness=k, angle=0.3)
    assert find(sine).alpha * np.sqrt(inertia / k) == pytest.approx(0.349144090286584708, rel=1e-12)
    flights = [find(walker.wheel(n).with_values(stiffness=k)).flight_time * np.sqrt(k / inertia) for n in (40, 80)]
    # To small angles, with an error by their square.
    assert (4 * flights[1] - flights[0]) / 3 == pytest.approx(2 * 2.121296681535578, rel=1e-7)


@pytest.mark.parametrize("family", walker.FAMILIES)
def test_walker_needs_the_friction_of_its_acceleration(family):
    orbit, p = find(walker.wheel(), family), walker.wheel().values
    columns = [orbit.flight.names.index(name) for name in ("phi", "theta", "theta'")]
    phi, theta, rate = orbit(np.linspace(0, orbit.flight_time, 4001))[:, columns].T
    z, weight = theta - p["angle"], p["mass"] * p["surface_gravity"]
    turned = (weight * p["length"] * np.sin(z) + p["stiffness"] * (phi - theta)) / p["inertia"]
    along = p["mass"] * p["length"] * (np.cos(z) * turned - np.sin(z) * rate**2)
    across = weight - p["mass"] * p["length"] * (np.sin(z) * turned + np.cos(z) * rate**2)
    assert orbit.certificate.friction_needed == pytest.approx(np.abs(along / across).max(), rel=1e-6)


def test_walker_without_the_spring_loses_by_housners_ratio():
    angle, rate = np.pi / 8, 2.5
    c = walker.MASS * walker.GRAVITY * walker.LENGTH / walker.INERTIA
    lasts, _ = quad(lambda x: (rate**2 + 2 * c * (np.cos(angle) - np.cos(x))) ** -0.5, -angle, angle, epsabs=1e-13)
    left = (walker.INERTIA - walker.MASS * walker.LENGTH**2 * (1 - np.cos(2 * angle))) / walker.INERTIA
    lost = walker.INERTIA * rate**2 / 2 * (1 - left**2)
    distance = 2 * walker.LENGTH * np.sin(angle)
    cost = walker.cost_without_spring(distance / lasts, 8)
    assert cost == pytest.approx(lost / (walker.MASS * walker.GRAVITY * distance), rel=1e-10)


@pytest.mark.slow
def test_brachiator(tmp_path):
    numbers = brachiator.main(tmp_path, quick=True)
    assert numbers["swings"][0].angle == pytest.approx(1.2072434456591203, rel=1e-12)
    ((heavier, lighter, slower, slowest),) = numbers["families"].values()
    kinds = [[event.kind for event in part.events] for part in (heavier, lighter, slower, slowest)]
    assert kinds == [["parts touch"], ["fold"], ["fold"], []]
    # Where the arms are level, the shoulder is as high as the bar; arms without mass leave a pendulum.
    assert heavier.events[0].point["angle"] == pytest.approx(np.pi / 2, rel=1e-9)
    assert slowest.column("half_swing")[-1] == pytest.approx(1.5 * np.pi, abs=0.1)
    assert (tmp_path / "brachiator.gif").stat().st_size > 3_000


@pytest.mark.slow
def test_rocker(tmp_path):
    numbers = rocker.main(tmp_path, quick=True)
    assert numbers["tilts"][1] == pytest.approx(0.47147, abs=5e-6)
    assert numbers["off the law"] < 0.02
    assert numbers["goes on"] < 1e-4 < numbers["splits"]  # one launch speed as long as it goes on


@pytest.mark.slow
def test_rocker_beside_housners_block():
    """The tilts of the block that is integrated, and its first period if slender, are Housner's closed forms."""
    rocks = rocker.housner(0.5 * rocker.ANGLE, 6)
    tilts = [rocker.tilt_after(0.5 * rocker.ANGLE, n) for n in range(6)]
    assert [np.abs(theta).max() for _, theta in rocks] == pytest.approx(tilts, rel=2e-3)
    rate = np.sqrt(rocker.MASS * rocker.GRAVITY * rocker.RADIUS / rocker.INERTIA)
    assert rocks[0][0][-1] == pytest.approx(np.arccosh(2) / rate, rel=5e-3)
    b = rocker.HALF_HEIGHT * np.tan(0.3)
    block = rocker.block().with_values(half_width=b, inertia=0.2, stiffness=3 * rocker.GRAVITY * 0.2 / 0.5)
    speed = find(block).alpha * np.sqrt(block.values["body_inertia"] / block.values["stiffness"])
    assert speed == pytest.approx(0.270673010467295362, rel=1e-12)
