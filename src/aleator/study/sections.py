"""The sections and keys of study.toml, each checked and made into the library's value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, PlainValidator, Tag

from aleator.inference.check import Check
from aleator.laws import Law, Specification
from aleator.laws.correlation import full
from aleator.search import (
    CMAES,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
    Search,
)
from aleator.simulators import Simulator
from aleator.study.kinds import ChosenKind, Kinds, Section, Spec, fault, specification
from aleator.study.sections import LAWS, PROPAGATIONS, ExperimentsSection, NoiseChoice
from aleator.study.simulators import SIMULATORS

ALL = "all"
"""The key of `[correlation]` that ties every pair of a list."""


def _paired(section: Any) -> Any:
    for name, value in section.items() if isinstance(section, Mapping) else ():
        if not isinstance(value, Mapping) and not (name == ALL and isinstance(value, list)):
            raise fault(
                f"{value!r} is not of a pair",
                'name both parameters: a.b = 0.5; or all of many: all = ["a", "b"]',
                name,
            )
    return section


def _is_list(value: Any) -> str:
    return "list" if isinstance(value, list) else "pair"


Tied = Annotated[
    Annotated[dict[str, Spec], Tag("pair")] | Annotated[list[str], Tag("list")],
    Discriminator(_is_list),
]
CorrelationSection = Annotated[dict[str, Tied], BeforeValidator(_paired)]
"""`[correlation]`: `a.b = {lower = -0.9, upper = 0.9}` ties the parameters a and b."""


def pairs(section: CorrelationSection) -> dict[tuple[str, str], Specification]:
    """The correlations by pair of parameters, as the library takes them.

    `all` ties every pair of a list; one with a key of its own is what that says.

    >>> from aleator.study.keys import FreeSection
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
    """No density of moments: the likelihood is exact, by level sets or an integral."""


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
"""`[density] kind = "..."`: the model of the outcome's density."""

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
    """`[verification]`: runs of each row or series for the check on the simulator; 0 is none."""

    samples: int | None = None

    def build(self) -> Check:
        """The library's choice."""
        return Check(self.samples)


class StudyFile(Section):
    """The whole of study.toml."""

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
