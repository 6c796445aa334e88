"""Laws: what a law tells of itself, and that it comes back."""

import pickle

from problems.laws import springs

ROWS = ([-20.0, -10.0, -1.0, 0.0, 1.0, 10.0, 20.0], [-30.0, -14.0, -1.0, 0.0, 1.0, 14.0, 30.0])


def test_a_law_tells_what_it_is_and_comes_back():
    law = springs.cubic(beta=0.3)
    assert repr(law) == "Law('r + beta*r**3', beta=0.3)"
    again = pickle.loads(pickle.dumps(law))
    assert again == law
    assert again.key == law.key
    assert again != springs.cubic(beta=0.4)
    assert springs.formula("r + r**3").key != springs.formula("r - r**3").key
    assert springs.table(ROWS) == springs.table(ROWS)
    assert springs.table(ROWS) != springs.table((ROWS[0], [2 * force for force in ROWS[1]]))
