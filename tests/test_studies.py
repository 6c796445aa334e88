"""Every study runs in its quick mode, draws its figure, and gives the number it is for."""

import pytest

from studies import air_track, asteroid


def test_air_track(tmp_path, capsys):
    """Section 10: A1/A2 = 1.517 and 0.103 m, beside the measured 1.523 and 0.099 m."""
    numbers = air_track.main(tmp_path)
    assert numbers["ratio"] == pytest.approx(1.517, abs=5e-4)
    assert numbers["amplitude"] == pytest.approx(0.103, abs=5e-4)
    assert (tmp_path / "air_track.png").stat().st_size > 10_000
    assert "1.523" in capsys.readouterr().out


def test_air_track_amplitudes_are_equation_14():
    orbit, first, second = air_track.amplitudes()
    M, a = orbit.machine["mass_ratio"], orbit.alpha
    top, hand, depth = a**2 / 2, -1 + (1 + a**2) ** 0.5, (1 + M) / M * (1 + (1 + M / (1 + M) * a**2) ** 0.5)
    assert first == pytest.approx(top + depth, rel=1e-7)
    assert second == pytest.approx(hand + depth, rel=1e-7)


def test_asteroid(tmp_path, capsys):
    numbers = asteroid.main(tmp_path, quick=True)
    assert numbers["family"] == 51
    assert numbers["rise"] == pytest.approx(9.857, abs=1e-3)
    assert numbers["constant_gravity_off"] == pytest.approx(0.067, abs=1e-3)
    assert (tmp_path / "asteroid.png").stat().st_size > 10_000
    assert "nearest 10 m" in capsys.readouterr().out
