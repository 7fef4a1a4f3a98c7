"""What sections of study.toml are made of: known keys, and what is known or to be identified."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Discriminator, FiniteFloat, Tag, model_validator
from pydantic_core import PydanticCustomError

from aleator.errors import nearest
from aleator.laws import Free, Specification


class Section(BaseModel):
    """A table of the file: known keys only, values of the right type, numbers not as text."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, value: Any) -> Any:
        for key in value if isinstance(value, Mapping) else ():
            if key not in cls.model_fields:
                raise PydanticCustomError(
                    "unknown_key",
                    "{problem}",
                    {
                        "key": key,
                        "problem": f"there is no such key{nearest(key, cls.model_fields)}",
                        "remedy": f"the keys here are {', '.join(cls.model_fields)}",
                    },
                )
        return value

    def given(self, *leave_out: str) -> dict[str, Any]:
        """The keys that the file gives; the library's defaults stand for the others."""
        return {key: getattr(self, key) for key in self.model_fields_set if key not in leave_out}


class FreeSection(Section):
    """A hyperparameter to be identified: `{lower = 0.5, upper = 1.4, start = 1.0}`."""

    lower: FiniteFloat | None = None
    upper: FiniteFloat | None = None
    start: FiniteFloat | None = None

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        low, high, start = self.lower, self.upper, self.start
        if low is not None and high is not None and not low < high:
            raise fault(f"lower {low:g} >= upper {high:g}", "swap or correct the two numbers")
        for bad, side, bound in (
            (low is not None and start is not None and start < low, "below lower", low),
            (high is not None and start is not None and start > high, "above upper", high),
        ):
            if bad:
                raise fault(f"start {start:g} is {side} {bound:g}", "move it between them")
        return self


def fault(problem: str, remedy: str) -> PydanticCustomError:
    """What is wrong with a key, and what to do about it."""
    return PydanticCustomError("inadmissible", "{problem}", {"problem": problem, "remedy": remedy})


def _kind(value: Any) -> str:
    return "table" if isinstance(value, (Mapping, FreeSection)) else "number"


Spec = Annotated[
    Annotated[FiniteFloat, Tag("number")] | Annotated[FreeSection, Tag("table")],
    Discriminator(_kind),
]


def specification(spec: FiniteFloat | FreeSection) -> Specification:
    """A number fixes a hyperparameter, a table frees it within its limits.

    >>> specification(FreeSection(lower=0.0, upper=1.0))
    Free(lower=0.0, upper=1.0, start=None)
    """
    return Free(spec.lower, spec.upper, spec.start) if isinstance(spec, FreeSection) else spec
