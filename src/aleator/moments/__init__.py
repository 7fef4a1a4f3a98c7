"""The method of the paper: moments of the outcome, a density fitted to them, the likelihood.

    alpha -> E[Y^m], m = 0..M  (propagation: nodes of the law, or an expansion)
          -> f_Y               (densities: maximum entropy, Gaussian)
          -> sum_l log f_Y     (likelihood)

alpha are the hyperparameters of the laws. `Moments` holds the moments of N outcomes with their
derivatives. A `Density` is a kind of density that can be fitted to moments. A `Propagation`
computes the moments from alpha. A study chooses this method by `[density]` or by collocation. In
every other study the likelihood is computed without moments, and this package is not imported.
"""
