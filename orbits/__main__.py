"""``python -m orbits`` is the command ``orbits``, found by its entry point since it knows the machines above."""

from importlib.metadata import distribution

if __name__ == "__main__":
    (command,) = distribution("persistent-orbits").entry_points.select(group="console_scripts", name="orbits")
    command.load()()
