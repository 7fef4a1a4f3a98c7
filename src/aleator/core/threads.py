"""One thread for the linear algebra of small matrices.

Aleator's matrices are small and many. A linear-algebra library (BLAS) that splits each of them over
all cores gains nothing, and on busy cores its threads wait for each other. On two busy cores the
response surfaces of the wet-clutch example took 121 s with two BLAS threads and 3.0 s with one.
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
    """Make a function use one thread for linear algebra; the former number is restored after it.

    Not for functions that call the user's simulator, which decides about its own threads. Cost:
    some tens of microseconds a call.

    >>> single_threaded(abs)(-1)
    1
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        with _controller().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
