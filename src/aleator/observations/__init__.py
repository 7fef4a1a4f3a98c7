"""The measured data: the table of experiments, and the laws of the measurement errors.

`Experiments` are the rows of a table; all rows of one experiment share one draw of the parameters.
`Observations` are the measured values of their responses, known exactly or by bounds.
`MeasurementErrors` give the log-density log p of every observation, given its simulated value.

The module `tables` reads files and data frames, and `outcomes` reads the measured and censored
values in them. `experiments` joins ids, conditions and observations. `responses` holds transforms
and the limits of a test. `model` has the laws of an error, and `errors` the noise of each response.
"""
