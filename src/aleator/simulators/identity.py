"""By what a run is known: the simulator's fingerprint, the conditions that it asks for, and x."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from aleator.simulators.protocol import Simulator


@dataclass(frozen=True)
class Identity:
    """Which simulator it is: runs are reused only under the same `fingerprint`.

    `name` and `description` are for people; `version` is the user's own, or empty.
    """

    fingerprint: str
    name: str
    description: str = ""
    version: str = ""

    @classmethod
    def of(cls, simulator: Simulator) -> Identity:
        """The identity of a simulator.

        >>> from aleator.simulators.function import FunctionSimulator
        >>> def length(load, stiffness):
        ...     return load / stiffness
        >>> identity = Identity.of(FunctionSimulator(length, version="2.1"))
        >>> identity.name, identity.version
        ('length', '2.1')
        """
        return cls(
            simulator.fingerprint(),
            simulator.name,
            str(getattr(simulator, "description", type(simulator).__name__)),
            str(getattr(simulator, "version", "")),
        )


@dataclass(frozen=True)
class Case:
    """What many runs have in common: values of conditions (as JSON), names of parameters.

    The parameters are in the order of the alphabet, so that a study may list them in any. A series
    has lists of values among its conditions. Its number of rows, and the responses that a simulator
    named, stand under the empty name, which no condition has.
    """

    conditions: str
    parameters: tuple[str, ...]

    @classmethod
    def of(
        cls,
        conditions: Mapping[str, Any],
        parameters: Iterable[str],
        rows: int | None = None,
        responses: Sequence[str] = (),
    ) -> Case:
        """The case of some conditions; floats are written so that they read back exactly.

        >>> Case.of({"load": 1.0, "bench": "A"}, ["y", "x"])
        Case(conditions='{"bench": "A", "load": 1.0}', parameters=('x', 'y'))
        """
        plain = {name: _plain(value) for name, value in conditions.items()}
        if rows is not None or responses:
            plain[""] = {"rows": rows or 1, "responses": [*responses]}
        text = json.dumps(plain, sort_keys=True, ensure_ascii=False, default=repr)
        return cls(text, tuple(sorted(parameters)))

    @property
    def names(self) -> str:
        """The names of the parameters as JSON."""
        return json.dumps(self.parameters, ensure_ascii=False)

    @cached_property
    def hash(self) -> str:
        """A short text that no other case of the simulator has."""
        return hashlib.sha256(f"{self.conditions}\n{self.names}".encode()).hexdigest()[:32]


def _plain(value: Any) -> Any:
    """A condition as JSON knows it; 2 is the same condition as 2.0."""
    value = value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value
    return float(value) if type(value) is int else value
