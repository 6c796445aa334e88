"""``python -m orbits`` runs the command ``orbits``, found by its entry point, since the command knows the machines."""

from importlib.metadata import distribution

if __name__ == "__main__":
    (command,) = distribution("persistent-orbits").entry_points.select(group="console_scripts", name="orbits")
    command.load()()
