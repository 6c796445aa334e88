"""Measured rows to a smooth curve: branches of a loop, repeated rows, and noise."""

import numpy as np
import pytest

from orbits import InputError, Orbit, find
from problems import Hopper, hopper_in_si
from problems.laws import as_spring, springs

R = np.linspace(-5, 5, 11)


def noise_in(law) -> float:
    return float(law.text.split("noise ")[1].split()[0])


def spread_at(law, r: float) -> float:
    """The standard deviation of a law's force at an extension."""
    breaks, data = law.pieces.table({})
    slopes, piece = np.zeros((len(data), 7)), np.searchsorted(breaks, r, "right") - 1
    slopes[piece, 1:] = (r - data[piece][0]) ** np.arange(6)
    return law.pieces.noise(slopes)[0]


class TestLoop:
    """A cycle up and down on r + 0.02 r**3, whose branches lie 0.3 above and below it."""

    R = np.linspace(-12, 8, 200)
    TRAVEL = np.r_[R, R[::-1]]
    FORCE = TRAVEL + 0.02 * TRAVEL**3 + np.repeat([0.3, -0.3], 200)

    @pytest.mark.parametrize("noise", [0.0, 0.2])
    def test_is_refused_with_its_branches_named(self, noise):
        noisy = self.FORCE + noise * np.random.default_rng(1).normal(size=400)
        with pytest.raises(InputError, match=r'by 0\.\d+, .* name one, branch="loading" or branch="unloading"'):
            springs.table((self.TRAVEL, noisy))

    @pytest.mark.parametrize(("branch", "off"), [("loading", 0.3), ("unloading", -0.3), ("mean", 0.0)])
    def test_is_split_when_asked(self, branch, off):
        law = springs.table((self.TRAVEL, self.FORCE), branch=branch)
        assert law(2.0) == pytest.approx(2 + 0.02 * 8 + off, abs=1e-5)
        rows = {"loading": "rows 1 to 200 of 400, ", "unloading": "rows 201 to 400 of 400, ", "mean": ""}[branch]
        which = f"{rows}cycle 1 of 1, " if rows else ""
        assert law.text == f"table:table ({which}{branch}, noise not known, rows smooth to rounding)"

    @pytest.mark.parametrize("column", ["extension", "compression", "negative extension"])
    def test_loading_is_where_the_travel_grows(self, column, tmp_path):
        """On one side of rest, whichever sign that side has."""
        travel = np.r_[np.linspace(0, 9, 50), np.linspace(9, 0, 50)]
        sign = -1 if column.startswith("negative") else 1
        rows = zip(sign * travel, sign * (travel + np.repeat([0.3, -0.3], 50)), strict=True)
        path = tmp_path / "loop.csv"
        path.write_text(f"{column.split()[-1]},force\n" + "".join(f"{a},{b}\n" for a, b in rows))
        law = as_spring(f"table:{path}?branch=loading")
        assert abs(law(3.0 if column == "extension" else -3.0)) == pytest.approx(3.3)

    @pytest.mark.parametrize("counts", [(5, 5), (40, 23), (7, 60)])
    def test_the_mean_lies_half_way_where_both_branches_are(self, counts):
        """Branches of r + 0.1 and r - 0.1 on unequal grids that are offset."""
        up, down = np.linspace(-1, 1, counts[0]), np.linspace(0.75, -1.25, counts[1])
        law = springs.table((np.r_[up, down], np.r_[up + 0.1, down - 0.1]), branch="mean", noise=0)
        low, high = law.range()
        assert (low > -1.01, high < 0.8) == (True, True)
        value, slope = law.with_slope(np.linspace(low, high, 99))
        assert value == pytest.approx(np.linspace(low, high, 99), abs=1e-12)
        assert slope == pytest.approx(1.0, abs=1e-9)

    def test_the_mean_of_noisy_branches_has_their_noise(self):
        rng, r = np.random.default_rng(5), np.r_[np.linspace(-9, 9, 150), np.linspace(9, -9, 90)]
        force = r + np.repeat([0.4, -0.4], [150, 90]) + 0.2 * rng.normal(size=240)
        law = springs.table((r, force), branch="mean")
        assert noise_in(law) == pytest.approx(0.2, rel=0.2)
        assert law(R) == pytest.approx(R, abs=0.1)

    @pytest.mark.parametrize("rows", [(15, 15), (15, 40), (4, 3)])
    def test_is_seen_on_one_side_alone_and_in_few_rows(self, rows):
        r = np.r_[np.linspace(-8, 8, rows[0]), np.linspace(8, -8, rows[1])]
        wide = 0.05 * np.maximum(r * (8 - r), 0) if min(rows) > 4 else 0.4
        with pytest.raises(InputError, match="is a loop"):
            springs.table((r, r + np.repeat([1, -1], rows) * wide))

    @pytest.mark.parametrize(
        ("query", "message"),
        [
            ("branch=up", "one of loading, unloading, mean"),
            ("brnch=loading", "did you mean 'branch'"),
            ("noise=much", "'much' is not a number"),
            ("noise=-1", "below 0"),
            ("branch=unloading", "0 rows on the branch"),
        ],
    )
    def test_options_that_cannot_be(self, query, message):
        with pytest.raises(InputError, match=message):
            as_spring(f"table:{springs.SAMPLE}?{query}", in_si=True)


