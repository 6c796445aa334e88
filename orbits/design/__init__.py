"""The best design of a machine: problem, sensitivities, local and multistart optimisation, Pareto fronts."""
