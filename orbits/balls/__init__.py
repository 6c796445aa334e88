"""Numbers and motions enclosed in balls: programs, Taylor steps with their tubes, sets of
motions, roots and signs. The lemmas behind them are in the room `proof`."""
