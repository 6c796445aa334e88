"""What a computation is bound by while it runs: one lock, interrupts, time limits, and a sign of life."""
