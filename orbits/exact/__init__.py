"""The subject of a theorem, exactly: the stated text as expressions, the mechanics that they state, and the equations
of an orbit. Numbers are rational here, and bounds are decimals."""
