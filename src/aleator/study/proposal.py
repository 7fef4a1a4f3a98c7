"""The proposal of a first study, from a table, a simulator and what the user states about them."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np

from aleator.core.toml_text import key
from aleator.errors import ExperimentsError, SimulatorError, nearest
from aleator.observations.gross_errors import odd_repeats, slips
from aleator.observations.outcomes import Censoring
from aleator.observations.tables import Table
from aleator.study.offers import Offer, SimulatorInput, same_name
from aleator.study.roles import (
    TIMES,
    Roles,
    Sheet,
    censoring_of,
    conditions_each,
    count_of,
    covariates_in,
    decades_of,
    is_measured,
    levels_in,
    numbers_of,
    roles_in,
    shows_bounds,
    spread_of,
    unread_cells,
    varies_within,
)

Limits = tuple[float, float]


@dataclass(frozen=True)
class ProposalRules:
    """Settings of a proposed study. tests/test_cli_new.py chose the values on published tables.

    factor: the range of a parameter reaches from its nominal value divided by this factor to its
    nominal value times the factor. experiments: the number of experiments that each proposed law
    needs; half as many suffice if experiments have several rows. most: the largest number of laws.
    alike: two names at least this similar (0 to 1) may be misspellings of each other. spans: an
    outcome over so many decades gets a remark on its logarithm. log: over so many decades the
    logarithm is proposed. noise: the two limits of the noise, in standard deviations of all
    measured values (it is 1 if no parameter scatters). assumed: the noise that is proposed where it
    has to be known beforehand, also in standard deviations of all measured values.
    """

    factor: float = 3.0
    experiments: int = 10
    most: int = 3
    alike: float = 0.8
    spans: float = 2.0
    log: float = 3.0
    noise: tuple[float, float] = (1e-3, 2.0)
    assumed: float = 0.01


RULES = ProposalRules()


@dataclass(frozen=True)
class Proposed:
    """A proposed parameter: it `scatters` within `limits`, or is a constant with a `value`.

    The user has to fill in limits or a value of None. `nominal` is the value from which the limits
    were proposed; it is None if the user stated the limits.
    """

    input: SimulatorInput
    scatters: bool
    limits: Limits | None = None
    value: float | None = None
    nominal: float | None = None

    @property
    def name(self) -> str:
        """The name of the proposed parameter."""
        return self.input.name

    @property
    def complete(self) -> bool:
        """Whether the proposal has the limits or the value, so that the user need not add them."""
        return self.limits is not None or (not self.scatters and self.value is not None)


def parameters_of(
    offer: Offer,
    roles: Roles,
    most: int,
    told: int,
    chosen: Mapping[str, Limits | float | None],
) -> tuple[tuple[Proposed, ...], tuple[SimulatorInput, ...]]:
    """The proposed parameters, and the inputs that keep their value in the simulator.

    `chosen` has the parameters that the user named: one with limits scatters between them, one with
    None scatters about its nominal value, and one with a number is a constant. If the user named
    none to scatter, the inputs without a default do, but not more than `most`. If there are none,
    those with a nominal value do, but not more than the `told` values of an experiment, those of
    other outcomes or under other conditions: one value tells of one parameter. Other inputs without
    a default are constants. Raises SimulatorError for a name that the simulator does not take.
    """
    free = [each for each in offer.inputs if each.name not in roles.conditions]
    known = {each.name for each in free}
    for name in chosen:
        if name not in known:
            raise SimulatorError(
                f"the simulator takes no parameter '{name}'{nearest(name, known)}",
                f"it takes {', '.join(sorted(known)) or 'no parameter'}",
            )
    laws = [name for name, value in chosen.items() if not isinstance(value, float)]
    left = [each for each in free if each.name not in chosen]
    laws = laws or [each.name for each in _scattering(left, most, told)]
    taken = [each for each in free if each.name in (*laws, *chosen) or each.required]
    if not taken:
        raise SimulatorError(
            "nothing is left to be identified: every argument of the simulator is a column",
            "give it an argument for each unknown parameter, or leave a column out",
        )
    return (
        tuple(_proposed(each, each.name in laws, chosen.get(each.name)) for each in taken),
        tuple(each for each in free if each not in taken),
    )


def laws_for(experiments: int, rows: int) -> int:
    """The largest number of laws that is proposed for a table of so many experiments and rows.

    >>> laws_for(10, 10), laws_for(18, 180), laws_for(108, 108)
    (1, 3, 3)
    """
    each = RULES.experiments if experiments == rows else RULES.experiments // 2
    return min(max(experiments // each, 1), RULES.most)


def nominal_limits(of: SimulatorInput) -> Limits | None:
    """Limits of a factor of three about the nominal value, within the limits that an FMU states.

    >>> nominal_limits(SimulatorInput("stiffness", 2.0))
    (0.67, 6.0)
    """
    if not of.nominal:
        return None
    ends = (of.nominal / RULES.factor, of.nominal * RULES.factor)
    low, high = sorted(float(f"{end:.2g}") for end in ends)
    low = low if of.lower is None else max(low, of.lower)
    high = high if of.upper is None else min(high, of.upper)
    return (low, high) if low < high else None


def _scattering(free: Sequence[SimulatorInput], most: int, told: int) -> list[SimulatorInput]:
    """The inputs that are proposed to scatter: those without a default, or else with limits.

    Of an FMU the parameters come before inputs and start values.
    """
    required = [each for each in free if each.required]
    if required:
        return required[:most]
    known = [each for each in free if nominal_limits(each)] or [*free]
    own = [each for each in known if each.parameter] or known
    return own[: min(most, told)]


def _proposed(given: SimulatorInput, scatters: bool, asked: Limits | float | None) -> Proposed:
    if not scatters:
        return Proposed(given, False, value=asked if isinstance(asked, float) else given.nominal)
    if isinstance(asked, tuple):
        return Proposed(given, True, asked)
    return Proposed(given, True, nominal_limits(given), nominal=given.nominal)


@dataclass(frozen=True)
class Proposal:
    """The contents of a proposed study file.

    `parameters` are in the order of the simulator's inputs; `untouched` inputs keep the value that
    they have in the simulator. `noise` has for each outcome the limits of its standard deviation,
    or the name of a column with standard deviations, or an assumed number where it must be known;
    it is empty if nothing tells it from the law. `stated` says that the number is the user's,
    and `relative` that it is a share of the simulated value. `decades` are the outcomes that span
    several decades. `log` says that there is one outcome and that its logarithm is used. `units`
    are read from the heads of columns and the FMU. `censored` has the rules of censoring for each
    outcome. `covariates` maps columns on which a law may depend to their terms in a formula.
    `levels` are the columns whose groups of experiments may share a draw of a parameter. `series`
    says that one call of the simulator serves all rows of an experiment; `within` are the
    conditions that vary between these rows. `returned` is the FMU's variable that is the outcome,
    `time` the column with the times of the FMU's simulation.
    """

    title: str
    file: str
    sheet: Sheet
    outcomes: tuple[str, ...]
    id: str | None
    roles: Roles
    experiments: int
    offer: Offer
    parameters: tuple[Proposed, ...]
    untouched: tuple[SimulatorInput, ...]
    noise: Mapping[str, Limits | str | float]
    decades: tuple[str, ...]
    log: bool
    units: Mapping[str, str]
    censored: Mapping[str, Censoring]
    covariates: Mapping[str, str]
    levels: tuple[str, ...]
    within: tuple[str, ...]
    series: bool
    returned: str | None
    time: str | None
    stated: bool = False
    relative: bool = False

    @property
    def repeated(self) -> bool:
        """Whether an experiment has several rows."""
        return self.experiments < len(self.sheet.table)

    @property
    def assumed(self) -> dict[str, float]:
        """The noise of outcomes whose standard deviation neither the user nor the table states."""
        known = {name: sd for name, sd in self.noise.items() if isinstance(sd, float)}
        return {} if self.stated else known

    @property
    def positive(self) -> bool:
        """Whether all measured values are positive, as those of lives."""
        every = [numbers_of(self.sheet.table, name) for name in self.outcomes]
        return all(one is not None and bool(np.nanmin(one) > 0.0) for one in every)

    @property
    def unread(self) -> dict[str, str]:
        """For each outcome with cells that are no numbers, their count, texts and first rows."""
        found = {name: unread_cells(self.sheet.table, name) for name in self.outcomes}
        return {name: cells for name, cells in found.items() if cells}

    @property
    def gross_errors(self) -> list[str]:
        """The measured values that look like slips of the pen, in words: row, value, what fits."""
        table = self.sheet.table
        every = {name: numbers_of(table, name) for name in self.outcomes}
        return [
            str(slip)
            for name, values in every.items() if values is not None
            for slip in slips(table.places, name, values)
        ]  # fmt: skip

    @property
    def odd_repeats(self) -> list[str]:
        """The experiments with another number of rows than all the others, in words."""
        table = self.sheet.table
        return odd_repeats(table.texts(self.id), table.places) if self.id else []

    @property
    def conditions(self) -> tuple[str, ...]:
        """The columns that are inputs of the simulator, including times of a simulation."""
        return self.roles.conditions

    @property
    def incomplete(self) -> tuple[str, ...]:
        """The keys of the file that the user must fill in before the study can run."""
        lacking = [f"parameters.{p.name}" for p in self.parameters if not p.complete]
        if self.offer.kind == "fmu" and self.returned is None:
            lacking.insert(0, "simulator.outcome")
        return tuple(lacking)


def responses_of(sheet: Sheet, offer: Offer) -> tuple[str, ...]:
    """The columns that are named as the responses of a function; empty if fewer than two are."""
    possible = roles_in(sheet.table, offer.names).outcomes
    called = tuple(one.name for one in offer.returned if one.name in possible)
    return called if offer.kind == "function" and len(called) > 1 else ()


def outcome_of(sheet: Sheet, offer: Offer) -> tuple[str | None, tuple[str, ...]]:
    """The column that seems to be the outcome, or None, and all columns that could be the outcome.

    The outcome is the only column that the simulator does not take and that has the name of the
    function or of an output of the FMU. Else it is the only one that has numbers, or of several the
    only one with cells such as "> 20".
    """
    possible = roles_in(sheet.table, offer.names).outcomes
    named = [each.name for each in offer.returned]
    left = [name for name in sheet.names if name not in offer.names]
    called = [name for name in left if name in named] or [
        name for name in left if any(same_name(name, one) for one in named)
    ]
    bounded = [name for name in possible if shows_bounds(sheet.table, name)]
    found = next((one for one in (called, bounded) if len(one) == 1), possible)
    return (found[0] if len(found) == 1 else None), possible


def roles_of(sheet: Sheet, offer: Offer, outcomes: Sequence[str]) -> Roles:
    """The roles of all columns of a table whose outcomes are known.

    Raises ExperimentsError for an outcome that is no column, or is an input of the simulator.
    """
    for name in outcomes:
        sheet.table.require(name, "the outcome")
        if name in offer.names and offer.kind != "fmu":
            raise ExperimentsError(
                f"the simulator takes '{name}': it cannot be the outcome",
                f"the outcome is what it returns; it takes {', '.join(offer.names)}",
            )
    times = _time(sheet, offer, outcomes)
    return roles_in(sheet.table, (*offer.names, *((times,) if times else ())), outcomes)


def misspelt(sheet: Sheet, offer: Offer, roles: Roles, used: Sequence[str | None]) -> list[str]:
    """Notes on unused columns with a name similar to an input of the simulator.

    If such a column is this input, what was measured would be taken for an unknown parameter.
    """
    taken = {name.lower(): name for name in offer.names if name not in roles.conditions}
    left = [name for name in sheet.names if name not in (*roles.conditions, *used)]
    near = {name: get_close_matches(name.lower(), taken, n=1, cutoff=RULES.alike) for name in left}
    return [
        f"the column '{name}' is not used; if it is the simulator's '{taken[found[0]]}', call it "
        "so in the table and begin again: else that is an unknown parameter"
        for name, found in near.items() if found
    ]  # fmt: skip


def proposed(
    sheet: Sheet,
    file: str,
    title: str,
    offer: Offer,
    outcomes: Sequence[str],
    id: str | None,
    chosen: Mapping[str, Limits | float | None],
    series: bool = False,
) -> Proposal:
    """The proposal for a table and a simulator; `file` is the name of the table in the study.

    `series` says that the simulator takes all rows of an experiment at once; for a function that
    uses conditions as arrays this is recognized. `chosen` has the parameters that the user named
    (see `parameters_of`).

    Raises ExperimentsError for a name that is no column, and SimulatorError for a name that is no
    input of the simulator.
    """
    if id is not None:
        sheet.table.require(id, "the id")
    roles = roles_of(sheet, offer, outcomes)
    experiments = count_of(sheet.table, id)
    most = laws_for(experiments, len(sheet.table))
    each = conditions_each(sheet.table, roles.conditions, id) * len(outcomes)
    parameters, untouched = parameters_of(offer, roles, most, each, chosen)
    decades = {name: decades_of(sheet.table, name) for name in outcomes}
    log = len(decades) == 1 and decades[outcomes[0]] >= RULES.log and not roles.errors
    spread = {name: spread_of(sheet.table, name, log=log) for name in outcomes}
    spread = {name: one for name, one in spread.items() if math.isfinite(one) and one > 0.0}
    bounds = {name: censoring_of(sheet.table, name, roles.others) for name in outcomes}
    censored = {name: one for name, one in bounds.items() if one is not None}
    telling = {name for one in censored.values() for name in one.columns}
    left = [name for name in roles.others if name not in telling]
    within = tuple(name for name in roles.conditions if varies_within(sheet.table, name, id))
    noise: dict[str, Limits | str | float] = {}
    laws = sum(each.scatters for each in parameters)
    if experiments < len(sheet.table) or _needs_noise(sheet.table, outcomes, laws):
        noise = {name: noise_limits(one) for name, one in spread.items()}
    elif censored and len(outcomes) > 1:
        noise = {name: _rounded(RULES.assumed * one, math.floor) for name, one in spread.items()}
    if len(roles.errors) == 1 and len(outcomes) == 1:
        noise = {outcomes[0]: roles.errors[0]}
    return Proposal(
        title, file, sheet, tuple(outcomes), id, roles, experiments, offer, parameters, untouched,
        noise, tuple(n for n in outcomes if decades[n] >= RULES.spans), log,
        _units(sheet.table, roles, outcomes, parameters),
        censored, covariates_in(sheet.table, left, id), levels_in(sheet.table, left, id), within,
        series or bool(offer.arrays & {*within}),
        _returned(offer, outcomes), _time(sheet, offer, outcomes),
    )  # fmt: skip


def with_noise(proposal: Proposal, sd: float, *, relative: bool = False) -> Proposal:
    """The proposal with the standard deviation `sd` of the measurement error that the user knows.

    It is that of the logarithm if a logarithm is proposed. A `relative` one is a share of the
    simulated value, which is the same of a logarithm, and holds for each outcome. Raises
    ExperimentsError for one that is not, with several outcomes: each has an error of its own.
    """
    if len(proposal.outcomes) > 1 and not relative:
        tables = ", ".join(f"[noise.{key(name)}]" for name in proposal.outcomes)
        raise ExperimentsError(
            f"one measurement error is given, and there are {len(proposal.outcomes)} outcomes",
            f"leave it out and write sd into {tables} of the study file, or give a share of the "
            "values, such as 1%, which is taken for each",
        )
    share = relative and not proposal.log
    noise = dict.fromkeys(proposal.outcomes, sd)
    return replace(proposal, noise=noise, stated=True, relative=share)


def _needs_noise(table: Table, outcomes: Sequence[str], laws: int) -> bool:
    """Whether several outcomes of an experiment have no density without noise.

    They have none if they are more than the parameters that scatter, or if a cell is blank.
    """
    return len(outcomes) > 1 and (len(outcomes) > laws or not is_measured(table, outcomes).all())


def noise_limits(spread: float) -> Limits:
    """Rounded limits of the noise, from the standard deviation `spread` of all measured values.

    They are a thousandth of `spread` and twice `spread`.

    >>> noise_limits(3.73)
    (0.003, 8.0)
    """
    return _rounded(RULES.noise[0] * spread, math.floor), _rounded(
        RULES.noise[1] * spread, math.ceil
    )


def _rounded(value: float, whole: Callable[[float], int]) -> float:
    unit = 10.0 ** math.floor(math.log10(value))
    return float(f"{whole(value / unit) * unit:.6g}")


def _units(
    table: Table, roles: Roles, outcomes: Sequence[str], parameters: Sequence[Proposed]
) -> dict[str, str]:
    heads = {name: table.units.get(name, "") for name in (*outcomes, *roles.conditions)}
    own = {each.name: each.input.unit for each in parameters}
    return {name: unit for name, unit in {**heads, **own}.items() if unit}


def _returned(offer: Offer, outcomes: Sequence[str]) -> str | None:
    """The FMU's variable with the name of the outcome, or its only output; else None."""
    names = [each.name for each in offer.returned]
    wanted = {name.lower() for name in outcomes}
    for name in names:
        if {name.lower(), name.rpartition(".")[2].lower()} & wanted:
            return name
    return names[0] if len(names) == 1 else None


def _time(sheet: Sheet, offer: Offer, taken: Sequence[str]) -> str | None:
    """The column with the times of an FMU's simulation; None if there is none.

    A column with the name of a variable of the FMU is a condition.
    """
    wanted = [name for name in sheet.names if name in TIMES and name not in (*offer.names, *taken)]
    return wanted[0] if offer.kind == "fmu" and wanted else None


def require_outcome(outcome: str | None, possible: Sequence[str]) -> str:
    """The outcome; raises ExperimentsError if it is None, because several columns, or none, fit."""
    if outcome is not None:
        return outcome
    if not possible:
        raise ExperimentsError(
            "no column is left for the outcome: the simulator takes every column of numbers",
            "add the measured column, or say which it is with --outcome",
        )
    raise ExperimentsError(
        f"nothing says which column is the outcome: {', '.join(possible)}",
        f"--outcome {shlex.quote(possible[-1])}, or another of these; or several, each with "
        "--outcome",
    )
