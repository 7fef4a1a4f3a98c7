"""Questions to the user, each with a default; none where nobody sits at a terminal."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import click

from aleator.errors import AleatorError


def at_terminal() -> bool:
    """Whether somebody can answer."""
    return sys.stdin.isatty()


@dataclass(frozen=True)
class Questions:
    """`asked` or answered by their defaults."""

    asked: bool

    def text(self, question: str, default: str | None, missing: AleatorError) -> str:
        """A text; raises `missing` where there is no default and nobody to ask."""
        if self.asked:
            return str(click.prompt(question, default=default, err=True)).strip()
        if default is None:
            raise missing
        return default

    def one_of(
        self, question: str, known: Sequence[str], default: str | None, missing: AleatorError
    ) -> str:
        """One of the known names; asked again until it is."""
        if not self.asked:
            return self.text(question, default, missing)
        choice = click.Choice([*known])
        return str(click.prompt(question, default=default, type=choice, err=True))

    def names(self, question: str, known: Sequence[str], default: Sequence[str]) -> list[str]:
        """Some of the known names, separated by commas."""
        if not self.asked:
            return [*default]

        def read(answer: str) -> list[str]:
            names = [name.strip() for name in answer.split(",") if name.strip()]
            if wrong := [name for name in names if name not in known]:
                raise click.BadParameter(f"'{wrong[0]}' is none of {', '.join(known)}")
            return names

        shown = ", ".join(default)
        found: list[str] = click.prompt(question, default=shown, value_proc=read, err=True)
        return found

    def limits(
        self, question: str, default: tuple[float, float] | None
    ) -> tuple[float, float] | None:
        """Two numbers; None where nothing is known and nothing is said."""
        if not self.asked:
            return default
        shown = "" if default is None else f"{default[0]:g} {default[1]:g}"
        found: tuple[float, float] | None = click.prompt(
            question, default=shown, value_proc=_limits, err=True, show_default=bool(shown)
        )
        return found

    def number(self, question: str) -> float | None:
        """A number; None where nobody knows it."""
        if not self.asked:
            return None
        found: float | None = click.prompt(
            question, default="", value_proc=_number, err=True, show_default=False
        )
        return found

    def agreed(self, question: str) -> bool:
        """Whether the user says yes; no where nobody is asked."""
        return self.asked and click.confirm(question, default=False, err=True)


def _limits(answer: str) -> tuple[float, float] | None:
    if not answer.strip():
        return None
    try:
        low, high = (float(part) for part in answer.replace(":", " ").split())
    except ValueError:
        raise click.BadParameter("write two numbers, such as 1.0 3.0") from None
    if not low < high:
        raise click.BadParameter(f"{low:g} is not below {high:g}")
    return low, high


def _number(answer: str) -> float | None:
    try:
        return float(answer) if answer.strip() else None
    except ValueError:
        raise click.BadParameter("write a number, or nothing") from None
