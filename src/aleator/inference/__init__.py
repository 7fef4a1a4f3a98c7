"""How sure the answer is, whether the simulator agrees, and what a reader must know."""
