"""The sources of published cases, each cited once."""

ABRAMOWITZ = "M. Abramowitz and I. A. Stegun, Handbook of Mathematical Functions (1964)"
BERNOULLI = "Johann Bernoulli, Curvatura radii in diaphanis non uniformibus, Acta Eruditorum (1697)"
BHOUNSULE = (
    "P. A. Bhounsule, Numerical accuracy of two benchmark models of walking, Dynamics of Continuous, Discrete and "
    "Impulsive Systems B 21 (2014) 137-148"
)
BIFURCATION_KIT = "bifurcationkit/BifurcationKit.jl, GitHub, issues 232 (2025) and 274 (2025)"
BLICKHAN = "R. Blickhan, The spring-mass model for running and hopping, J. Biomechanics 22 (1989) 1217-1227"
BRACK = (
    "M. Brack, Bifurcation cascades and self-similarity of periodic orbits with analytical scaling constants in "
    "Henon-Heiles type potentials, Foundations of Physics 31 (2001) 209-232"
)
BRYSON = "A. E. Bryson and Y. C. Ho, Applied Optimal Control (1975)"
CHATTERJEE = (
    "A. Chatterjee, R. Pratap, C. K. Reddy and A. Ruina, Persistent passive hopping and juggling is possible even with "
    "plastic collisions, Int. J. Robotics Research 21 (2002) 621-634"
)
COLEMAN = (
    "M. J. Coleman, A. Chatterjee and A. Ruina, Motions of a rimless spoked wheel: a simple 3D system with impacts, "
    "Dynamics and Stability of Systems 12 (1997) 139-160"
)
DYMOS = "OpenMDAO/dymos, GitHub, joss/test/test_brachistochrone_for_joss.py (2021)"
GALPERIN = "G. Galperin, Playing pool with pi, Regular and Chaotic Dynamics 8 (2003) 375-394"
GARCIA = (
    "M. Garcia, A. Chatterjee, A. Ruina and M. Coleman, The simplest walking model: stability, complexity, and "
    "scaling, J. Biomech. Eng. 120 (1998) 281-288"
)
HOLMES = (
    "P. J. Holmes, The dynamics of repeated impacts with a sinusoidally vibrating table, J. Sound Vib. 84 (1982) "
    "173-189"
)
HOUSNER = (
    "G. W. Housner, The behavior of inverted pendulum structures during earthquakes, Bull. Seism. Soc. Am. 53 (1963) "
    "403-417"
)
IRODOV = "I. E. Irodov, Problems in General Physics (1981)"
JOHNSON = "K. L. Johnson, Contact Mechanics (1985)"
KODITSCHEK = (
    "D. E. Koditschek and M. Buehler, Analysis of a simplified hopping robot, Int. J. Robotics Research 10 (1991) "
    "587-605"
)
LANDAU = "L. D. Landau and E. M. Lifshitz, Mechanics (1976)"
MCGEER = "T. McGeer, Passive dynamic walking, Int. J. Robotics Research 9 (1990) 62-82"
MCNAMARA = (
    "S. McNamara and W. R. Young, Inelastic collapse and clumping in a one-dimensional granular medium, Phys. Fluids A "
    "4 (1992) 496-504"
)
MODELING_TOOLKIT = "SciML/ModelingToolkit.jl, GitHub, issue 4822 (2026)"
NOSNOC = "nosnoc/nosnoc_py, GitHub, pull request 97 (2026)"
OPTIMAL_CONTROL = "control-toolbox/OptimalControl.jl, GitHub, pull request 937 (2026)"
PANKOV = "S. Pankov, Energy-conserving intermittent-contact motion in complex models, arXiv 2402.16010 (2024)"
PASSIVE_WALKER = "P. A. Bhounsule, program passivewalker.m, Cornell University (2009)"
RAFF = "M. Raff and C. D. Remy, arXiv 2402.06502 (2024)"
REDDY = (
    "C. K. Reddy and R. Pratap, Multimodal map and complex basin of attraction of a simple hopper, Phys. Rev. E 68 "
    "(2003)"
)
ROCKIT = "meco-group/rockit, GitHub, examples/bounce.py (2019)"
SEYFARTH = (
    "A. Seyfarth, H. Geyer, M. Guenther and R. Blickhan, A movement criterion for running, J. Biomechanics 35 (2002) "
    "649-655"
)
SHAW = "S. W. Shaw and P. J. Holmes, A periodically forced piecewise linear oscillator, J. Sound Vib. 90 (1983) 129-155"
TEDRAKE = "R. Tedrake, Underactuated Robotics, course notes, MIT (2023), chapter Simple Models of Walking and Running"
TUFILLARO = (
    "N. B. Tufillaro, T. Abbott and J. Reilly, An Experimental Approach to Nonlinear Dynamics and Chaos (1992), "
    "chapter 1"
)
