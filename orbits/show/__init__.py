"""Results drawn: figures, animations and pages, above all that they show."""
