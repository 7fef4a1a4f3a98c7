"""Who makes the runs: this process, or the workers of any executor, and the executors there are."""
