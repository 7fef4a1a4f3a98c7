"""What sections of study.toml are made of: known keys, and what is known or to be identified."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    FiniteFloat,
    PlainValidator,
    Tag,
    model_validator,
)
from pydantic_core import PydanticCustomError

from aleator.errors import nearest
from aleator.laws import By, Free, Specification

TOLD = "told"
"""The type of the errors that say themselves what is wrong with a key."""


class Section(BaseModel):
    """A table of the file: known keys only, values of the right type, numbers not as text."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, value: Any) -> Any:
        for key in value if isinstance(value, Mapping) else ():
            if key not in cls.model_fields:
                raise fault(
                    f"there is no such key{nearest(key, cls.model_fields)}",
                    f"the keys here are {', '.join(cls.model_fields)}",
                    key,
                )
        return value

    def given(self, *leave_out: str) -> dict[str, Any]:
        """The keys that the file gives; the library's defaults stand for the others."""
        return {key: getattr(self, key) for key in self.model_fields_set if key not in leave_out}


def _law(value: Any) -> Any:
    """A law by its keys; the table of laws is made with these sections, and therefore later."""
    from aleator.study.sections import LAWS

    return LAWS.read(value)


class FreeSection(Section):
    """A hyperparameter to be identified: `{lower = 0.5, upper = 1.4, start = 1.0}`.

    `prior` is a law with numbers as its keys: `prior = {law = "normal", mean = 1.0, sd = 0.1}`.
    """

    lower: FiniteFloat | None = None
    upper: FiniteFloat | None = None
    start: FiniteFloat | None = None
    prior: Annotated[Any, PlainValidator(_law)] = None

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


def fault(problem: str, remedy: str, key: str = "") -> PydanticCustomError:
    """What is wrong with a table, or with a key of it, and what to do about it."""
    return _told(key, f": {problem}", remedy)


def missing(key: str, remedy: str) -> PydanticCustomError:
    """A key that a table lacks."""
    return _told(key, " is missing", remedy)


def unknown(key: str, value: object, known: Sequence[str], group: str) -> PydanticCustomError:
    """A key whose value is none of those that there are, nor of the plug-ins' in the group."""
    problem = f" = {in_toml(value)} is not known{nearest(str(value), known)}"
    remedy = f"choose one of {', '.join(known)}, or install the plug-in with this entry point"
    return _told(key, problem, f"{remedy} of {group}")


def _told(key: str, problem: str, remedy: str) -> PydanticCustomError:
    context = {"key": key, "problem": problem, "remedy": remedy}
    return PydanticCustomError(TOLD, "{key}{problem}", context)


def in_toml(value: object) -> str:
    """A value as it is written in TOML, cut to one line.

    >>> in_toml(True), in_toml("text"), in_toml([1.0, "a"])
    ('true', '"text"', '[1.0, "a"]')
    """
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    text = text.replace("'", '"')
    return text if len(text) <= 60 else text[:57] + "..."


def _kind(value: Any) -> str:
    return "table" if isinstance(value, (Mapping, FreeSection)) else "number"


Spec = Annotated[
    Annotated[FiniteFloat, Tag("number")] | Annotated[FreeSection, Tag("table")],
    Discriminator(_kind),
]


class FormulaSection(FreeSection):
    """A hyperparameter that follows covariates: `{formula = "1 + temperature", lower = 0, ...}`.

    `terms` holds numbers or limits of coefficients by name.
    """

    formula: str
    terms: dict[str, Spec] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _no_prior(self) -> Self:
        if self.prior is not None:
            raise fault(
                "a formula has no prior",
                "give one to its coefficients: terms = {NAME = {lower = ..., upper = ..., "
                "prior = {...}}}",
                "prior",
            )
        return self


def _formula(text: str) -> str:
    try:
        float(text)
    except ValueError:
        return text
    raise fault(f"{in_toml(text)} is a text", f"write the number without quotes: {text}")


def _kind_of_law(value: Any) -> str:
    if isinstance(value, str):
        return "formula"
    with_formula = isinstance(value, FormulaSection) or (
        isinstance(value, Mapping) and ("formula" in value or "terms" in value)
    )
    return "formula table" if with_formula else _kind(value)


LawSpec = Annotated[
    Annotated[FiniteFloat, Tag("number")]
    | Annotated[FreeSection, Tag("table")]
    | Annotated[Annotated[str, AfterValidator(_formula)], Tag("formula")]
    | Annotated[FormulaSection, Tag("formula table")],
    Discriminator(_kind_of_law),
]
"""A hyperparameter of a law: a number, limits, or a formula of covariates."""


def specification(spec: FiniteFloat | str | FreeSection) -> Specification:
    """A number fixes a hyperparameter, a table frees it within its limits, a text is a formula.

    >>> specification(FreeSection(lower=0.0, upper=1.0))
    Free(lower=0.0, upper=1.0, start=None, prior=None)
    >>> specification("1 + temperature").formula
    '1 + temperature'
    """
    if isinstance(spec, str):
        return By(spec)
    if isinstance(spec, FormulaSection):
        terms = {name: specification(term) for name, term in spec.terms.items()}
        return By(spec.formula, spec.lower, spec.upper, spec.start, terms)
    if not isinstance(spec, FreeSection):
        return spec
    prior = None if spec.prior is None else spec.prior.build(Path())
    return Free(spec.lower, spec.upper, spec.start, prior)
