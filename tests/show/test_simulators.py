"""Motions exported for simulators: the files, and what MuJoCo and Drake make of them."""

import csv
import importlib
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from orbits import InputError, Mechanism, Orbit, find, simulate
from orbits.mechanics import Body, Inerter, Joint, Mass, Potential, Spring, Weight, bodies_of
from orbits.show.plane import labelled
from problems import Chain, Hopper, Juggler, hopper_in_si, knee_hopper, rimless_wheel, rocking_block, runner, springs


def read(folder):
    """The heads, the phases, and the times, places and speeds of a table."""
    with open(folder / "motion.csv", encoding="utf-8") as file:
        heads, *rows = csv.reader(file)
    numbers = np.array([[float(each) for each in (row[0], *row[2:])] for row in rows])
    places, speeds = np.split(numbers[:, 1:], 2, axis=1)
    return heads, [row[1] for row in rows], numbers[:, 0], places, speeds


def wheel(**others):
    return rimless_wheel(mass=2.0, length=0.4, spokes=8, inertia=0.4, body_inertia=0.4, stiffness=20.0, **others)


def a_run():
    return find(runner(foot_mass=0.1, rest_length=3.7), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})


def hopping(*elements, **stated):
    """A short flight of two masses of 1 and what else is stated."""
    own = [Mass("body", 1.0), Mass("foot", 1.0), Spring("body - foot"), *elements]
    machine = Mechanism(("body", "foot"), own, gap="foot", **stated)
    return simulate(machine, state=[2.0, 0.0, 1.0, 0.0, *(0.0 for _ in machine.actuators)], time=0.5)


CUBIC = hopper_in_si(60.0, 3.0, force=springs.formula("1500*r + 2e6*r**3"), rest_length=0.8)
MOTIONS = {
    "hung": lambda: hopping(Spring("body", "0.2*r"), Spring("-body", "0.1*r + 0.1")),
    "hopper": lambda: find(Hopper(rest_length=10)),
    "cubic": lambda: find(CUBIC),
    "bilinear": lambda: find(Hopper("bilinear", rest_length=10)),
    "leg": lambda: find(hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8)),
    "chain": lambda: simulate(Chain((1, 2, 3)).mechanism, state=[2.0, 0, 1.0, 0, 0.5, 0], time=1.0),
    "juggler": lambda: find(Juggler(mass_ratio=0.7)),
    "wheel": lambda: find(wheel()),
    "downhill": lambda: simulate(wheel(slope=0.02), 1.0, hops=2),
    "block": lambda: find(rocking_block(inertia_ratio=1.0, gravity_ratio=0.5, angle=0.3, share=0.5)),
    "runner": a_run,
}


def test_the_table_and_the_model_of_a_leg(tmp_path):
    """The joints are the coordinates of a column; numbers have all their digits and their units."""
    orbit = MOTIONS["leg"]()
    folder = orbit.export(tmp_path / "leg", t=[0.0, 0.1, 0.3])
    heads, phases, times, places, speeds = read(folder)
    assert heads == ["time (s)", "phase", "y1_up (m)", "y2_up (m)", "y1_up' (m/s)", "y2_up' (m/s)"]
    assert phases == ["flight", "flight", "contact"]
    assert (np.column_stack([places, speeds]) == orbit(times)[:, [0, 2, 1, 3]]).all()
    model = ElementTree.parse(folder / "model.xml").getroot()
    assert [float(each.get("mass")) for each in model.iter("inertial")] == [60.0, 3.0]
    assert model.find("option").get("gravity").split()[2] == "-9.8066499999999994"
    assert [float(model.find("tendon/fixed").get(name)) for name in ("stiffness", "springlength")] == [8000.0, 0.0]
    assert model.findall(".//body")[0].get("pos").split()[2] == "0.80000000000000004"


def attributes(folder, name):
    """The attribute of all tendons of a model."""
    return [each.get(name) for each in ElementTree.parse(folder / "model.xml").findall("tendon/fixed")]


