"""Every test run is the same run: one thread, no display, the same random examples."""

import os

# Read once, when NumPy loads its linear algebra: so before any import of it. Threads change the
# order of summation, hence the last digits, and make small problems slower.
for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_threads] = "1"
os.environ["MPLBACKEND"] = "Agg"

from hypothesis import settings  # noqa: E402

settings.register_profile("house", derandomize=True, deadline=None)
settings.load_profile("house")
