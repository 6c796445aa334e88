"""The machines, each a mechanism on a page, and the common parts of those of two masses."""
