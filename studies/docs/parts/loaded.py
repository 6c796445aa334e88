"""What nearly all figures need, loaded once, before a process is forked for each of them."""

import matplotlib.pyplot
import scipy.stats

import orbits
import problems

LOADED = (matplotlib.pyplot, scipy.stats, *(getattr(orbits, name) for name in orbits.__all__), problems)
