"""The sections and keys of study.toml, each checked and made into the library's value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from aleator.densities import (
    Convolution,
    Density,
    Gaussian,
    GaussianMixture,
    LogSpline,
    MaximumEntropy,
    NodeDensity,
)
from aleator.inference.verification import MonteCarlo
from aleator.laws import Specification
from aleator.observations.experiments import Transform
from aleator.observations.noise import Noise
from aleator.search import (
    CMAES,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
    Search,
)
from aleator.study.keys import Section, Spec, fault, specification
from aleator.study.laws import LawSection
from aleator.study.propagation import PropagationSection, SurfaceSection
from aleator.study.simulators import SimulatorSection


def _paired(value: Any) -> Any:
    if not isinstance(value, Mapping):
        raise fault(f"{value!r} is not of a pair", "name both parameters: a.b = 0.5")
    return value


CorrelationSection = dict[str, Annotated[dict[str, Spec], BeforeValidator(_paired)]]
"""`[correlation]`: `a.b = {lower = -0.9, upper = 0.9}` ties the parameters a and b."""


def pairs(section: CorrelationSection) -> dict[tuple[str, str], Specification]:
    """The correlations by pair of parameters, as the library takes them.

    >>> from aleator.study.keys import FreeSection
    >>> pairs({"a": {"b": 0.5, "c": FreeSection()}})
    {('a', 'b'): 0.5, ('a', 'c'): Free(lower=None, upper=None, start=None)}
    """
    return {(a, b): specification(s) for a, others in section.items() for b, s in others.items()}


class ExperimentsSection(Section):
    """`[experiments]`: the table, and what its columns are."""

    file: str
    outcome: str
    id: str | None = None
    conditions: list[str] | None = None
    transform: Transform = "none"
    delimiter: str = ","
    decimal: str = "."


class NoiseSection(Section):
    """`[noise]`: normal measurement noise, known or identified."""

    sd: Spec

    def build(self) -> Noise:
        """The library's noise."""
        return Noise(specification(self.sd))


_DENSITIES: dict[str, tuple[type[Density | NodeDensity], tuple[str, ...]]] = {
    "maximum_entropy": (MaximumEntropy, ("order",)),
    "gaussian": (Gaussian, ()),
    "gaussian_mixture": (GaussianMixture, ()),
    "convolution": (Convolution, ("points",)),
    "logspline": (LogSpline, ("knots", "smoothing")),
}


class DensitySection(Section):
    """`[density]`: the model of the outcome's density."""

    kind: Literal[
        "automatic", "maximum_entropy", "gaussian", "gaussian_mixture", "convolution", "logspline"
    ] = "automatic"
    order: int = 4
    points: int = 400
    knots: int = 32
    smoothing: float = 1e-5

    @model_validator(mode="after")
    def _keys_are_used(self) -> Self:
        own = () if self.kind == "automatic" else _DENSITIES[self.kind][1]
        for key in sorted(self.model_fields_set - {"kind", *own}):
            owner = next(kind for kind, (_, keys) in _DENSITIES.items() if key in keys)
            raise fault(
                f'{key} has no meaning for kind = "{self.kind}"',
                f'delete the key, or write kind = "{owner}"',
            )
        return self

    def build(self) -> Density | NodeDensity | None:
        """The library's choice; None leaves it to the noise."""
        if self.kind == "automatic":
            return None
        return _DENSITIES[self.kind][0](**self.given("kind"))


class GradientSection(Section):
    """`method = "gradient"`: how often the search starts, and how long each start may climb."""

    method: Literal["gradient"] = "gradient"
    starts: int = 10
    evaluations: int = 60

    def build(self) -> Search:
        """The library's choice."""
        return GradientMultistart(**self.given("method"))


class GeneticSection(Section):
    """`method = "genetic"`: the paper's genetic algorithm."""

    method: Literal["genetic"]
    population: int = 50
    generations: int = 100
    patience: int = 20
    polish: bool = True

    def build(self) -> Search:
        """The library's choice."""
        return GeneticAlgorithm(**self.given("method"))


class DifferentialSection(Section):
    """`method = "differential_evolution"`."""

    method: Literal["differential_evolution"]
    population: int = 50
    generations: int = 100
    polish: bool = True

    def build(self) -> Search:
        """The library's choice."""
        return DifferentialEvolution(**self.given("method"))


class CMAESSection(Section):
    """`method = "cmaes"`: covariance matrix adaptation."""

    method: Literal["cmaes"]
    runs: int = 3
    evaluations: int = 1000
    population: int | None = None
    step: float = 0.2
    polish: bool = True

    def build(self) -> Search:
        """The library's choice."""
        return CMAES(**self.given("method"))


def _search_method(value: Any) -> str:
    chosen = value if isinstance(value, Mapping) else {"method": getattr(value, "method", None)}
    return str(chosen.get("method") or "gradient")


SearchSection = Annotated[
    Annotated[GradientSection, Tag("gradient")]
    | Annotated[GeneticSection, Tag("genetic")]
    | Annotated[DifferentialSection, Tag("differential_evolution")]
    | Annotated[CMAESSection, Tag("cmaes")],
    Discriminator(_search_method),
]


class VerificationSection(Section):
    """`[verification]`: simulator runs an experiment for the Monte Carlo check; 0 is none."""

    samples: int = 1000

    def build(self) -> MonteCarlo:
        """The library's choice."""
        return MonteCarlo(self.samples)


class StudyFile(Section):
    """The whole of study.toml."""

    title: str = ""
    seed: Annotated[int, Field(ge=0)] = 0
    experiments: ExperimentsSection
    simulator: SimulatorSection
    parameters: Annotated[dict[str, LawSection], Field(min_length=1)]
    correlation: CorrelationSection = Field(default_factory=dict)
    noise: NoiseSection | None = None
    propagation: PropagationSection = SurfaceSection()
    density: DensitySection = DensitySection()
    search: SearchSection = GradientSection()
    verification: VerificationSection = VerificationSection()
