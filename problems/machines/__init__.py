"""The machines, each a mechanism on a page, and what those of two masses share."""
