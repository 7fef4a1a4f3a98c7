"""The arguments of the tasks as a user may write them: tables, laws, noise, settings."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real
from pathlib import Path
from typing import Any

import pandas as pd

from aleator.errors import AleatorError, ExperimentsError, InputsError, described
from aleator.laws import Free
from aleator.laws.inputs import Inputs
from aleator.laws.law import Law
from aleator.observations.experiments import Conditions, Experiments
from aleator.observations.noise import Noise
from aleator.observations.responses import responses_of

Columns = Mapping[str, Any]
"""Columns of a table by name: lists of one length, or single values that hold in every row."""
RequestedConditions = Conditions | pd.DataFrame | Columns | None
"""Where something is predicted: a table of conditions, or None for those of the experiments."""
Laws = Inputs | Mapping[str, Law]
"""The laws of the parameters; a mapping stands for `Inputs` of independent parameters."""
OneNoise = Noise | float | Free
"""The noise of an outcome; a number or limits are the sd of normal errors."""
AnyNoise = OneNoise | Mapping[str, OneNoise] | None
"""The noise of the only outcome, or of each outcome by name; None for exact outcomes."""


def frame_of(table: object, what: str) -> pd.DataFrame:
    """The data frame that a user gives as a data frame, or as a mapping of columns.

    Raises ExperimentsError for anything else, with the call that makes a data frame of it.

    >>> frame_of({"force": [10.0, 20.0], "oil": "a"}, "at")["oil"].tolist()
    ['a', 'a']
    >>> frame_of("springs.parquet", "experiments")
    Traceback (most recent call last):
    aleator.errors.ExperimentsError: experiments: 'springs.parquet' is a text, not a table
      Remedy: write pandas.read_parquet('springs.parquet')
    """
    if isinstance(table, pd.DataFrame):
        return table
    if isinstance(table, Mapping):
        # A mapping of single values is one row.
        single = all(isinstance(v, str) or not hasattr(v, "__len__") for v in table.values())
        try:
            return pd.DataFrame(dict(table), index=[0] if single else None)
        except ValueError as error:
            raise ExperimentsError(
                f"{what}: the columns are no table: {error}",
                "give each name one value, or lists of one length",
            ) from None
    if isinstance(table, str | Path):
        reader = {".parquet": "read_parquet", ".xlsx": "read_excel", ".xlsm": "read_excel"}
        read = reader.get(Path(table).suffix.lower(), "read_csv")
        raise ExperimentsError(
            f"{what}: '{table}' is a text, not a table", f"write pandas.{read}('{table}')"
        )
    if hasattr(table, "to_pandas"):
        remedy = "write table.to_pandas()"
    elif isinstance(table, pd.Series):
        remedy = "write column.to_frame(), with the columns of the conditions beside it"
    elif isinstance(table, list | tuple) and table and isinstance(table[0], Mapping):
        remedy = "write pandas.DataFrame(rows)"
    else:
        remedy = "name the columns: {'force': [10.0, 20.0], ...}, or a pandas.DataFrame of them"
    raise ExperimentsError(f"{what}: {described(table)} is no table with named columns", remedy)


def conditions_in(
    table: Conditions | pd.DataFrame | Columns, what: str, noise: object
) -> Conditions:
    """The conditions that a user gives as `Conditions` or as a table.

    If the `noise` is a mapping by outcome, a table has these outcomes.
    """
    if isinstance(table, Conditions):
        return table
    named = responses_of([*noise]) if isinstance(noise, Mapping) else ()
    return Conditions.from_frame(frame_of(table, what), responses=named)


def experiments_of(
    table: object, outcome: str | list[str] | tuple[str, ...] | None, id: str | None
) -> Experiments:
    """The experiments that a user gives as `Experiments`, or as a table with its columns named.

    Raises ExperimentsError for another table, and InputsError where the name of the outcome is
    missing, or stands beside `Experiments`, which have one.
    """
    if isinstance(table, Experiments):
        if outcome is not None or id is not None:
            raise InputsError(
                f"{'outcome' if outcome is not None else 'id'} is given beside Experiments, which "
                "have it",
                "leave it out, or give the data frame",
            )
        return table
    frame = frame_of(table, "experiments")
    names = [outcome] if isinstance(outcome, str) else outcome
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        wrong = "the name of the outcome is missing" if names is None else (
            f"the outcome is {described(names)}, not the name of a column"
        )  # fmt: skip
        raise InputsError(
            f"identify: {wrong}",
            f'write outcome="{frame.columns[-1]}", if that column holds the measured outcome',
        )
    return Experiments.from_frame(frame, outcome=names, id=id)


def inputs_of(laws: object) -> Inputs:
    """The inputs that a user gives as `Inputs`, or as a mapping from parameters to laws.

    >>> from aleator.laws import Normal
    >>> inputs_of({"stiffness": Normal(2.0, 0.1)}).names
    ('stiffness',)
    """
    if isinstance(laws, Inputs):
        return laws
    if isinstance(laws, Mapping) and not isinstance(laws, pd.DataFrame):
        return Inputs(laws)
    raise InputsError(
        f"the inputs are {described(laws)}, not the laws of the parameters by name",
        'write {"stiffness": Normal(mean=Free(1.0, 3.0), sd=Free(0.01, 1.0))}, or Inputs(...) '
        "with correlations and levels",
    )


def noise_of(noise: object) -> Noise | dict[str, Noise] | None:
    """The noise that a user gives as `Noise`, a number, limits, or a mapping of these by outcome.

    >>> noise_of(0.1) == Noise(0.1), noise_of(None)
    (True, None)
    """
    if noise is None or isinstance(noise, Noise):
        return noise
    if isinstance(noise, Mapping):
        return {str(name): _one_noise(each) for name, each in noise.items()}
    return _one_noise(noise)


def _one_noise(noise: object) -> Noise:
    if isinstance(noise, Noise):
        return noise
    if isinstance(noise, Free) or (isinstance(noise, Real) and not isinstance(noise, bool)):
        return Noise(noise if isinstance(noise, Free) else float(noise))
    raise InputsError(
        f"the noise is {described(noise)}, not the standard deviation of the measurement error",
        "write noise=0.1 if it is known, noise=Free(0.01, 1.0) to identify it, or Noise(...)",
    )


def require_kind(
    value: object, kind: type | tuple[type, ...] | str, name: str, example: str
) -> None:
    """Check that an argument is of its kind, before anything is computed.

    `kind` is a type, or the name of an attribute that the value must have. Raises AleatorError with
    an example of what to write.

    >>> require_kind("cmaes", "maximize", "search", "CMAES()")
    Traceback (most recent call last):
    aleator.errors.AleatorError: search is 'cmaes'
      Remedy: write search=CMAES()
    """
    if isinstance(kind, str):
        right = hasattr(value, kind) and not isinstance(value, type)
    else:
        right = isinstance(value, kind) and not isinstance(value, bool)
    if not right:
        raise AleatorError(f"{name} is {described(value)}", f"write {name}={example}")
