"""Orthogonal polynomials of one variable, their Gauss rules, and sets of degrees for many."""
