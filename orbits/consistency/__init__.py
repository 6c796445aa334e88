"""Models that are written by hand, held against what follows from them."""
