"""What follows from an uncertain law for new experiments: distributions, rare events, limits.

A `Ground` has the experiments that are asked about, under their laws, and what makes their outcomes
(`ground.py`). Of it come predictions with the uncertainty of alpha (`prediction.py`), tolerance
limits (`limits.py`) and probabilities of an `Event`, rare or not (`probability.py`). For the last
two a value is `Near` its simulator, by a surface of its own that is made exact where the event may
be (`near.py`), and a `Sample` has the points that the probability is computed by (`sample.py`).
"""
