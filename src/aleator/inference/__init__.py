"""The statistics of a fitted model: how sure it is, whether it is right, what to measure next.

A `Fit` is the likelihood with its data at one alpha, which makes no runs. Of it are asked standard
errors (`information.py`), profile intervals, the check on the simulator, consistency with the
experiments, comparison of models, the posterior, the best possible law (`npmle.py`) and the design
of further experiments. Functions take a fit or arrays and return numbers; what they say in words
are `Diagnostic`s, each with a remedy.

Three nouns: fit, inference (of alpha), diagnostic.
"""
