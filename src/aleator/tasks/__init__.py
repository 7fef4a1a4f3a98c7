"""The tasks of a user: identify, predict, recover, compare, choose next experiments, and more.

Each file has one public function and the class of its result, with tables and a representation in
a notebook. `identify` returns an `Identification`: the result, with a `Session` that holds the
model, the simulator and the fit. Other tasks take an `Identification`, or a simulator with its
experiments. Predictions, probabilities and tolerance limits are computed from a
`PredictionContext`: new experiments, with all that is needed to simulate their outcomes.

Three nouns: identification, session, prediction context.
"""
