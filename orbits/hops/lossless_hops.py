"""The multipliers of lossless hops, many together, from the motions of their halves.

Let P be the derivative of the state in the middle of the flight by that at launch, and R the reversor, which leaves the
former as it is. The second half is the mirror image of the first one, so that its derivative is R P^-1 R and that of
the whole flight R P^-1 R P; the same holds of the contact. Between them lies the projection by a tangential landing
(`multiplier.tangential_landing`), and at lift-off the change of its time: so no motion must be followed again.

One multiplier is always 1: let e be the gradient of the energy on the launches. A launch near the lossless one loses no
energy to first order, so that e A = e for the derivative A of the map. With a reflection H that turns e to its first
axis, the first row of H A H is (1, 0, ..., 0), and what is left without its first row and column has the others.
"""

from collections.abc import Callable, Mapping

import numpy as np

from ..errors import InputError
from ..model import Machine, dimensionless
from ..numerics import Array
from ..periodic import gradients
from ..shooting import Evaluation, columns, through_mirror
from .impacts import impacts_of
from .launch_section import LaunchSection

# A pair of multipliers is complex where its imaginary part is larger than this.
COMPLEX = 1e-9


class LosslessHops:
    """The derivatives of the map of launches at lossless orbits of a machine, at any values of its parameters.

    Raises `InputError` for a machine whose launch is a speed alone.
    """

    def __init__(self, machine: Machine):
        if machine.model.one_speed:
            raise InputError(
                f"a launch of a {machine.model.name} is one speed, so its lossless hops have one multiplier, which is "
                "always 1; bifurcations(...) follows the multipliers of hops with an injection"
            )
        self.impacts = impacts_of(dimensionless(machine))
        self.section = LaunchSection(self.impacts)

    def derivatives(self, unknowns: tuple[str, ...], us: Array, ps: Array, evaluation: Evaluation) -> Array:
        """The derivatives (m, d, d) of the map at solutions (m, n) with unknowns of these names and parameters (m, np),
        where the equations are the evaluation (m)."""
        return self._with_powers(unknowns, us, ps, evaluation)[0]

    def others(self, unknowns: tuple[str, ...], us: Array, ps: Array, evaluation: Evaluation) -> Array:
        """Matrices (m, d - 1, d - 1) whose eigenvalues are the multipliers besides that of the energy."""
        derivatives, powers = self._with_powers(unknowns, us, ps, evaluation)
        axis = powers / np.linalg.norm(powers, axis=1)[:, None]
        axis[:, 0] += np.where(axis[:, 0] < 0, -1.0, 1.0)
        reflection = np.eye(axis.shape[1]) - axis[:, :, None] * axis[:, None] * (2 / (axis**2).sum(1))[:, None, None]
        return (reflection @ derivatives @ reflection)[:, 1:, 1:]

    def _with_powers(
        self, unknowns: tuple[str, ...], us: Array, ps: Array, evaluation: Evaluation
    ) -> tuple[Array, Array]:
        """The derivatives, and the gradients (m, d) of the energy on the launches."""
        impacts, model, contact = self.impacts, self.impacts.model, self.impacts.contact
        u, p = dict(zip(unknowns, us.T, strict=False)), dict(zip(contact.parameters, ps.T, strict=False))
        ps = ps[:, : len(p)]
        x = columns(model.launch(u, p))
        landing, foot = columns(model.reversal.image(list(x.T), p)), impacts.feet[-1]
        y, standing = x @ impacts.onto_contact.T, columns(model.relabelling.image(list(landing.T), p))
        slopes, rates = impacts.force_gradients(y, contact.data(y, ps))[0], contact.field(y, ps)[0]
        tangent = self.section.tangents(slopes)
        begun = model.embed @ tangent
        change = np.array(model.relabelling.signs)[:, None] * through_mirror(evaluation, 0, begun, model.reversal.signs)
        taken, rows = impacts.projection(standing, impacts.shares_of_landing(landing, foot, ps), ps)
        change = impacts.onto_contact @ (change - taken @ (rows @ change))
        change = through_mirror(evaluation, 1, change, model.contact_reversal.signs)
        late = np.einsum("mk,mkc->mc", slopes, change) / np.einsum("mk,mk->m", slopes, rates)[:, None]
        gradient = gradients(model.flight, model.flight_gradient, contact.parameters)
        (work,) = gradient(x, impacts.flight.data(x, ps))
        found = self.section.free((change - rates[:, :, None] * late[:, None]).swapaxes(1, 2)).swapaxes(1, 2)
        return found, np.einsum("mn,mnd->md", work, begun)


def _of_pairs(others: Array) -> Array:
    """The product (m,) of 1 - a b over all pairs of eigenvalues a, b of matrices (m, d, d)."""
    values = np.linalg.eigvals(others)
    first, second = np.triu_indices(values.shape[1], 1)
    return np.prod(1 - values[:, first] * values[:, second], axis=1).real


def _test_at(value: float) -> Callable[[Array], Array]:
    """The test function of a multiplier of this value, 1 or -1."""
    return lambda others: np.linalg.det(np.eye(others.shape[1]) - value * others)


# The crossings of the unit circle by multipliers besides that of the energy, by kind, with the test functions of the
# matrices `LosslessHops.others`, which change their sign there. All are polynomials in the entries of the matrices.
CROSSINGS: Mapping[str, Callable[[Array], Array]] = {
    "multiplier 1": _test_at(1.0), "flip": _test_at(-1.0), "Neimark-Sacker": _of_pairs,
}  # fmt: skip


def is_crossing(kind: str, others: Array) -> bool:
    """Whether a test function that vanishes at a matrix (d, d) says that multipliers cross the unit circle: the product
    of two real ones may be 1 too."""
    return kind != "Neimark-Sacker" or bool(abs(_pairs_of_product_one(others[None])[0, 0].imag) > COMPLEX)


def angles_left(others: Array) -> Array:
    """2 - |a + b| (m,) for the pair of eigenvalues a, b of each of matrices (m, d, d) whose product is nearest to 1: on
    the unit circle it is positive, and it changes its sign where the pair becomes real, a neutral saddle."""
    return 2.0 - np.abs(_pairs_of_product_one(others).sum(1).real)


def _pairs_of_product_one(others: Array) -> Array:
    """The pairs (m, 2) of eigenvalues of matrices (m, d, d) whose products are nearest to 1."""
    values = np.linalg.eigvals(others)
    pairs = values[:, np.array(np.triu_indices(values.shape[1], 1)).T]
    return pairs[np.arange(len(pairs)), np.abs(1 - pairs.prod(2)).argmin(1)]
