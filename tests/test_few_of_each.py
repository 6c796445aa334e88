"""The option with which other versions of Python and of the dependencies meet the tests."""

from types import SimpleNamespace

from conftest import keep_few_of_each


def collected(names: list[str]) -> tuple[list[str], list[str]]:
    """What is kept of tests with these names, and what is told to be left out."""
    items, left_out = [SimpleNamespace(nodeid=name) for name in names], []
    hook = SimpleNamespace(pytest_deselected=lambda items: left_out.extend(item.nodeid for item in items))
    keep_few_of_each(SimpleNamespace(hook=hook), items)
    return [item.nodeid for item in items], left_out


def test_the_first_and_the_last_parameters_are_kept():
    names = ["a.py::one", "a.py::two[1]", "a.py::two[2]", "a.py::two[3]", "a.py::T::two[x-y]", "b.py::two[1]"]
    assert collected(names) == ([name for name in names if name != "a.py::two[2]"], ["a.py::two[2]"])
