"""What a machine is to the engine: phases, closed forms, and the model of a hybrid machine."""
