"""Springs and gravity by name, by formula and by measurement."""
