"""The figures of hops whose launches are several numbers show these numbers."""

import numpy as np
from columns import hop_of
from legibility import faults

from orbits import ReturnMap, multipliers
from orbits.show import label_of


def lines_of(axes):
    """The data of the lines of axes that can be read, by label."""
    assert not faults(axes.figure)
    return {line.get_label(): line.get_xydata() for line in axes.get_lines()}


def test_the_map_is_drawn_number_by_number():
    machine, orbit = hop_of()
    hops = ReturnMap(machine)(np.array([ReturnMap(machine)(orbit).launches] * 2) * [[1.0], [1.001]])
    drawn = lines_of(hops.plot())
    for i, name in enumerate(hops.names):
        assert np.array_equal(drawn[label_of(name)], np.column_stack([hops.launches[:, i], hops.next[:, i]]))


def test_a_periodic_hop_is_drawn_up_to_its_first_launch_again():
    machine, orbit = hop_of()
    hop = ReturnMap(machine).periodic_hop(orbit)
    drawn = lines_of(hop.plot())
    assert [*drawn] == [*map(label_of, hop.names)]
    assert all(data[0, 1] == data[-1, 1] for data in drawn.values())


def test_multipliers_are_drawn_in_the_complex_plane():
    found = multipliers(*hop_of())
    points = lines_of(found.plot())["multipliers"]
    assert np.array_equal(points, np.column_stack([found.values.real, found.values.imag]))
