"""The engine's description of a machine: phases, closed forms, and the model of a hybrid machine."""
