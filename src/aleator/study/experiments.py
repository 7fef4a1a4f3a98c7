"""`[experiments]` of study.toml: the table, and what its columns are."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from aleator.observations import tables as files
from aleator.observations.experiments import Experiments
from aleator.observations.outcomes import Censored, Censoring
from aleator.observations.responses import Transform
from aleator.study.kinds import Section, fault, in_toml, missing

TransformName = Annotated[Transform, Field(strict=False)]


def _words(value: Any) -> Any:
    """A word or a number in place of a list of them."""
    return value if isinstance(value, list) else [value]


def _one(value: Any) -> Any:
    """Not several: these are another key."""
    if isinstance(value, list):
        raise fault(f"{in_toml(value)} is a list", f"write outcomes = {in_toml(value)}")
    return value


Words = Annotated[
    list[str | int], BeforeValidator(_words, json_schema_input_type=list[str | int] | str | int)
]


class CensoringSection(Section):
    """`censored = {column = "status", right = ["Runout"]}`: of which values there are bounds."""

    column: str | None = None
    right: Words = Field(default_factory=list)
    left: Words = Field(default_factory=list)
    upper: str | None = None
    measured: Words = Field(default_factory=list)
    signs: bool = False

    def build(self) -> Censoring:
        """The library's choice."""
        return Censoring(**self.given())


def _of_each(value: Any) -> str:
    """Whether a table is of responses, and not of the keys of one."""
    keys = {*CensoringSection.model_fields}
    return "each" if isinstance(value, Mapping) and value and not {*value} & keys else "one"


def _is_table(value: Any) -> str:
    return "each" if isinstance(value, Mapping) else "one"


class ExperimentsSection(Section):
    """`[experiments]`: the table, and what its columns are."""

    file: str
    outcome: Annotated[str | None, BeforeValidator(_one)] = None
    outcomes: list[str] | None = None
    response: str | None = None
    id: str | None = None
    conditions: list[str] | None = None
    transform: Annotated[
        Annotated[TransformName, Tag("one")] | Annotated[dict[str, TransformName], Tag("each")],
        Discriminator(_is_table),
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
        """The table; columns `beside` are no conditions unless they are named.

        Raises ExperimentsError as Experiments.from_csv does.
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
        """The units of columns: those of `units` before those in the heads of the table."""
        heads = files.stated_units(folder / self.file, self.delimiter)
        return {**heads, **self.units}

    def censoring(self) -> Censored:
        """The library's choices; raises ExperimentsError for keys that say nothing together."""
        if isinstance(self.censored, CensoringSection):
            return self.censored.build()
        if self.censored is None:
            return None
        return {name: one.build() for name, one in self.censored.items()}
