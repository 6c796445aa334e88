"""One lossless periodic orbit: its equations, their solution, its certificate."""
