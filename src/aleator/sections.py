"""The sections and keys of study.toml, each checked and made into the library's value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    FiniteFloat,
    Tag,
    model_validator,
)
from pydantic_core import PydanticCustomError

from aleator.densities import Density, Gaussian, MaximumEntropy, NodeDensity
from aleator.errors import nearest
from aleator.experiments import Transform
from aleator.laws import Constant, Free, Law, Normal, Specification, TruncatedNormal
from aleator.noise import Noise
from aleator.propagation import Collocation
from aleator.response import ResponseSurface
from aleator.search import (
    CMAES,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
    Search,
)
from aleator.verification import MonteCarlo


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
            raise _fault(f"lower {low:g} >= upper {high:g}", "swap or correct the two numbers")
        for bad, side, bound in (
            (low is not None and start is not None and start < low, "below lower", low),
            (high is not None and start is not None and start > high, "above upper", high),
        ):
            if bad:
                raise _fault(f"start {start:g} is {side} {bound:g}", "move it between them")
        return self


def _fault(problem: str, remedy: str) -> PydanticCustomError:
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


class TruncatedNormalSection(Section):
    """`law = "truncated_normal"`: a normal law cut at the ends of a box."""

    law: Literal["truncated_normal"]
    box: Annotated[list[float], Field(min_length=2, max_length=2)]
    mean: Spec = FreeSection()
    sd: Spec = FreeSection()
    polynomials: Literal["own", "hermite"] = "own"

    @model_validator(mode="after")
    def _box_in_order(self) -> Self:
        low, high = self.box
        if not low < high:
            raise _fault(f"box: lower {low:g} >= upper {high:g}", "swap or correct the two numbers")
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


# The registry of laws: a further law is one more section here.
LawSection = Annotated[
    TruncatedNormalSection | NormalSection | ConstantSection, Field(discriminator="law")
]


def _paired(value: Any) -> Any:
    if not isinstance(value, Mapping):
        raise _fault(f"{value!r} is not of a pair", "name both parameters: a.b = 0.5")
    return value


CorrelationSection = dict[str, Annotated[dict[str, Spec], BeforeValidator(_paired)]]
"""`[correlation]`: `a.b = {lower = -0.9, upper = 0.9}` ties the parameters a and b."""


def pairs(section: CorrelationSection) -> dict[tuple[str, str], Specification]:
    """The correlations by pair of parameters, as the library takes them.

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


class SimulatorSection(Section):
    """`[simulator]`: the function to run."""

    function: str
    vectorized: bool = False


class NoiseSection(Section):
    """`[noise]`: normal measurement noise, known or identified."""

    sd: Spec

    def build(self) -> Noise:
        """The library's noise."""
        return Noise(specification(self.sd))


class SurfaceSection(Section):
    """`method = "response_surface"`: one surface an experiment on the box, built once."""

    method: Literal["response_surface"] = "response_surface"
    tolerance: float = 0.005
    max_runs: int = 1000
    nodes: int | None = None

    def build(self) -> ResponseSurface | Collocation:
        """The library's choice."""
        return ResponseSurface(**self.given("method"))


class CollocationSection(Section):
    """`method = "collocation"`: the simulator runs at the nodes of the law for every alpha."""

    method: Literal["collocation"]
    nodes: int | None = None
    moments: Literal["quadrature", "expansion"] = "quadrature"
    degree: int | None = None

    def build(self) -> ResponseSurface | Collocation:
        """The library's choice."""
        return Collocation(**self.given("method"))


def _method(value: Any) -> str:
    # Whatever is neither is refused by the section.
    chosen = value if isinstance(value, Mapping) else {"method": getattr(value, "method", None)}
    return str(chosen.get("method") or "response_surface")


PropagationSection = Annotated[
    Annotated[SurfaceSection, Tag("response_surface")]
    | Annotated[CollocationSection, Tag("collocation")],
    Discriminator(_method),
]


class DensitySection(Section):
    """`[density]`: the model of the outcome's density."""

    kind: Literal["maximum_entropy", "gaussian"] = "maximum_entropy"
    order: int = 4

    @model_validator(mode="after")
    def _order_is_used(self) -> Self:
        if self.kind == "gaussian" and "order" in self.model_fields_set:
            raise _fault(
                'order has no meaning for kind = "gaussian", which has two moments',
                'delete the key, or write kind = "maximum_entropy"',
            )
        return self

    def build(self) -> Density | NodeDensity:
        """The library's choice."""
        return Gaussian() if self.kind == "gaussian" else MaximumEntropy(self.order)


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
