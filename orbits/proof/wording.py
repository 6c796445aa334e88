"""The theorem in words."""

from collections.abc import Mapping

from ..exact import Enclosure, StatedMachine, decimal_text
from .attraction import Attraction

# The statement of each condition of a motion, where it is proved.
CONDITIONS_IN_WORDS = {
    "clearance": "the contact point is above what it lands on throughout the open flight",
    "separation": "the separation stays positive over the whole cycle",
    "contact_force": "the contact pushes throughout the open contact",
    "contact_end": "the contact comes to rest, and ends in a lift-off that is the mirror image of the landing",
}
# The same of machines that may land on another point than opens.
CONDITIONS_OF_STEPS = {
    "clearance": "both gaps are open throughout the open flight, and the one that lands, if it is not the one that "
    "opens, throughout the contact",
    "contact_force": "each point that stands in contact pushes throughout the open contact",
    "contact_end": "the contact comes to its middle, and ends in a lift-off that is the image of the landing",
    "heights": "each height, but for that of the contact point, stays positive over the whole cycle",
    "friction": "the force on what sticks is below the coefficient of friction times the contact force throughout the "
    "open contact, and so are their derivatives where both vanish, at its two ends",
}


# The same of machines that stand on one point in flight, and on two in contact.
CONDITIONS_OF_STANCES = {
    "friction": "on each point the force along the ground is below the coefficient of friction times that across it "
    "throughout the open contact, and so are their derivatives where both vanish",
    "stance": "in flight the force of the ground across it, the sum of the weights and of the masses times the "
    "accelerations of their heights, is positive, and times the coefficient of friction above the size of that along "
    "it, the sum of the masses times the acceleration of their centre",
}
GRAZES = (
    "the gap is open throughout the open flight except for its middle, where it vanishes to second order: there the "
    "point passes the ground tangentially and without a force"
)


def words_of_conditions(stated: StatedMachine) -> dict[str, str]:
    """The statements of conditions about a machine."""
    steps = CONDITIONS_OF_STEPS if stated.steps else {}
    stances = CONDITIONS_OF_STANCES if stated.places else {}
    return CONDITIONS_IN_WORDS | steps | stances | ({"clearance": GRAZES} if stated.grazes else {})


def enclosed_words(enclosures: Mapping[str, Enclosure]) -> str:
    """Enclosures, in words."""
    return "; ".join(f"{name.replace('_', ' ')} in {value}" for name, value in enclosures.items())


def root_sentence(
    unknowns: Mapping[str, Enclosure], uniqueness: str, wide: bool, stated: StatedMachine | None = None
) -> str:
    """The sentences on existence and uniqueness; for a machine with tuned parameters, of these too."""
    names = ", ".join(name.replace("_", " ") for name in unknowns)
    others = f"No other solution has all of these ({names}) within {uniqueness} of these enclosures"
    return f"{solved_words(unknowns, wide, stated)}. {others}."


def solved_words(unknowns: Mapping[str, Enclosure], wide: bool, stated: StatedMachine | None = None) -> str:
    """The statement that there is a solution, and for a machine with tuned parameters that there are such numbers."""
    each, solution = "For each value of the parameters in their intervals", f"with {enclosed_words(unknowns)}"
    if stated is None or not stated.tuned:
        return f"{f'{each} the' if wide else 'The'} {equations_words(unknowns)} have a solution {solution}"
    exact = " and ".join(f"{name.replace('_', ' ')} = {decimal_text(value)}" for name, value in stated.prescribed)
    tuned, *more = (name.replace("_", " ") for name in stated.tuned)
    there = f"are numbers {', '.join((tuned, *more))}" if more else f"is a number {tuned}"
    equations = f"{equations_words(unknowns)}{f' with {exact}, exactly,' if exact else ''}"
    return f"{f'{each} there' if wide else 'There'} {there} for which the {equations} have a solution {solution}"


def equations_words(unknowns: Mapping[str, Enclosure]) -> str:
    """The name of the equations that were solved: without a contact, those of the flight alone."""
    return f"equations of {'' if 'contact_time' in unknowns else 'the flight of '}a lossless orbit"


def motion_sentence(
    family: int | None, conditions: Mapping[str, str], enclosures: Mapping[str, Enclosure], stated: StatedMachine
) -> str:
    """The sentence on the motion."""
    words = words_of_conditions(stated)
    proved = [words[name] for name, verdict in conditions.items() if verdict == "proved"]
    counted = [] if family is None else [f"it is of family {family}"]
    extensions = enclosed_words({name: each for name, each in enclosures.items() if name.endswith("_extension")})
    if not (counted or proved):
        return ""
    whole = "It is a motion: " if proved and set(conditions.values()) == {"proved"} else "Of the motion: "
    return f"{whole}{'; '.join([*counted, *filter(None, [extensions]), *proved])}."


def loss_sentence(enclosure: Enclosure, bounce_side: str) -> str:
    """The sentence on the losses of the hops near the orbit."""
    law = f"loses C |d|**(4/3) of it in one hop, to leading order, with C in {enclosure}"
    side = f"{law}, and ten times as much on the side {bounce_side} it, where the landing has a bounce"
    return f"A launch whose speed is off alpha by d {side}."


def attraction_sentence(radius: str, attraction: Attraction) -> str:
    """The sentence on the launches above the hop, within a decimal."""
    losses, places = attraction.losses, attraction.places
    launch = f"A launch, being a state in contact whose contact force is 0, with liftoff in {places},"
    lands = "lands, bounces once, lands again" if attraction.bounce else "lands once"
    hop = f"whose speed exceeds alpha by d, 0 < d <= {radius}, {lands} and stays in contact until the next launch"
    law = f"which exceeds alpha by d - c d**(4/3) > 0 with c in {losses}"
    rate = f"after n hops by at most (d**(-1/3) + n*{losses.low}/3)**(-3)"
    return f"{launch} {hop}, {law}, and {rate}: the hop attracts all launches above it within {radius}."
