"""The flow of an identification, from experiments and a simulator to an answer.

A `Question` says what is to be answered: experiments, laws, noise, a simulator, and how to compute.
`refined` finds the maximum that neither nodes nor runs move, on the simulator itself or on surfaces
that are made exact where the laws lie (`quadrature.py`, `refine.py`). `with_uncertainty` adds the
information, profile intervals and other maxima. `identified` adds the check on the simulator; what
it returns is an `Answer`, and `result_of` writes it down as a `Result`, which is plain data. Read
`flow.py` first.

Three nouns: question, maximum, answer.
"""
