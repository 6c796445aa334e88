"""The flow of one phase: steps with sensitivities, breakpoints, zero crossings, trajectories."""
