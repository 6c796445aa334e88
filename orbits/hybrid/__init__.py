"""Motions through impacts and contacts: simulation, the return map, its multiplier."""
