"""The statistics of a fitted model: how certain it is, whether it is right, what to measure next.

A `Fit` is the likelihood of the data at one alpha (the vector of hyperparameters); it makes no
simulator runs. Standard errors (`information.py`), profile intervals, the check of surfaces against
the simulator, consistency with the experiments, the comparison of models, the posterior, the best
possible law (`npmle.py`) and the design of further experiments are computed from a fit. Functions
take a fit or arrays and return numbers; statements in words are `Diagnostic`s, each with a remedy.

Three nouns: fit, inference (the uncertainty of alpha), diagnostic.
"""
