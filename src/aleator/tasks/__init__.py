"""What a user may ask: identify, predict, recover, compare, next experiments, and more.

Each file has one public function and the answer that it returns, with its tables and its
representation in a notebook. `identify` returns an `Identification`: the result, with a `Session`
that holds the model, the simulator and the fit. Other tasks take an `Identification`, or, before
there is one, a simulator with its experiments. Predictions, probabilities and tolerance limits
stand on a `PredictionContext`: new experiments, and what makes their outcomes.

Three nouns: identification, session, prediction context.
"""
