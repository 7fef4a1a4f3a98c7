"""From experiments and a simulator to a law: the flow of an identification.

`Question` says what is asked: experiments, laws, noise, a simulator, and how to compute. `refined`
finds the maximum that neither nodes nor runs move, on the simulator itself or on surfaces that are
made exact where the laws lie. `certain` adds information, profile intervals and other maxima, and
`identified` the check on the simulator: an `Answer`. `result_of` writes it down as plain data.
Read `flow.py` first.
"""