def test_springs_are_cubics_of_the_extension(tmp_path):
    folder = MOTIONS["cubic"]().export(tmp_path / "cubic")
    assert attributes(folder, "stiffness") == ["1500 0 2000000"]
    assert attributes(folder, "springlength") == ["0"]
    folder = hopping(Spring("body", "0.5*r**2")).export(tmp_path / "hop")
    joint = ElementTree.parse(folder / "model.xml").find(".//joint")
    assert (joint.get("stiffness"), joint.get("springref")) == ("0 0.5", "0")
    folder = hopping(Spring("-body", "0.5*r**2")).export(tmp_path / "hop")  # the same force, the other way round
    assert ElementTree.parse(folder / "model.xml").find(".//joint").get("stiffness") == "0 -0.5"


def test_what_the_model_does_not_have_is_said(tmp_path):
    machine = Hopper("tanh", gravity="1/(1 + z/R)**2", rest_length=9, damping=0.1, parameters={"b": 0.3, "R": 200.0})
    folder = simulate(machine, 4.0, hops=1).export(tmp_path / "hop")
    text = (folder / "model.xml").read_text(encoding="utf-8")
    assert "Approximate: the spring along y1 - y2 with the force tanh(b*r)/b is " in text
    assert "Approximate: the change of gravity 1/(1 + z/R)**2 with the height y2 is " in text
    assert "Not in this model" not in text
    assert "0.1" in [(each or "")[:3] for each in attributes(folder, "damping")]
    folder = hopping(Spring("body*foot"), Spring("body", "r + sign(r - 1)"), Potential("body")).export(tmp_path / "hop")
    text = (folder / "model.xml").read_text(encoding="utf-8")
    assert "Not in this model: the spring along body*foot with the force r." in text
    assert "Not in this model: the spring along body with the force r + sign(r - 1)." in text
    assert "Not in this model: the potential." in text


UPRIGHT = [Body("top", [Joint("up", "up", "body")], 1.0), Body("toe", [Joint("toe_up", "up", "foot")], 1.0)]
BLOCK = rocking_block(inertia_ratio=1.0, gravity_ratio=0.5, angle=0.3, share=0.5)


def test_bodies_have_the_weight_of_the_machine(tmp_path):
    said = "Not in this model: the part of the weight that differs from that of the bodies."
    for extra, expected in (([], False), ([Weight("body", "0.5")], True)):
        folder = hopping(*extra).export(tmp_path / "hop")
        assert (said in (folder / "model.xml").read_text(encoding="utf-8")) == expected
    folder = hopping(Spring("body - 0.1*a", 0.2), actuators={"a": "speed"}).export(tmp_path / "hop")
    assert "the displacement of the actuator 'a'." in (folder / "model.xml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (
            lambda: hopping(Inerter("body - foot", 0.2), bodies=UPRIGHT),
            "inertia of body is 1 in the bodies of the mechanism, but 1.2",
        ),
        (
            lambda: hopping(bodies=[replace(UPRIGHT[0], mass=7.0), UPRIGHT[1]]),
            "inertia of body is 7 in the bodies of the mechanism, but 1",
        ),
        (lambda: hopping(bodies=UPRIGHT[:1]), "inertia of foot is 0 in the bodies of the mechanism, but 1"),
        (lambda: find(replace(BLOCK, bodies=[replace(BLOCK.bodies[0], inertia=0.0), *BLOCK.bodies[1:]])), "of theta"),
    ],
)
def test_bodies_have_the_inertia_of_the_machine(tmp_path, run, message):
    with pytest.raises(InputError, match=message):
        run().export(tmp_path / "hop")


@pytest.mark.parametrize(
    ("folder", "message"), [("none/hop", "there is no folder"), ("file", "it is a file, not a folder")]
)
def test_where_nothing_can_be_written(tmp_path, orbits, folder, message):
    (tmp_path / "file").touch()
    orbit = find(Hopper())
    with pytest.raises(InputError, match=message):
        orbit.export(tmp_path / folder)
    refused = orbits("find --export", tmp_path / folder)
    assert refused.code == 2
    assert message in refused.err


@pytest.mark.parametrize("t", [[], [np.nan], "abc", [1e9]])
def test_times_are_those_of_the_motion(t, tmp_path):
    run = simulate(Hopper(), 4.6, hops=1)
    with pytest.raises(InputError, match="times"):
        run.export(tmp_path / "hop", t=t)
    for folder in (None, "", tmp_path / ("x" * 300), "a\0b"):
        with pytest.raises(InputError, match=r"folder =|cannot be written"):
            run.export(folder)


