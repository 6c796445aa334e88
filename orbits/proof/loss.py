"""The loss coefficient of the hops beside a lossless one, enclosed."""

from flint import arb

from ..model.model import Model
from ..model.phase import Statement
from .exact import Numbers
from .root import Root


def loss_of(model: Model, numbers: Numbers, statement: Statement, root: Root) -> tuple[arb, str]:
    """TODO"""
    raise NotImplementedError
