"""What was measured: the table of experiments, and the noise on its outcomes."""
