"""The command line `orbits`, its options and the files that state machines."""
