"""Published cases that the toolkit cannot state, each with the missing idea."""

from .case import Missing
from .sources import (
    COLEMAN,
    GALPERIN,
    GARCIA,
    KODITSCHEK,
    MCGEER,
    MCNAMARA,
    NOSNOC,
    RAFF,
    SEYFARTH,
)

MISSING = (
    Missing("Conservative gaits of hoppers and bipeds", RAFF, "a foot without mass, which lands without an impact"),
    Missing("Spring-mass running", SEYFARTH, "a leg without mass, whose angle is set anew in flight"),
    Missing("Simplest walker as one machine", GARCIA, "a swing foot that passes below the ground in mid-step"),
    Missing("Walkers with round feet", MCGEER, "a foot that rolls, so that the point of contact moves"),
    Missing("Rimless wheel that leans and turns", COLEMAN, "motions out of one plane"),
    Missing(
        "Raibert's hopper, simplified", KODITSCHEK, "a spring whose stiffness switches at the bottom of the motion"
    ),
    Missing("Billiard that counts the digits of pi", GALPERIN, "two gaps that both rebound"),
    Missing("Inelastic collapse of three balls", MCNAMARA, "two gaps that both rebound"),
    Missing("Ball that lands and slides", NOSNOC, "a foot that slides"),
)
