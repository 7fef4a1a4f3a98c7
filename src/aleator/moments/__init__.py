"""The paper's way: moments of the outcome, a density that is fitted to them, the likelihood.

    alpha -> E[Y^m], m = 0..M  (propagation: nodes of the law, or an expansion)
          -> f_Y               (densities: maximum entropy, Gaussian)
          -> sum_l log f_Y     (likelihood)

Three nouns: `Moments` are those of N outcomes, with their derivatives; a `Density` is a choice that
is fitted to them; a `Propagation` leads from alpha to moments. A study chooses this way by
`[density]` or by collocation. Without them no module of this room is imported: the likelihood is
that of level sets, or an integral over individual parameters.
"""
