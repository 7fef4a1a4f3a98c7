"""What can be decided: predictions, probabilities and limits, with alpha's uncertainty."""
