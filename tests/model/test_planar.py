"""The ground under machines whose masses move along it, in other parameters."""

from plane import wheel

from orbits.model import NORMAL_FORCE, reparametrised


def test_a_model_in_other_parameters_has_the_same_ground():
    machine = wheel(friction="0.4/share")
    p, x = machine.values, [0.1, 0.2, 0.6, 0.4]
    own = reparametrised(machine.model, lambda p: {**p, "mu": 1 / p["ratio"]})
    others = {"ratio": 1 / p["mu"], **{name: p[name] for name in ("kappa", "a", "share")}}
    assert own.planar.stands
    assert own.planar.friction(others) == machine.model.planar.friction(p) == 0.4
    for name in ("handed_over", "handed_back"):
        assert getattr(own.planar, name)(x, others) == getattr(machine.model.planar, name)(x, p)
    forces = (model.flight.watch[NORMAL_FORCE](x, at, []) for model, at in ((own, others), (machine.model, p)))
    assert float(next(forces)) == float(next(forces))
