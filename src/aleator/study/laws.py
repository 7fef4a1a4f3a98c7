"""`[parameters.NAME]` of study.toml: a section for each law."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, FiniteFloat, model_validator
from scipy import stats

from aleator.errors import nearest
from aleator.laws import (
    Beta,
    Constant,
    Gamma,
    Law,
    LogNormal,
    Normal,
    ScipyLaw,
    TruncatedNormal,
    Uniform,
)
from aleator.study.keys import FreeSection, Section, Spec, fault, specification

Ends = Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]


def _in_order(box: list[float]) -> tuple[float, float]:
    low, high = box
    if not low < high:
        raise fault(f"box: lower {low:g} >= upper {high:g}", "swap or correct the two numbers")
    return low, high


class TruncatedNormalSection(Section):
    """`law = "truncated_normal"`: a normal law cut at the ends of a box."""

    law: Literal["truncated_normal"]
    box: Annotated[list[float], Field(min_length=2, max_length=2)]
    mean: Spec = FreeSection()
    sd: Spec = FreeSection()
    polynomials: Literal["own", "hermite"] = "own"

    @model_validator(mode="after")
    def _box_in_order(self) -> Self:
        _in_order(self.box)
        return self

    def build(self) -> Law:
        """The library's law."""
        mean, sd = specification(self.mean), specification(self.sd)
        return TruncatedNormal((self.box[0], self.box[1]), mean, sd, self.polynomials)


class NormalSection(Section):
    """`law = "normal"`: a normal law on the whole line."""

    law: Literal["normal"]
    mean: Spec = FreeSection()
    sd: Spec = FreeSection()

    def build(self) -> Law:
        """The library's law."""
        return Normal(specification(self.mean), specification(self.sd))


class ConstantSection(Section):
    """`law = "constant"`: one value in every experiment."""

    law: Literal["constant"]
    value: Spec

    def build(self) -> Law:
        """The library's law."""
        return Constant(specification(self.value))


class UniformSection(Section):
    """`law = "uniform"`: known between the ends of a box, or identified by its mean and sd."""

    law: Literal["uniform"]
    box: Ends | None = None
    mean: Spec = FreeSection()
    sd: Spec = FreeSection()

    @model_validator(mode="after")
    def _box_or_moments(self) -> Self:
        if self.box is None:
            return self
        _in_order(self.box)
        if {"mean", "sd"} & self.model_fields_set:
            raise fault(
                "a uniform law has either a box, and is then known, or mean and sd",
                "delete box, or mean and sd",
            )
        return self

    def build(self) -> Law:
        """The library's law."""
        if self.box is not None:
            return Uniform.between(self.box[0], self.box[1])
        return Uniform(specification(self.mean), specification(self.sd))


class BetaSection(Section):
    """`law = "beta"`: a beta law on a box."""

    law: Literal["beta"]
    box: Ends
    mean: Spec = FreeSection()
    sd: Spec = FreeSection()

    @model_validator(mode="after")
    def _box_in_order(self) -> Self:
        _in_order(self.box)
        return self

    def build(self) -> Law:
        """The library's law."""
        mean, sd = specification(self.mean), specification(self.sd)
        return Beta((self.box[0], self.box[1]), mean, sd)


class GammaSection(Section):
    """`law = "gamma"`: a gamma law above a known end."""

    law: Literal["gamma"]
    mean: Spec = FreeSection()
    sd: Spec = FreeSection()
    lower: FiniteFloat = 0.0

    def build(self) -> Law:
        """The library's law."""
        return Gamma(specification(self.mean), specification(self.sd), self.lower)


class LogNormalSection(Section):
    """`law = "lognormal"`: a lognormal law above a known end, by mean and sd of x itself."""

    law: Literal["lognormal"]
    mean: Spec = FreeSection()
    sd: Spec = FreeSection()
    lower: FiniteFloat = 0.0

    def build(self) -> Law:
        """The library's law."""
        return LogNormal(specification(self.mean), specification(self.sd), self.lower)


class ScipySection(Section):
    """`law = "scipy"`: a continuous distribution of scipy.stats, known or moved and scaled."""

    law: Literal["scipy"]
    distribution: str
    args: dict[str, FiniteFloat] = Field(default_factory=dict)
    mean: Spec | None = None
    sd: Spec | None = None

    @model_validator(mode="after")
    def _known_to_scipy(self) -> Self:
        kind = getattr(stats, self.distribution, None)
        if not isinstance(kind, stats.rv_continuous):
            known = [
                name for name in dir(stats) if isinstance(getattr(stats, name), stats.rv_continuous)
            ]
            raise fault(
                f'distribution = "{self.distribution}": scipy.stats has no continuous '
                f"distribution of that name{nearest(self.distribution, known)}",
                'write its name in scipy.stats, such as distribution = "weibull_min"',
            )
        shapes = [name.strip() for name in (kind.shapes or "").split(",") if name.strip()]
        for name in self.args:
            if name not in (*shapes, "loc", "scale"):
                raise fault(
                    f'args.{name}: "{self.distribution}" has no such argument',
                    f"its arguments are {', '.join([*shapes, 'loc', 'scale'])}",
                )
        for name in shapes:
            if name not in self.args:
                raise fault(
                    f'args.{name} is missing: "{self.distribution}" needs it',
                    f"write args = {{{name} = ...}}",
                )
        return self

    def build(self) -> Law:
        """The library's law."""
        frozen = getattr(stats, self.distribution)(**self.args)
        mean = None if self.mean is None else specification(self.mean)
        sd = None if self.sd is None else specification(self.sd)
        return ScipyLaw(frozen, mean, sd)


# The registry of laws: a further law is one more section here.
LawSection = Annotated[
    TruncatedNormalSection
    | NormalSection
    | UniformSection
    | BetaSection
    | GammaSection
    | LogNormalSection
    | ScipySection
    | ConstantSection,
    Field(discriminator="law"),
]
