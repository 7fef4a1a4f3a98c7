"""Aleator identifies the probability law of uncertain parameters from experiments."""
