"""Records of test stands: their columns and rows, their cycles and branches, and the smooth curves through these."""
