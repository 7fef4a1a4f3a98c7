"""`[parameters.NAME]` of study.toml: the laws."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import PlainValidator
from scipy import stats

from aleator.errors import StudyError, nearest
from aleator.laws import (
    OPEN,
    Beta,
    Constant,
    Gamma,
    Law,
    LogNormal,
    Mixture,
    Normal,
    ScipyLaw,
    Specification,
    TruncatedNormal,
    Uniform,
)
from aleator.study.kinds import ChosenKind, Kinds, Section


def uniform(
    box: tuple[float, float] | None = None,
    mean: Specification | None = None,
    sd: Specification | None = None,
) -> Uniform:
    """A uniform law: known between the ends of a box, or identified by its mean and sd."""
    if box is None:
        return Uniform(OPEN if mean is None else mean, OPEN if sd is None else sd)
    if mean is not None or sd is not None:
        raise StudyError(
            "a uniform law has either a box, and is then known, or mean and sd",
            "delete box, or mean and sd",
        )
    return Uniform.between(*box)


def scipy_law(
    distribution: str,
    args: dict[str, float] | None = None,
    mean: Specification | None = None,
    sd: Specification | None = None,
) -> ScipyLaw:
    """A continuous distribution of scipy.stats, known or moved and scaled."""
    kind = getattr(stats, distribution, None)
    if not isinstance(kind, stats.rv_continuous):
        known = [
            name for name in dir(stats) if isinstance(getattr(stats, name), stats.rv_continuous)
        ]
        raise StudyError(
            f'distribution = "{distribution}": scipy.stats has no continuous '
            f"distribution of that name{nearest(distribution, known)}",
            'write its name in scipy.stats, such as distribution = "weibull_min"',
        )
    shapes = [name.strip() for name in (kind.shapes or "").split(",") if name.strip()]
    given = args or {}
    for name in given:
        if name not in (*shapes, "loc", "scale"):
            raise StudyError(
                f'args.{name}: "{distribution}" has no such argument',
                f"its arguments are {', '.join([*shapes, 'loc', 'scale'])}",
            )
    for name in shapes:
        if name not in given:
            raise StudyError(
                f'args.{name} is missing: "{distribution}" needs it',
                f"write args = {{{name} = ...}}",
            )
    return ScipyLaw(kind(**given), mean, sd)


def _of_component(value: Any) -> ChosenKind[Law]:
    return LAWS.read(value)


def mixture(
    components: tuple[Annotated[ChosenKind[Law], PlainValidator(_of_component)], ...],
    shares: tuple[Specification, ...] | None = None,
    folder: Path = Path(),
) -> Mixture:
    """A mixture of laws, each a table of its own."""
    return Mixture(tuple(component.build(folder) for component in components), shares)


class LawSection(Section):
    """Keys of every law: `unit` is that of the parameter, shown on axes and in tables."""

    unit: str = ""


LAWS: Kinds[Law] = Kinds(
    "aleator.laws",
    "law",
    {
        "truncated_normal": TruncatedNormal,
        "normal": Normal,
        "uniform": uniform,
        "beta": Beta,
        "gamma": Gamma,
        "lognormal": LogNormal,
        "scipy": scipy_law,
        "mixture": mixture,
        "constant": Constant,
    },
    common=LawSection,
)
"""`law = "..."`: the laws of a parameter."""
