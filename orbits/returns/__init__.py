"""Hops that return: the return map of launches, its values, fixed points, basins and bifurcations."""
