"""The flow of an identification, from experiments and a simulator to the identified laws.

A `Question` collects the experiments, laws, noise, simulator and settings of one identification.
`refined` maximizes the likelihood, on the simulator itself or on response surfaces, until neither
more quadrature nodes nor more simulator runs move the maximum (`quadrature.py`, `refine.py`).
`with_uncertainty` adds the information matrix, profile intervals and other maxima. `identified`
adds the check of the surfaces on the simulator and returns an `Answer`. `result_of` turns this into
a `Result`, which is plain data. Read `flow.py` first.

Three nouns: question, maximum, answer.
"""
