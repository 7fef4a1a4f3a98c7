"""The distribution of outcomes under a law, and the likelihood of measured outcomes.

Three nouns: a `Model` is the user's choice of law and of the way a density is computed. A `Problem`
is the model with a simulator (or its response surfaces) and the measured outcomes. A likelihood is
a function of the hyperparameters alpha, with its score; a search maximizes it.

With measurement noise, or several observations per experiment, the likelihood is an integral over
the parameters of each experiment (`individual`). Without noise it is computed from the parameters
for which the simulator gives exactly the measured outcome (`level_sets`), or from a density fitted
to moments of the outcome where the user chooses one.
"""
