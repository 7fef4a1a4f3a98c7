"""The paper, reproduced: every figure and table with its data, and its claims beside ours.

A figure is an entry of `figures.FIGURES`: a name and a function from the shared context to tables,
a drawing, and claims. `python -m reproduction` makes them.
"""
