"""What was measured: the table of experiments, and the errors of its observations.

Three nouns: `Experiments` are the rows of a table, each of an experiment with one draw of the
parameters; `Observations` are the measured values of their responses, exact or between bounds;
`MeasurementErrors` give log p of every observation at simulated values.

`tables` reads files and frames cell by cell, `outcomes` what is measured or censored in them,
`experiments` puts ids, conditions and observations together, `responses` holds transforms and the
limits of a test, `model` the laws of an error, and `errors` the noise of each response.
"""
