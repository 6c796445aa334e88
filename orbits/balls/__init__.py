"""Numbers and motions as balls, which hold what they stand for: programs, Taylor steps with their tubes, sets of
motions, roots and signs. The lemmas that they rest on are in the room `proof`."""
