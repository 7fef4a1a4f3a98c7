"""The paper's way: chaos expansion or nodes of the law, moments, a density, the likelihood.

    alpha -> E[Y^m], m = 0..M  (expansion, quadrature, propagation)
          -> f_Y               (densities: maximum entropy, Gaussian, two Gaussians)
          -> sum_l log f_Y     (predictive, likelihood)

It is asked for by `[density]` or collocation. Without them no module of this room is imported: the
likelihood is that of level sets, or an integral over individual parameters.
"""
