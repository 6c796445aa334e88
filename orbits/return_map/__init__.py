"""The return map of launch speeds: its values, fixed points, basins and bifurcations."""
