"""The units of a study: those of its file, and where it says none those of an FMU."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from aleator.observations.experiments import Experiments
from aleator.results.units import checked_units
from aleator.simulators import Simulator
from aleator.simulators.derived import Derived
from aleator.simulators.fmu import FMUSimulator
from aleator.study.sections import LawSection, StudyFile


def units_of(
    file: StudyFile, folder: Path, table: Experiments, simulator: Simulator
) -> Mapping[str, str]:
    """The unit of each outcome, condition and parameter that has one.

    Raises InputsError for a unit of what is no column.
    """
    columns = [*table.observations.names, *map(str, table.table.columns)]
    checked_units(file.experiments.units, columns)
    stated = file.experiments.stated_units(folder)
    own = {name: unit.strip() for name, unit in stated.items() if name in columns and unit.strip()}
    for name, choice in file.parameters.items():
        if isinstance(choice.keys, LawSection) and choice.keys.unit.strip():
            own[name] = choice.keys.unit.strip()
    asked = (*columns, *file.parameters)
    return {**_of_fmu(simulator, table.observations.names, asked), **own}


def _of_fmu(
    simulator: Simulator, responses: tuple[str, ...], names: tuple[str, ...]
) -> Mapping[str, str]:
    """What the variables of an FMU say; empty for every other simulator."""
    inner = simulator.inner if isinstance(simulator, Derived) else simulator
    return inner.units(responses, names) if isinstance(inner, FMUSimulator) else {}
