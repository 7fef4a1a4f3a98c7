"""Adaptive surrogate refinement: search, refine the surfaces, search again until nothing moves."""
