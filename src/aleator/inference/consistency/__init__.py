"""Whether a fitted model is consistent with its experiments."""
