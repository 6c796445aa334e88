"""The mechanics of a mechanism: its elements, its equations of motion, and the model that follows from them."""
