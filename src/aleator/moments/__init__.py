"""The paper's way: moments of the outcome, a density that is fitted to them, the likelihood.

    alpha -> E[Y^m], m = 0..M  (propagation: nodes of the law, or an expansion)
          -> f_Y               (densities: maximum entropy, Gaussian)
          -> sum_l log f_Y     (likelihood)

Its nouns are `Moments` of N outcomes with their derivatives, `Density`, a choice that is fitted to
them, and `Propagation`, alpha to moments. It is asked for by `[density]` or collocation. Without
them no module of this room is imported: the likelihood is that of level sets, or an integral over
individual parameters.
"""