def test_machines_without_bodies(tmp_path):
    with pytest.raises(
        InputError, match=r"the knee hopper is not a column .* give its bodies and their joints, bodies="
    ):
        bodies_of(knee_hopper(), knee_hopper().values)
    saved = find(Hopper()).save(tmp_path / "hop.json")
    with pytest.raises(InputError, match="needs the orbit's machine"):
        Orbit.load(saved).export(tmp_path / "hop")


def test_the_command(tmp_path, orbits):
    for command in ("find", "simulate --alpha 4.6 --hops 1"):
        done = orbits(f"{command} --export", tmp_path / "motion")
        assert done.code == 0
        assert sorted(each.name for each in (tmp_path / "motion").iterdir()) == [
            "model.xml",
            "motion.csv",
            "springs_for_drake.py",
        ]


def places_of_masses(result, t):
    """The places (k, m, 2), across and up, of the elements with mass, moved on by the steps of the drawing."""
    from orbits.mechanics import value_of
    from orbits.show.plane import _led_on

    machine, (_, states, landings) = result.source.stated(), labelled(result, t)
    y = dict(zip(machine.coordinates, states[:, : 2 * len(machine.coordinates) : 2].T, strict=True))
    masses = [each for each in machine.elements if isinstance(each, Mass)]
    pairs = [(each.across or 0.0, each.height) for each in masses]
    found = [[np.broadcast_to(value_of(x, y, result.source.values), len(t)) for x in pair] for pair in pairs]
    points = np.transpose(found, (2, 0, 1))
    return points if machine.drawing is None else _led_on(machine.drawing, points, landings, result.source.values)


@pytest.mark.extra("mujoco")
@pytest.mark.parametrize("name", MOTIONS)
def test_mujoco_replays(name, tmp_path):
    """The masses are where we compute them, and MuJoCo's own energy of all bodies and springs is constant in lossless
    motions, which holds masses, inertias, springs, gravity, places and speeds together."""
    mujoco = pytest.importorskip("mujoco")
    result = MOTIONS[name]()
    folder = result.export(tmp_path / name)
    _, _, t, places, speeds = read(folder)
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, found, energies = mujoco.MjData(model), [], []
    for data.qpos[:], data.qvel[:] in zip(places, speeds, strict=True):
        mujoco.mj_forward(model, data)
        found.append(data.xipos[1:, [0, 2]].copy())
        energies.append(data.energy.sum())
    expected = places_of_masses(result, t)
    if name == "wheel":  # four steps
        assert places[-1, 0] - places[0, 0] == pytest.approx(4 * 2 * 0.4 * np.sin(np.pi / 8))
    if name == "downhill":  # the heights are those of gravity, and the model's those above the slope
        c, s = np.cos(0.02), np.sin(0.02)
        expected = places_of_masses_on_slope(result, t)
        assert model.opt.gravity == pytest.approx([9.80665 * s, 0, -9.80665 * c])
    else:
        assert np.ptp(energies) < 1e-11 * max(np.abs(energies))
    bodies = [0] if len(expected[0]) == 1 else range(len(found[0]))
    assert np.array(found)[:, bodies] == pytest.approx(expected, abs=1e-12)


def places_of_masses_on_slope(result, t):
    """The hub of the wheel along the slope and above it."""
    _, states, steps = labelled(result, t)
    angle = np.pi / 8
    return 0.4 * np.stack([
        np.sin(states[:, 2] - angle) + 2 * steps * np.sin(angle), np.cos(states[:, 2] - angle)
    ], axis=1)[:, None]  # fmt: skip


@pytest.mark.extra("mujoco")
@pytest.mark.parametrize("name", ["leg", "runner"])
def test_mujoco_flies_as_we_do(name, tmp_path):
    """From lift-off through nine tenths of the flight, with an error of the fourth order of the step."""
    mujoco = pytest.importorskip("mujoco")
    orbit = MOTIONS[name]()
    end = 0.9 * orbit.flight_time
    folder = orbit.export(tmp_path / name, t=[0.0, end])
    *_, places, speeds = read(folder)
    model, errors = mujoco.MjModel.from_xml_path(str(folder / "model.xml")), []
    for steps in (50, 100, 200):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], model.opt.timestep = places[0], speeds[0], end / steps
        for _ in range(steps):
            mujoco.mj_step(model, data)
        errors.append(max(abs(data.qpos - places[1]).max(), abs(data.qvel - speeds[1]).max()))
    assert errors[-1] < 1e-5 * abs(speeds).max()
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16, rel=0.15)