class TestNoise:
    @pytest.mark.parametrize("count", [40, 200, 2000])
    def test_is_estimated_and_smoothed_away(self, count):
        r, rng = np.linspace(-12, 8, count), np.random.default_rng(4)
        law = springs.table((r, r + 0.02 * r**3 + 0.5 * rng.normal(size=count)))
        assert noise_in(law) == pytest.approx(0.5, rel=4 / np.sqrt(2 * count))
        # The error of the smoothed curve is that of its degrees of freedom, ten to twenty.
        fine = np.linspace(-10, 6, 99)
        assert np.sqrt(np.mean((law(fine) - fine - 0.02 * fine**3) ** 2)) < 0.5 * np.sqrt(25 / count)

    def test_does_not_flatten_the_spring_at_rest(self):
        """15 N on a leg's spring, as a cheap load cell gives them."""
        r = np.linspace(-0.03, 0.03, 400)
        noisy = 8000 * r + 2e6 * r**3 + 15 * np.random.default_rng(7).normal(size=400)
        machine = hopper_in_si(3.0, 1.5, force=springs.table((r, noisy), in_si=True))
        assert machine.units.force / machine.units.length == pytest.approx(8000, rel=0.1)

    @pytest.mark.parametrize("force", [np.sinh, np.tanh, lambda r: np.where(r < 0.5, r, 3 * r - 1)])
    @pytest.mark.parametrize("count", [7, 12, 40, 400])
    def test_exact_rows_are_not_smoothed(self, force, count):
        """And their law says so: they are too few, or smooth, or their noise may be that of the law between them."""
        r = np.linspace(-3, 3, count)
        law = springs.table((r, force(r)))
        assert "7 rows are too few" in law.text if count == 7 else "rows smooth to" in law.text or "or less" in law.text
        assert law(r) == pytest.approx(force(r), rel=1e-12, abs=1e-12)
        assert law.pieces.noise is not None
        if "or less" in law.text:  # what may be noise is not much more than what a spline misses between the rows
            fine = np.linspace(-2.8, 2.8, 997)
            assert spread_at(law, 0.1) < 10 * np.abs(law(fine) - force(fine)).max()

    @pytest.mark.slow
    def test_of_unit_size_moves_alpha_as_each_row_does(self):
        """Rows too few to show their noise, against a hop solved anew with each of them changed."""
        r, moves = np.linspace(-6.0, 6.0, 8), []
        force = r + 0.02 * r**3
        orbit = find(Hopper(springs.table((r, force))))
        assert orbit.certificate.alpha_noise is None
        for change in 1e-5 * np.eye(8):
            moves.append(find(Hopper(springs.table((r, force + change), noise=0))).alpha - orbit.alpha)
        assert orbit.certificate.alpha_per_noise == pytest.approx(np.linalg.norm(moves) / 1e-5, rel=1e-4)
        assert "not known: +- " in str(orbit)
        exact = find(Hopper(springs.table((r, force), noise=0)))
        assert (exact.alpha, exact.certificate.alpha_per_noise) == (orbit.alpha, None)

    @pytest.mark.parametrize("noise", [None, 0.5])
    def test_repeated_rows_tell_it(self, noise):
        """25 rows at each of 21 extensions, and two at each of 15, as of a loop that was stored in order."""
        r, rng = np.tile(np.linspace(-12, 8, 21), 25), np.random.default_rng(0)
        law = springs.table((r, r + 0.02 * r**3 + 0.5 * rng.normal(size=525)), noise=noise)
        assert "525 rows smoothed" in law.text
        assert noise_in(law) == pytest.approx(0.5, rel=0.1)
        assert law(R) == pytest.approx(R + 0.02 * R**3, abs=4 * 0.5 / 5)
        assert 0.02 < spread_at(law, 0.0) < 0.5 / 5  # no more than 25 rows at rest alone have
        r = np.repeat(np.linspace(-12, 8, 15), 2)
        assert "30 rows smoothed" in springs.table((r, r + np.tile([0.5, -0.5], 15)), noise=noise).text

    def test_can_be_stated(self):
        r = np.linspace(-12, 8, 200)
        noisy = r + 0.1 * np.random.default_rng(5).normal(size=200)
        assert "noise 0.3 stated" in springs.table((r, noisy), noise=0.3).text
        exact = springs.table((r, noisy), noise=0)
        assert exact(r) == pytest.approx(noisy, abs=1e-12)

    @pytest.mark.slow
    def test_moves_alpha_by_what_the_certificate_says(self):
        """Against the same hop solved anew for rows with other noise, and against the true spring's."""
        truth, r = find(Hopper("r + 0.02*r**3")).alpha, np.linspace(-12, 8, 200)
        law = springs.table((r, r + 0.02 * r**3 + 0.1 * np.random.default_rng(0).normal(size=200)))
        orbit = find(Hopper(law))
        stated = orbit.certificate.alpha_noise
        assert abs(orbit.alpha - truth) < 3 * stated
        assert f"{stated:.1e} (one standard deviation of the rows)" in str(orbit)
        assert orbit.document()["parameters"] == {}
        rng, alphas = np.random.default_rng(6), []
        for _ in range(12):
            again = springs.table((r, r + 0.02 * r**3 + 0.1 * rng.normal(size=200)))
            alphas.append(find(Hopper(again), start=orbit).alpha)
        assert np.std(alphas) == pytest.approx(stated, rel=0.5)  # that of 12 draws is known to a fifth

    @pytest.mark.usefixtures("any_digest")
    def test_old_orbits_without_it_load(self, tmp_path):
        orbit = find(Hopper())
        assert orbit.certificate.alpha_noise is None
        path = orbit.save(tmp_path / "hop.json")
        path.write_text(path.read_text().replace('"alpha_noise": null, ', "").replace('"alpha_noise":null,', ""))
        assert "alpha_noise" not in path.read_text()
        assert Orbit.load(path).alpha == orbit.alpha
