"""What follows from an uncertain law: draws of alpha, rare events, tolerance limits."""
