"""What every room needs and none owns: orthogonal polynomials, formulas, and small decisions.

Hermite and Legendre polynomials and Gauss rules are computed in `polynomials`; formulas of
columns and of derived outcomes are read by `arithmetic`. The small files hold one decision each:
how many rows a block has (`blocks`), how long work tells its progress (`progress`), how many
threads the linear algebra takes (`threads`), how a computation ended (`status`), and the array
types (`types`). The exception of misuse, `AleatorError`, stands beside this room in `errors`.
"""
