"""Theorems about hops of the return map that come back: fixed points, hops of a longer period, period doublings."""
