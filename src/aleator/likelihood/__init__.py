"""From the law to the distribution of the outcomes, and to the likelihood of what was measured.

Three nouns: a `Model` is the user's choice of law and of how a density is computed; a `Problem` is
the model with a simulator, or its surfaces, and the measured outcomes; a likelihood is a function
of alpha with its score, which a search climbs.

With measurement noise, or several observations an experiment, the likelihood is an integral over
each experiment's own parameters (`individual`). Without noise it comes from the parameters that
give just what was measured (`level_sets`), or from a density of moments where one is chosen.
"""
