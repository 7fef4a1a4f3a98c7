"""`[simulator]` in study.toml: which kind of simulator it is, and what it needs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator

from aleator.errors import nearest
from aleator.simulate import FunctionSimulator, Simulator, load_function
from aleator.study_keys import Section, fault

# The key that tells each kind of simulator, as the file writes it.
_KINDS = {
    "function": 'function = "model.py:name"',
}


class FunctionSection(Section):
    """`function = ...`: a Python function."""

    key: ClassVar[str] = "simulator.function"

    function: str
    vectorized: bool = False

    def build(self, folder: Path) -> Simulator:
        """The library's simulator; `folder` is the study's."""
        return FunctionSimulator(load_function(self.function, folder), self.vectorized)


def _one_kind(value: Any) -> Any:
    """The table as it is, if exactly one key says what kind of simulator it is."""
    if not isinstance(value, Mapping):
        return value
    chosen = [kind for kind in _KINDS if kind in value]
    if len(chosen) == 1:
        return value
    if chosen:
        raise fault(f"{' and '.join(chosen)} are both given", "keep one of them")
    meant = "".join(filter(None, (nearest(key, _KINDS) for key in map(str, value))))
    raise fault(f"it names no simulator{meant}", f"write one of {'; '.join(_KINDS.values())}")


SimulatorSection = Annotated[FunctionSection, BeforeValidator(_one_kind)]
"""`[simulator]`: exactly one kind of simulator."""
