"""Ground that yields: the rigid ground as its limits, the plate hopper as its case, and how it is stated."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from orbits import InputError, NoOrbit, Orbit, ReturnMap, check, find, simulate, starts
from orbits.mechanics import Ground
from problems import Actuated, Hopper, Juggler, chain_hand, hopper_in_si, inerter_hopper, juggler_in_si, springs
from problems.machines import files

CUBIC = {"beta": 0.3}
LOSSY = springs.lossy("r", loss_factor=0.1)


def near_rigid(machine, rigid: Orbit, sink: float, name: str = "ground") -> Orbit:
    """The hop that is found from that on rigid ground, the ground resting so low."""
    launch = {"liftoff": rigid(0.0)[0] + sink, "alpha": rigid.alpha, name: sink, f"{name}'": 0.0}
    times = {"duration": rigid.flight_time / 2, "contact_duration": rigid.contact_time / 2}
    return find(machine, start=launch | times)


class TestRigidLimits:
    rigid = find(Hopper("r + beta*r**3", mass_ratio=0.5, parameters=CUBIC))

    def hopper(self, ground: Ground) -> Hopper:
        return Hopper("r + beta*r**3", mass_ratio=0.5, parameters=CUBIC, ground=ground)

    def test_heavy_ground(self):
        """Pressed up by the hopper's weight, ground of mass m falls less by (1/M + 1)/m, and the launch speed is larger
        by this share; the flight time is off by less. Both are so as if gravity were so much larger."""
        masses, stiffness = np.array([1e3, 1e4, 1e5]), 2.0
        hops = [near_rigid(self.hopper(Ground(m, stiffness)), self.rigid, -(m + 3.0) / stiffness) for m in masses]
        speeds = np.array([hop.alpha / self.rigid.alpha - 1 for hop in hops])
        assert np.diff(np.log(np.abs(speeds))) / np.diff(np.log(masses)) == pytest.approx([-1, -1], abs=0.02)
        times = np.array([hop.flight_time / self.rigid.flight_time - 1 for hop in hops])
        assert (np.abs(times) < 100 / masses).all()
        assert abs(hops[-1].contact_time / self.rigid.contact_time - 1) < 1e-3

    def test_an_impact_on_heavy_ground_and_a_spring_with_hysteresis(self):
        law = springs.lossy("r", loss_factor=0.02)
        rigid = simulate(Hopper(law), 4.7, hops=1)
        sink = -(1e8 + 2.0) / 5.0
        state = [*(rigid(0.0) + np.array([sink, 0, sink, 0])), sink, 0.0]
        heavy = simulate(Hopper(law, ground=Ground(1e8, 5.0)), state=state, hops=1)
        assert [event.kind for event in heavy.events] == [event.kind for event in rigid.events]
        assert [event.loss for event in heavy.events][:-1] == pytest.approx(
            [event.loss for event in rigid.events][:-1], rel=1e-5, abs=1e-5
        )
        assert heavy.end == pytest.approx(rigid.end, rel=1e-6)
        last = heavy(heavy.end)
        assert last[1] - last[5] == pytest.approx(rigid.launches[-1], rel=1e-6)


class TestStatement:
    machines = (
        Hopper(ground=Ground(2.0, 5.0)),
        Hopper("cubic", mass_ratio=0.5, rest_length=20.0, damping=0.01, ground=Ground(2.0, "a*r + b*r**3"),
               parameters={"beta": 0.3, "a": 5.0, "b": 0.1}),
        hopper_in_si(3.0, 1.0, stiffness=1000.0, ground=Ground(2.0, 2000.0)),
        hopper_in_si(3.0, 1.0, force="k*r", ground=Ground(2.0, "a*r"), parameters={"k": 1e3, "a": 2e3}),
    )  # fmt: skip

    @pytest.mark.parametrize("machine", machines)
    def test_it_is_restored_from_files_and_pickles(self, machine):
        assert files.machine_stated(files.statement_for_file(machine)) == machine
        assert pickle.loads(pickle.dumps(machine)) == machine
        other = machine.with_values(ground_mass=3.0)
        assert (other.ground.mass, other.values["ground_mass"]) == (3.0, 3.0)
        assert other.ground.spring == machine.ground.spring
        name = next(iter(machine.ground.spring.parameters))
        assert machine.with_values(**{name: 7.0}).ground.spring.parameters[name] == 7.0
        assert machine.describe()["ground"] == {"mass": 2.0, "spring": machine.ground.spring.text}

    def test_a_file_states_it(self, tmp_path):
        text = 'machine = "hopper"\n[ground]\nmass = 2.0\nstiffness = 5.0\n'
        (tmp_path / "a.toml").write_text(text, encoding="utf-8")
        assert files.build(files.read(tmp_path / "a.toml")) == self.machines[0]
        (tmp_path / "b.toml").write_text(text.replace("stiffness", "hardness"), encoding="utf-8")
        with pytest.raises(InputError, match=r"\[ground\]: unknown key 'hardness'"):
            files.build(files.read(tmp_path / "b.toml"))
        (tmp_path / "c.toml").write_text(text.replace("mass = 2.0\n", ""), encoding="utf-8")
        with pytest.raises(InputError, match=r"\[ground\] must have a mass, and a stiffness or a spring"):
            files.build(files.read(tmp_path / "c.toml"))

    def test_in_si_it_hops_as_without_units_and_as_its_mechanism(self):
        machine = self.machines[2]
        bare, units = machine.dimensionless(), machine.units
        start = next(each for each in starts(bare.stated(), 8.0, 8.0) if each["alpha"] > 0)
        hop = find(bare, start=start)
        speed = units.length / units.time
        sizes = dict.fromkeys(start, units.length) | {"alpha": speed, "ground'": speed}
        sizes |= dict.fromkeys(("duration", "contact_duration"), units.time)
        in_si = {name: value * sizes[name] for name, value in start.items()}
        for stated in (machine, machine.stated()):
            orbit = find(stated, start=in_si)
            assert orbit.alpha == pytest.approx(hop.alpha * speed, rel=1e-13)
            assert orbit.flight_time == pytest.approx(hop.flight_time * units.time, rel=1e-13)
        assert "ground_stiffness = 2000 N/m, ground_mass = 2 kg" in dict(find(machine, start=in_si).rows())["machine"]
        assert machine.units_of_parameters()["ground_mass"] == "kg"
        assert machine.units_of_parameters()["ground_stiffness"] == "N/m"
        check(bare, start=hop)

    @pytest.mark.parametrize(
        ("stated", "error", "message"),
        [
            (lambda: Hopper(ground=3.0), InputError, "ground = 3.0; it must be a Ground, for example ground=Ground"),
            (lambda: Hopper(ground=Ground(0.0, 1.0)), InputError, "ground's mass = 0 is out of bounds"),
            (lambda: Hopper(ground=Ground(1.0, 0.0)), InputError, "ground's spring = 0 is out of bounds"),
            (lambda: Hopper(ground=Ground(1.0, "k*r")), InputError, "uses 'k' without a value"),
            (lambda: Hopper(ground=Ground(1.0, 1.0, "soil")), InputError, "is called 'ground', not 'soil'"),
            (lambda: Hopper("ground_mass*r", parameters={"ground_mass": 1.0}), InputError, "the machine's own name"),
            (lambda: Juggler(ground=Ground(1.0, 1.0)), InputError, "lands in a juggler does not land on the ground"),
            (lambda: juggler_in_si(1.0, 1.0, stiffness=1.0, ground=1.0), TypeError, "ground"),
            (lambda: ReturnMap(Hopper(ground=Ground(1.0, 1.0))).upkeep(4.0), InputError, "a launch has 3 numbers"),
            (lambda: ReturnMap(Hopper(LOSSY, ground=Ground(1.0, 1.0))), InputError, "use `simulate` instead of a map"),
            (lambda: find(Hopper(ground=Ground(1.0, 1.0))), NoOrbit, "give `find` a start"),
            (lambda: Actuated(Hopper(ground=Ground(1.0, 1.0))), InputError, "the hopper has 2 springs"),
            (lambda: replace(chain_hand(), ground=Ground(1.0, 1.0)), InputError, "one coordinate, the height"),
            (lambda: replace(inerter_hopper(), ground="soft"), InputError, "ground = 'soft'; it must be a Ground"),
            (lambda: replace(inerter_hopper(), ground=Ground(1.0, 1.0, "foot")), InputError, "give the ground another"),
            (lambda: replace(inerter_hopper(), ground=Ground("foot", 1.0)), InputError, "depends on the coordinate"),
        ],
    )
    def test_what_is_no_ground_is_refused(self, stated, error, message):
        with pytest.raises(error, match=message):
            stated()
