"""Every test run is the same run: one thread unless asked, no display, the same random examples.

Files with slow tests come first, so that no worker is left alone with one at the end.
"""

import os

# Read once, when NumPy loads its linear algebra: so before any import of it. Threads change the
# order of summation, hence the last digits, and make small problems slower. `make kernels` asks
# for two.
for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
os.environ["MPLBACKEND"] = "Agg"

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

settings.register_profile("house", derandomize=True, deadline=None)
settings.load_profile("house")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture
def unreported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands write no report.html, for tests that do not look at it."""
    from aleator.cli import identify

    monkeypatch.setattr(identify, "can_report", lambda **_: False)


@pytest.fixture
def unjudged_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands identify without the second verdict and the best law, for tests of neither."""
    from aleator.cli import running

    left_out = {"consistency": False, "best_law": False}
    whole = running.identify
    monkeypatch.setattr(running, "identify", lambda *given, **by: whole(*given, **by | left_out))