@pytest.mark.extra("mujoco")
def test_mujoco_has_the_springs(tmp_path):
    """Its energy is constant over a lossless motion up to rounding for a cubic spring, and near it for others."""
    mujoco, spread = pytest.importorskip("mujoco"), list[float]()
    varying = Hopper("cubic", gravity="1/(1 + z/R)**2", rest_length=9, parameters={"R": 200.0})
    for machine in (CUBIC, Hopper("air", rest_length=10), varying):
        folder = find(machine).export(tmp_path / "hop")
        *_, places, speeds = read(folder)
        model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
        model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        data, energies = mujoco.MjData(model), []
        for data.qpos[:], data.qvel[:] in zip(places, speeds, strict=True):
            mujoco.mj_forward(model, data)
            energies.append(data.energy.sum())
        spread.append(np.ptp(energies) / max(np.abs(energies)))
    cubic, air, gravity = spread
    assert cubic < 1e-14
    assert air < 2e-7
    assert gravity < 2e-9


@pytest.mark.extra("pydrake")
def test_drake_flies_with_the_springs(tmp_path, monkeypatch):
    """Over nine tenths of a flight, and its energy is constant."""
    analysis = pytest.importorskip("pydrake.systems.analysis")
    config = analysis.SimulatorConfig(integration_scheme="runge_kutta5", accuracy=1e-12, max_step_size=0.05)
    for machine, close in ((Hopper("cubic", rest_length=10), 1e-8), (Hopper("bilinear", rest_length=10), 1e-8)):
        orbit = find(machine)
        end = 0.9 * orbit.flight_time
        folder = orbit.export(tmp_path / "hop", t=[0.0, end])
        *_, places, speeds = read(folder)
        monkeypatch.syspath_prepend(str(folder))
        module = importlib.import_module("springs_for_drake")
        diagram, plant = module.plant_with_springs(folder / "model.xml")
        simulator = analysis.Simulator(diagram)
        analysis.ApplySimulatorConfig(config, simulator)
        context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        plant.SetPositionsAndVelocities(context, [*places[0], *speeds[0]])
        simulator.AdvanceTo(end)
        flown = plant.GetPositionsAndVelocities(context)
        assert flown == pytest.approx(np.append(places[1], speeds[1]), abs=close)
        springs = module.Springs(plant, folder / "model.xml")
        plant.SetPositionsAndVelocities(context, [*places[0], *speeds[0]])
        kinetic = [plant.EvalKineticEnergy(context)]
        weights = [plant.EvalPotentialEnergy(context) + springs.energy(places[0])]
        plant.SetPositionsAndVelocities(context, flown)
        kinetic.append(plant.EvalKineticEnergy(context))
        weights.append(plant.EvalPotentialEnergy(context) + springs.energy(flown[:2]))
        assert np.ptp(np.add(kinetic, weights)) < close


@pytest.mark.extra("pydrake")
@pytest.mark.parametrize("name", ["hopper", "wheel", "runner"])
def test_drake_replays(name, tmp_path):
    """Drake reads the bodies and joints of the same model."""
    parsing, plants = pytest.importorskip("pydrake.multibody.parsing"), pytest.importorskip("pydrake.multibody.plant")
    result = MOTIONS[name]()
    folder = result.export(tmp_path / name)
    _, _, t, places, speeds = read(folder)
    plant = plants.MultibodyPlant(0.0)
    parsing.Parser(plant).AddModels(str(folder / "model.xml"))
    plant.Finalize()
    context, found = plant.CreateDefaultContext(), []
    names = [each.get("name") for each in ElementTree.parse(folder / "model.xml").iter("body")]
    for place, speed in zip(places, speeds, strict=True):
        plant.SetPositionsAndVelocities(context, [*place, *speed])
        poses = [plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name)) for name in names]
        found.append([pose.translation()[[0, 2]] for pose in poses])
    expected = places_of_masses(result, t)
    bodies = [0] if len(expected[0]) == 1 else range(len(found[0]))
    assert np.array(found)[:, bodies] == pytest.approx(expected, abs=1e-12)
