"""One thread for the linear algebra of small matrices.

Aleator's matrices are small and many. A BLAS that splits each of them over all cores gains nothing,
and on a machine whose cores are busy it waits for itself: on two busy cores the surfaces of the wet
clutch took 121 s with two BLAS threads and 3.0 s with one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
T = TypeVar("T")


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


def single_threaded(function: Callable[P, T]) -> Callable[P, T]:
    """Run a function with one BLAS thread, and give the threads back after it.

    Not for functions that call the user's simulator: its threads are its own. Cost: some tens of
    microseconds a call.

    >>> single_threaded(abs)(-1)
    1
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        with _controller().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
