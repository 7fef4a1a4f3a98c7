"""Work as bytes, for the workers of a task that does whole identifications in them."""

from __future__ import annotations

import pickle

import cloudpickle


def packed(work: object) -> bytes | None:
    """The work, with the simulator that it holds, as bytes; None where that cannot travel."""
    try:
        return cloudpickle.dumps(work)  # type: ignore[no-any-return]
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
