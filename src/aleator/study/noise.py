"""`[noise]` of study.toml: the measurement error, or that of each response."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import Discriminator, FiniteFloat, PlainValidator, Tag, model_validator

from aleator.laws import Specification
from aleator.observations.errors import Noise
from aleator.observations.model import NormalError, ObservationModel, StudentError
from aleator.study.kinds import (
    ChosenKind,
    FreeSection,
    Kinds,
    Section,
    Spec,
    missing,
    specification,
)


def _kind(value: Any) -> str:
    if isinstance(value, str):
        return "text"
    return "table" if isinstance(value, (Mapping, FreeSection)) else "number"


Sd = Annotated[
    Annotated[FiniteFloat, Tag("number")]
    | Annotated[FreeSection, Tag("table")]
    | Annotated[str, Tag("text")],
    Discriminator(_kind),
]
"""A number, limits, or the column of known sds."""


class NoiseSection(Section):
    """Keys of every kind of noise."""

    sd: Sd | None = None
    relative: Spec | None = None

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
"""`[noise] kind = "..."`: how a measured outcome is distributed about the simulated one."""

OneNoise = Annotated[ChosenKind[ObservationModel], PlainValidator(OBSERVATIONS.read)]


def _form(value: Any) -> str:
    """Which: it is of responses where there is none of the keys of every kind, but tables only."""
    own = {*NoiseSection.model_fields, OBSERVATIONS.key}
    if not isinstance(value, Mapping) or not value or {*value} & own:
        return "one"
    return "each" if all(isinstance(one, Mapping) for one in value.values()) else "one"


NoiseChoice = Annotated[
    Annotated[OneNoise, Tag("one")] | Annotated[dict[str, OneNoise], Tag("each")],
    Discriminator(_form),
]
"""`[noise]` with its keys, or `[noise.RESPONSE]` for each response."""


def scales_of(
    choice: ChosenKind[ObservationModel],
) -> tuple[Specification | str | None, Specification | None]:
    """The sd and the relative part, as the library takes them."""
    assert isinstance(choice.keys, NoiseSection)
    sd, relative = choice.keys.sd, choice.keys.relative
    return (
        sd if sd is None or isinstance(sd, str) else specification(sd),
        None if relative is None else specification(relative),
    )


def columns_of(noise: Noise | Mapping[str, Noise] | None) -> tuple[str, ...]:
    """The columns of known sds, which are no conditions."""
    noises = noise.values() if isinstance(noise, Mapping) else [noise]
    return tuple(one.column for one in noises if one is not None and one.column is not None)
