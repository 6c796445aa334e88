"""Models, phases and statements stand in one line."""

from carts import cart

from problems import Hopper


def test_models_and_statements_are_told_in_one_line():
    model = Hopper().model
    assert repr(model) == "Model(name='hopper')"
    assert repr(model.contact) == "Phase(name='contact', states=('y1', \"y1'\"))"
    assert repr(model.reduction.statement) == "Statement(name='relative', unknowns=('liftoff', 'alpha'))"
    assert (
        repr(cart(duration=(1, 1)))
        == "Stage(phase=Phase(name='cart', states=('x', 'v')), intervals=4, duration=(1, 1))"
    )
