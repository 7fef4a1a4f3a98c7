"""Basic functions that all packages use: orthogonal polynomials, formulas, and small decisions.

Hermite and Legendre polynomials and Gauss rules are computed in `polynomials`. Formulas of columns
and of derived outcomes are read by `arithmetic`. Each small file holds one decision: how many rows
a block of an array has (`blocks`), how a long computation reports its progress (`progress`), how
many threads the linear algebra uses (`threads`), how a computation ended (`status`), and the array
types (`types`). The exception for mistakes of the user, `AleatorError`, is in `aleator.errors`.
"""
