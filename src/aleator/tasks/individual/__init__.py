"""Fits of experiments with parameters of their own."""
