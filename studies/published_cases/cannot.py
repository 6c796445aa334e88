"""Published cases that the toolkit cannot state, each with the missing idea."""

from .case import Missing

MISSING = (
    Missing(
        "Conservative gaits of hoppers and bipeds", "M. Raff and C. D. Remy, arXiv 2402.06502 (2024)",
        "a foot without mass, which leaves and meets the ground without an impact",
    ),
    Missing(
        "Spring-mass running", "A. Seyfarth, H. Geyer, M. Guenther and R. Blickhan, A movement criterion for running, "
        "J. Biomechanics 35 (2002) 649-655",
        "a leg without mass, whose angle is set anew in flight; hopping in place is in the table above",
    ),
    Missing(
        "Two-legged walker without loss", "M. Gomes and A. Ruina, Walking model with no energy cost, Phys. Rev. E 83 "
        "(2011) 032901", "a swing foot that may pass the ground in mid-step, where the toolkit has it land",
    ),
    Missing(
        "Swinging from handhold to handhold without loss", "M. W. Gomes and A. L. Ruina, A five-link 2D brachiating "
        "ape model with life-like zero-energy-cost motions, J. Theor. Biol. 237 (2005) 265-278",
        "a hand that catches a point in two directions at once",
    ),
    Missing(
        "Simplest walker as one machine", "M. Garcia, A. Chatterjee, A. Ruina and M. Coleman, J. Biomech. Eng. 120 "
        "(1998) 281-288", "a swing foot that may pass the ground; the table above has the step in three pieces",
    ),
    Missing(
        "Walkers with round feet", "T. McGeer, Passive dynamic walking, Int. J. Robotics Research 9 (1990) 62-82",
        "a foot that rolls, so that the point of contact moves",
    ),
    Missing(
        "Rimless wheel that leans and turns", "M. J. Coleman, A. Chatterjee and A. Ruina, Motions of a rimless spoked "
        "wheel, Dynamics and Stability of Systems 12 (1997) 139-160", "motions out of one plane",
    ),
    Missing(
        "Raibert's hopper, simplified", "D. E. Koditschek and M. Buehler, Analysis of a simplified hopping robot, "
        "Int. J. Robotics Research 10 (1991) 587-605", "a spring whose stiffness switches at the bottom of the motion",
    ),
    Missing(
        "Billiard that counts the digits of pi", "G. Galperin, Playing pool with pi, Regular and Chaotic Dynamics 8 "
        "(2003) 375-394", "two gaps that both rebound, between two balls and at a wall",
    ),
    Missing(
        "Inelastic collapse of three balls", "S. McNamara and W. R. Young, Inelastic collapse and clumping in a "
        "one-dimensional granular medium, Phys. Fluids A 4 (1992) 496-504", "two gaps that both rebound",
    ),
    Missing(
        "Ball that lands and slides", "GitHub, nosnoc/nosnoc_py pull request 97 (2026), sliding_ball_2d.py",
        "a foot that slides; a simulation ends where it would begin to",
    ),
)  # fmt: skip
