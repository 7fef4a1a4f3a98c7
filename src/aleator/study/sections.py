"""The sections of study.toml, and the values of the library that are made from them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    FiniteFloat,
    PlainValidator,
    Tag,
    model_validator,
)

from aleator.errors import StudyError
from aleator.inference.check import Check
from aleator.inference.outcome_question import OutcomeQuestion
from aleator.laws import Law, Specification
from aleator.laws.correlation import full
from aleator.observations import tables
from aleator.observations.correlated import AR1, CAR1, CompoundSymmetry, ErrorCorrelation
from aleator.observations.experiments import Experiments
from aleator.observations.model import NormalError, ObservationModel, StudentError
from aleator.observations.noise import Noise
from aleator.observations.outcomes import Censored, Censoring
from aleator.observations.responses import Transform
from aleator.observations.state_space import GaussianProcess
from aleator.observations.variance import ExponentialVariance, PowerVariance, VarianceFunction
from aleator.search import (
    CMAES,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
    Search,
)
from aleator.simulators import Simulator
from aleator.study.kinds import (
    BY_FORM,
    LAWS,
    ChosenKind,
    FreeSection,
    Kinds,
    Section,
    Spec,
    fault,
    in_toml,
    missing,
    specification,
)
from aleator.study.simulators import SIMULATORS
from aleator.surrogates import ResponseSurface
from aleator.surrogates.choice import Surfaces

TransformName = Annotated[Transform, Field(strict=False)]


def _words(value: Any) -> Any:
    """The value if it is a list; a single word or number as a list of one."""
    return value if isinstance(value, list) else [value]


def _one(value: Any) -> Any:
    """The value of the key `outcome`; raises for a list, which belongs to the key `outcomes`."""
    if isinstance(value, list):
        raise fault(f"{in_toml(value)} is a list", f"write outcomes = {in_toml(value)}")
    return value


Words = Annotated[
    list[str | int], BeforeValidator(_words, json_schema_input_type=list[str | int] | str | int)
]


class CensoringSection(Section):
    """`censored = {column = "status", right = ["Runout"]}`: how a table marks censored values."""

    column: str | None = None
    right: Words = Field(default_factory=list)
    left: Words = Field(default_factory=list)
    upper: str | None = None
    measured: Words = Field(default_factory=list)
    signs: bool = False

    def build(self) -> Censoring:
        """The rules by which the table marks censored values, as the keys state them."""
        return Censoring(**self.stated())


def _of_each(value: Any) -> str:
    """Whether a table `censored` holds a table for each response, or the keys of one response."""
    keys = {*CensoringSection.model_fields}
    return "each" if isinstance(value, Mapping) and value and not {*value} & keys else "one"


class ExperimentsSection(Section):
    """`[experiments]`: the file of the table, and the role of each of its columns."""

    file: str
    outcome: Annotated[str | None, BeforeValidator(_one)] = None
    outcomes: list[str] | None = None
    response: str | None = None
    id: str | None = None
    conditions: list[str] | None = None
    transform: Annotated[
        Annotated[TransformName, Tag("text")] | Annotated[dict[str, TransformName], Tag("table")],
        BY_FORM,
    ] = Transform.NONE
    censored: (
        Annotated[
            Annotated[CensoringSection, Tag("one")]
            | Annotated[dict[str, CensoringSection], Tag("each")],
            Discriminator(_of_each),
        ]
        | None
    ) = None
    units: dict[str, str] = Field(default_factory=dict)
    delimiter: str = ","
    decimal: str = "."

    @model_validator(mode="after")
    def _one_of_the_two(self) -> Self:
        if self.outcome is None and not self.outcomes:
            raise missing("outcome", 'add outcome = "COLUMN", or outcomes = ["COLUMN", "COLUMN"]')
        if self.outcome is not None and self.outcomes is not None:
            raise fault("outcome is given too", "keep one of the two", "outcomes")
        return self

    def read(self, folder: Path, beside: Collection[str] = ()) -> Experiments:
        """The experiments in the table; `folder` is the folder of the study.

        Columns in `beside` are no conditions, unless the key `conditions` names them. Raises
        ExperimentsError for the errors that `Experiments.from_csv` reports.
        """
        return Experiments.from_csv(
            folder / self.file,
            outcome=self.outcome or self.outcomes or (),
            response=self.response,
            id=self.id,
            conditions=self.conditions,
            transform=self.transform,
            censored=self.censoring(),
            beside=beside,
            delimiter=self.delimiter,
            decimal=self.decimal,
        )

    def stated_units(self, folder: Path) -> Mapping[str, str]:
        """The units of columns: from the key `units`, or else from the heads of the table."""
        heads = tables.stated_units(folder / self.file, self.delimiter)
        return {**heads, **self.units}

    def censoring(self) -> Censored:
        """The rules for censored values of one or each response, or None.

        Raises ExperimentsError for keys that contradict each other.
        """
        if isinstance(self.censored, CensoringSection):
            return self.censored.build()
        if self.censored is None:
            return None
        return {name: one.build() for name, one in self.censored.items()}


Sd = Annotated[
    Annotated[FiniteFloat, Tag("number")]
    | Annotated[FreeSection, Tag("table")]
    | Annotated[str, Tag("text")],
    BY_FORM,
]
"""The type of the key `sd`: a number, limits, or the name of a column of standard deviations."""


CORRELATIONS: Kinds[ErrorCorrelation] = Kinds(
    "aleator.error_correlations",
    "kind",
    {
        "ar1": AR1,
        "car1": CAR1,
        "compound_symmetry": CompoundSymmetry,
        "gaussian_process": GaussianProcess,
    },
)
"""`[noise] correlation = {kind = "..."}`: how the errors of an experiment hang together."""

VARIANCES: Kinds[VarianceFunction] = Kinds(
    "aleator.variances",
    "kind",
    {"power": PowerVariance, "exponential": ExponentialVariance},
)
"""`[noise] variance = {kind = "..."}`: how the scale follows the simulated value or a column."""


def _by_name(kinds: Kinds[Any]) -> Any:
    """The type of a key that names a kind: its name alone, or a table with the keys of the kind."""
    name = Annotated[str, AfterValidator(lambda text: kinds.read({kinds.key: text}))]
    table = Annotated[ChosenKind[Any], PlainValidator(kinds.read)]
    return Annotated[Annotated[name, Tag("text")] | Annotated[table, Tag("table")], BY_FORM]


class NoiseSection(Section):
    """Keys of every kind of noise: its scale, what that follows, and what ties the errors."""

    sd: Sd | None = None
    relative: Spec | None = None
    variance: _by_name(VARIANCES) | None = None  # type: ignore[valid-type]
    correlation: _by_name(CORRELATIONS) | None = None  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _some(self) -> Self:
        if self.sd is None and self.relative is None:
            raise missing(
                "sd",
                'write sd = NUMBER, sd = {lower = NUMBER, upper = NUMBER}, sd = "COLUMN", or '
                "relative = NUMBER",
            )
        return self


OBSERVATIONS: Kinds[ObservationModel] = Kinds(
    "aleator.observations",
    "kind",
    {"normal": NormalError, "student_t": StudentError},
    "normal",
    NoiseSection,
)
"""`[noise] kind = "..."`: the distribution of a measured outcome about the simulated outcome."""

OneNoise = Annotated[ChosenKind[ObservationModel], PlainValidator(OBSERVATIONS.read)]


def _form(value: Any) -> str:
    """Whether `[noise]` holds a table for each response, or the keys of one noise."""
    own = {*NoiseSection.model_fields, OBSERVATIONS.key}
    if not isinstance(value, Mapping) or not value or {*value} & own:
        return "one"
    return "each" if all(isinstance(one, Mapping) for one in value.values()) else "one"


NoiseChoice = Annotated[
    Annotated[OneNoise, Tag("one")] | Annotated[dict[str, OneNoise], Tag("each")],
    Discriminator(_form),
]
"""The type of `[noise]`: a table with the keys of a noise, or `[noise.RESPONSE]` for each."""


def scales_of(
    choice: ChosenKind[ObservationModel],
) -> tuple[Specification | str | None, Specification | None]:
    """The specifications of a noise's standard deviation and of its part relative to the outcome.

    Each is None if the section does not state it.
    """
    assert isinstance(choice.keys, NoiseSection)
    sd, relative = choice.keys.sd, choice.keys.relative
    return (
        sd if sd is None or isinstance(sd, str) else specification(sd),
        None if relative is None else specification(relative),
    )


def columns_of(noise: Noise | Mapping[str, Noise] | None) -> tuple[str, ...]:
    """The columns of the table that have standard deviations of the noise."""
    noises = noise.values() if isinstance(noise, Mapping) else [noise]
    return tuple(one.column for one in noises if one is not None and one.column is not None)


RULES: Kinds[Any] = Kinds(
    "aleator.cubatures",
    "rule",
    {
        "gauss": "aleator.laws.quadrature:TensorGauss",
        "smolyak": "aleator.laws.quadrature:Smolyak",
        "sobol": "aleator.laws.quadrature:SobolPoints",
        "monte_carlo": "aleator.laws.quadrature:MonteCarloPoints",
        "probability_grid": "aleator.laws.quadrature:ProbabilityGrid",
    },
)
"""`nodes = {rule = "sobol", points = 1024}`: the rule for nodes and weights of expectations."""


Nodes = Annotated[
    Annotated[int, Tag("number")]
    | Annotated[ChosenKind[Any], PlainValidator(RULES.read), Tag("table")],
    BY_FORM,
]


def response_surface(
    folder: Path,
    tolerance: float | None = None,
    max_runs: int = 1000,
    nodes: Nodes | None = None,
    surfaces: Surfaces | None = None,
    together: int | None = None,
) -> ResponseSurface:
    """Propagation by response surfaces, which replace the simulator, one for each experiment."""
    return ResponseSurface(
        tolerance=tolerance, max_runs=max_runs, nodes=_nodes(nodes, folder), surfaces=surfaces,
        together=together,
    )  # fmt: skip


def collocation(
    folder: Path,
    nodes: Nodes | None = None,
    moments: Literal["quadrature", "expansion"] = "quadrature",
    degree: int | None = None,
    fit: Literal["projection", "regression"] | None = None,
    terms: Literal["total_degree", "hyperbolic"] | None = None,
) -> Any:
    """Propagation by collocation: for every alpha the simulator runs at the nodes of the law.

    Raises StudyError for `terms` without `fit`, and for `fit` without `degree`.
    """
    from aleator.moments.expansion import Hyperbolic, IndexSet, TotalDegree
    from aleator.moments.projection import Projection, Regression
    from aleator.moments.propagation import Collocation

    if fit is None:
        if terms is not None:
            raise StudyError("terms has no meaning without fit", 'write fit = "regression"')
        return Collocation(nodes=_nodes(nodes, folder), moments=moments, degree=degree)
    if degree is None:
        raise StudyError(f'fit = "{fit}" lacks degree', "add degree = 2")
    kept: IndexSet = Hyperbolic(degree) if terms == "hyperbolic" else TotalDegree(degree)
    fits: dict[str, type[Projection] | type[Regression]] = {
        "projection": Projection,
        "regression": Regression,
    }
    return Collocation(nodes=_nodes(nodes, folder), moments=moments, fit=fits[fit](kept))


def _nodes(value: int | ChosenKind[Any] | None, folder: Path) -> Any:
    return value.build(folder) if isinstance(value, ChosenKind) else value


PROPAGATIONS: Kinds[Any] = Kinds(
    "aleator.propagations",
    "method",
    {"response_surface": response_surface, "collocation": collocation},
    "response_surface",
)
"""`[propagation] method = "..."`: how the law of the parameters becomes that of the outcome."""


ALL = "all"
"""The key of `[correlation]` with a list of parameters; every pair of them is correlated."""


def _paired(section: Any) -> Any:
    for name, value in section.items() if isinstance(section, Mapping) else ():
        if not isinstance(value, Mapping) and not (name == ALL and isinstance(value, list)):
            raise fault(
                f"{value!r} is not of a pair",
                'name both parameters: a.b = 0.5; or all of many: all = ["a", "b"]',
                name,
            )
    return section


Tied = Annotated[
    Annotated[dict[str, Spec], Tag("table")] | Annotated[list[str], Tag("list")],
    BY_FORM,
]
CorrelationSection = Annotated[dict[str, Tied], BeforeValidator(_paired)]
"""`[correlation]`: `a.b = {lower = -0.9, upper = 0.9}` correlates the parameters a and b."""


def pairs(section: CorrelationSection) -> dict[tuple[str, str], Specification]:
    """The specification of the correlation of each pair of parameters.

    The key `all` correlates every pair of a list; a pair with a key of its own follows that key.

    >>> from aleator.study.kinds import FreeSection
    >>> pairs({"a": {"b": 0.5, "c": FreeSection()}})
    {('a', 'b'): 0.5, ('a', 'c'): Free(lower=None, upper=None, start=None, prior=None)}
    """
    own = {
        (a, b): specification(s)
        for a, others in section.items() if isinstance(others, dict)
        for b, s in others.items()
    }  # fmt: skip
    tied = section.get(ALL)
    rest = full(tied) if isinstance(tied, list) else {}
    return own | {(a, b): s for (a, b), s in rest.items() if {(a, b), (b, a)}.isdisjoint(own)}


def automatic() -> None:
    """The default: no density by moments, but integrals over level sets or over parameters.

    A level set has all parameters for which the simulator gives the measured outcome.
    """


DENSITIES: Kinds[Any] = Kinds(
    "aleator.densities",
    "kind",
    {
        "automatic": automatic,
        "maximum_entropy": "aleator.moments.maximum_entropy:MaximumEntropy",
        "gaussian": "aleator.moments.densities:Gaussian",
    },
    "automatic",
)
"""`[density] kind = "..."`: how the density of the outcome is made, from moments or without."""

SEARCHES: Kinds[Search] = Kinds(
    "aleator.searches",
    "method",
    {
        "gradient": GradientMultistart,
        "genetic": GeneticAlgorithm,
        "differential_evolution": DifferentialEvolution,
        "cmaes": CMAES,
    },
    "gradient",
)
"""`[search] method = "..."`: how the log-likelihood is maximized."""


class VerificationSection(Section):
    """`[verification]`: runs of each row or series for the check on the simulator; 0 for none."""

    samples: int | None = None

    def build(self) -> Check:
        """The check of the identified law on the simulator itself."""
        return Check(self.samples)


class LikelihoodSection(Section):
    """`[likelihood]`: what is maximized, the likelihood or the restricted likelihood (REML)."""

    restricted: bool = False


class IntervalsSection(Section):
    """`[intervals]`: whether the ends of intervals are adjusted for few experiments."""

    small_sample: bool = False


Value = Annotated[
    Annotated[FiniteFloat, Tag("number")] | Annotated[str, Tag("text")],
    BY_FORM,
]
"""The type of the value of a condition: a number, or a text."""


class QuestionSection(Section):
    """`[[questions]]`: a question about a new experiment, which identify answers."""

    probability: str | None = None
    tolerance: Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)] | None = None
    at: dict[str, Value] = Field(default_factory=dict)
    side: Literal["both", "upper", "lower"] = "both"
    outcome: str | None = None
    noise: bool = True

    def build(self) -> OutcomeQuestion:
        """The question; InputsError unless it asks one thing."""
        asked = self.tolerance
        return OutcomeQuestion(
            probability=self.probability, tolerance=None if asked is None else (asked[0], asked[1]),
            at=self.at, side=self.side, outcome=self.outcome, noise=self.noise,
        )  # fmt: skip


class StudyFile(Section):
    """The whole of study.toml: its sections, with the defaults of those that it lacks."""

    title: str = ""
    seed: Annotated[int, Field(ge=0)] = 0
    experiments: ExperimentsSection
    simulator: Annotated[ChosenKind[Simulator], PlainValidator(SIMULATORS.read)]
    parameters: Annotated[
        dict[str, Annotated[ChosenKind[Law], PlainValidator(LAWS.read)]], Field(min_length=1)
    ]
    correlation: CorrelationSection = Field(default_factory=dict)
    derived: dict[str, str] = Field(default_factory=dict)
    noise: NoiseChoice | None = None
    propagation: Annotated[ChosenKind[Any], PlainValidator(PROPAGATIONS.read)] = PROPAGATIONS.read(
        {}
    )
    density: Annotated[ChosenKind[Any], PlainValidator(DENSITIES.read)] = DENSITIES.read({})
    search: Annotated[ChosenKind[Search], PlainValidator(SEARCHES.read)] = SEARCHES.read({})
    verification: VerificationSection = VerificationSection()
    likelihood: LikelihoodSection = LikelihoodSection()
    intervals: IntervalsSection = IntervalsSection()
    questions: list[QuestionSection] = Field(default_factory=list)
