"""The verdict "sound": whether a result is computed reliably, and the warnings to its reader."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aleator.core.types import Array, Flags
from aleator.fit.emulate import Emulation
from aleator.fit.flow import Answer
from aleator.fit.quadrature import AnyLikelihood, Maximum
from aleator.fit.rounds import EMULATION, EmulatorError, stalled
from aleator.inference import diagnostics
from aleator.inference import surface_diagnostics as on_surfaces
from aleator.inference.identifiability import exchanged, identifiability_warnings, left_open
from aleator.inference.small_sample import unadjusted_warnings
from aleator.inference.surface_diagnostics import BUDGET
from aleator.likelihood.individual import IndividualLikelihood, OnSurfaces
from aleator.likelihood.individual.rules import standard_points
from aleator.likelihood.problem import Problem
from aleator.observations.experiments import Experiments
from aleator.results.printed import listed
from aleator.results.values import Diagnostic
from aleator.search.interface import Hill, LogLikelihood, hills_of
from aleator.simulators import FunctionSimulator, Runner
from aleator.simulators.response_functions import moving_parameters

EMULATOR = "emulator"
NONE = EmulatorError(0.0, 0.0, 1.0, np.zeros(0))


def emulator_refusals(emulation: Emulation) -> list[Diagnostic]:
    """A refusal where Gaussian processes in place of the simulator leave the estimates unknown."""
    error = emulation.error
    if error.alpha <= EMULATION.unknown and not error.doubted:
        return []
    if emulation.question.runner.account.refused:
        return [_ended_early(emulation)]
    runs = f"after {len(emulation.processes.x):,} runs "
    if error.doubted:
        said = f"{runs}{_contradicted(error)}, so that the errors it tells are too small"
    else:
        said = (
            f"{runs}the emulator of the simulator is so inexact that the estimates may be off by "
            f"{error.alpha:.2g} standard errors"
        )
    return [Diagnostic(EMULATOR, said, "; ".join(_better(emulation)))]


def _better(emulation: Emulation) -> Iterator[str]:
    """What may help an emulator that was given up, the most helpful first."""
    runner = emulation.question.runner
    if isinstance(runner.simulator, FunctionSimulator):
        yield "let the function take arrays, and not say vectorized = false: it needs no emulator"
    names, limits = emulation.question.inputs.names, emulation.start
    narrower = [
        f"{names[k]} (from {limits[k, 0]:.3g} to {limits[k, 1]:.3g}; the runs lead to "
        f"{emulation.region[k, 0]:.3g} to {emulation.region[k, 1]:.3g}, which may be wrong)"
        for k in moving_parameters(limits).tolist()
        if np.ptp(emulation.region[k]) < EMULATION.narrower * np.ptp(limits[k])
    ]
    if narrower:
        yield f"narrow the limits of {listed(narrower)} to what you know"
    yield "see whether the outcome has a jump or a kink, and narrow the box to one side of it"
    if _exhausted(emulation):
        yield f"allow more runs (max_runs); {_kept(runner)}"


def _exhausted(emulation: Emulation) -> int:
    """The largest number of runs of a condition, if one has had them; else zero."""
    choice = emulation.question.choices.surfaces
    if choice is None or emulation.processes.made.max() < choice.max_runs:
        return 0
    return choice.max_runs


def _kept(runner: Runner) -> str:
    """What happens to the runs when the same identification is made once more."""
    if runner.cache is None:
        return "without a store (Runner(..., store=Store(...)) in Python) all are made again"
    return "give the same command again: the runs are kept"


def emulator_warnings(emulation: Emulation) -> list[Diagnostic]:
    """Warnings where the rounds of runs ended early, and where derivatives were wrong."""
    error, found = emulation.error, list[Diagnostic]()
    if emulation.processes.contradicted:
        found.append(
            Diagnostic(
                EMULATOR,
                "the derivatives that the simulator gives contradict its values: new values were "
                "expected better without them, and they are not used any more",
                "hold them against differences of the values, or leave out jac",
            )
        )
    if not (error.enough(len(emulation.question.ids)) or emulator_refusals(emulation)):
        found.append(_ended_early(emulation))
    return found


def _ended_early(emulation: Emulation) -> Diagnostic:
    """What the rounds have left unknown, and how many runs are expected to be enough."""
    error, account = emulation.error, emulation.question.runner.account
    whole = emulation.expected_runs(EMULATION.enough)
    enough = f" (some {whole:,.0f} in all are expected to do)" if np.isfinite(whole) else ""
    remedy = f"allow more runs{enough}; {_kept(emulation.question.runner)}"
    ended = "the largest number of rounds ended the runs"
    if account.refused:
        ended = f"the budget of {account.budget} ended the runs"
    elif stalled(emulation.told, emulation.maxima, emulation.settings):
        ended = "the runs ended because more of them did not make the emulator more exact"
        remedy = "; ".join(_better(emulation))
    elif most := _exhausted(emulation):
        ended = f"max_runs = {most} ended the runs"
    doubt = f"; {_contradicted(error)}, so that this is too small" if error.doubted else ""
    return Diagnostic(
        BUDGET if account.refused else EMULATOR,
        f"{ended}: the emulator of the simulator moves the estimates by about "
        f"{error.alpha:.2g} standard errors, and the log-likelihood by {error.log_likelihood:.2g}"
        f"{doubt}",
        remedy,
    )


def _contradicted(error: EmulatorError) -> str:
    """How far the last runs lay from what the processes expected, in words."""
    return (
        f"the last runs lay {error.surprise:.2g} standard deviations of the emulator from what it "
        "expected"
    )


@dataclass(frozen=True, eq=False)
class Reviewed:
    """The verdict on a result: the refusals that make it unsound, and other warnings."""

    answer: Answer
    table: Experiments

    @property
    def sound(self) -> bool:
        """Whether there are no refusals, so that the result is computed reliably."""
        return not self._refusals

    @cached_property
    def emulator_refusal(self) -> list[Diagnostic]:
        """The refusal of an emulator; what follows from its numbers is then not told."""
        emulation = self.answer.inferred.refined.emulation
        return [] if emulation is None else emulator_refusals(emulation)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The hyperparameters whose values the experiments leave open, by name.

        Those whose 95 % interval reaches from limit to limit (see `left_open`), and those by which
        another maximum differs that is as high (see `Rival.as_high`), and sds of which each may be
        zero but not both (see `exchanged`).
        """
        inferred, hyperparameters = self.answer.inferred, self._likelihood.hyperparameters
        wide = left_open(hyperparameters, inferred.inference, inferred.profile)
        moved = (k for rival in inferred.rivals if rival.as_high for k in rival.moved)
        instead = exchanged(self._end.alpha, hyperparameters, inferred.inference, inferred.profile)
        return tuple(hyperparameters[k].name for k in sorted({*wide, *moved, *instead}))

    @cached_property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """All diagnostics of the result: refusals first, then other warnings."""
        return (*self._refusals, *self._notes)

    @cached_property
    def at(self) -> LogLikelihood:
        """The log-likelihood at the estimate; minus infinity for an outcome without density."""
        likelihood, alpha = self._likelihood, self._end.alpha
        honest = likelihood.likelihood if isinstance(likelihood, Problem) else likelihood
        return honest.evaluate(alpha)

    @cached_property
    def exact(self) -> LogLikelihood | None:
        """The exact log-likelihood by level sets, if the user chose densities by moments.

        None otherwise.
        """
        problem = self._likelihood
        return (
            on_surfaces.exact_density(problem, self._end.alpha)
            if isinstance(problem, Problem)
            else None
        )

    @cached_property
    def by_cells(self) -> Array:
        """The changes (2, N) of log-densities by the last two refinements of the level sets."""
        problem = self._likelihood
        if not isinstance(problem, Problem):
            return np.zeros((2, problem.count))
        return on_surfaces.by_finer_cells(problem, self._end.alpha)

    @cached_property
    def hills(self) -> tuple[Hill, ...]:
        """The maxima that the search met, the best first, each with the starts that ended there."""
        inferred = self.answer.inferred
        scores = self._likelihood(self._end.alpha).scores
        return hills_of(inferred.search_result, scores, inferred.inference.identified)

    @property
    def surface_error(self) -> Array:
        """The relative error (M,) of the surface near each observation; NaN without a check."""
        checked = self.answer.checked
        unknown = np.full(len(self._seen.observations), np.nan)
        return unknown if checked is None else checked.relative

    @property
    def _end(self) -> Maximum:
        return self.answer.inferred.maximum

    @property
    def _likelihood(self) -> AnyLikelihood:
        return self._end.likelihood

    @property
    def _seen(self) -> Experiments:
        """The experiments, without the observations whose simulator runs all fail."""
        return self.answer.inferred.refined.question.table

    @property
    def emulated(self) -> EmulatorError:
        """The error that Gaussian processes cause; zero without them."""
        emulation = self.answer.inferred.refined.emulation
        return NONE if emulation is None else emulation.error

    @cached_property
    def _refusals(self) -> list[Diagnostic]:
        ids, of = self._seen.ids, self._seen.observations.experiment
        likelihood, checked = self._likelihood, self.answer.checked
        searched = diagnostics.search_refusals(
            self.answer.inferred.inference, likelihood.hyperparameters
        )
        found = [
            *self.emulator_refusal,
            *diagnostics.density_refusals(self.at, ids),
            *([] if self.emulator_refusal else searched),
            *diagnostics.node_warnings(self._end.gap, diagnostics.EXPERIMENTS.gap),
        ]
        if checked is not None:
            found += on_surfaces.check_refusals(checked.total, checked.standard_error)
        emulation = self.answer.inferred.refined.emulation
        if emulation is None and isinstance(likelihood, Problem):
            found += on_surfaces.useless(likelihood, checked, self.surface_error, ids)
        if not isinstance(likelihood, Problem):
            found += diagnostics.without_surfaces(self._lost, of, ids)
        if checked is not None and not any(one.about == on_surfaces.SUBJECT for one in found):
            found += on_surfaces.worse_than_estimated(
                checked, self._estimated, [ids[l] for l in of.tolist()]
            )
        found += on_surfaces.doubt_refusals(self.answer.doubt, ids) + on_surfaces.level_refusals(
            self.by_cells, ids
        )
        if isinstance(likelihood, Problem):
            found += on_surfaces.unreached_refusals(likelihood, self._end.alpha, ids)
        return found

    @cached_property
    def _notes(self) -> list[Diagnostic]:
        inferred, ids, likelihood = self.answer.inferred, self._seen.ids, self._likelihood
        inference, profile = inferred.inference, inferred.profile
        hyperparameters, runner = likelihood.hyperparameters, inferred.refined.question.runner
        made, exact = inferred.refined.surfaces, isinstance(likelihood, Problem)
        notes = [
            *diagnostics.count_warnings(
                len(ids), inference, adjusted=profile.unadjusted is not None
            ),
            *diagnostics.group_warnings(likelihood.inputs, hyperparameters, inference),
        ]
        notes += (
            []
            if self.emulator_refusal
            else [
                *diagnostics.once_warnings(inferred.search_result, self.hills),
                *diagnostics.bound_warnings(hyperparameters, inference, profile),
                *unadjusted_warnings(hyperparameters, profile),
                *identifiability_warnings(inference, hyperparameters, profile),
                *self._centering,
                *diagnostics.rival_warnings(inferred.rivals, hyperparameters, profile.intervals),
                *on_surfaces.level_warnings(self.by_cells),
            ]
        )
        emulation = inferred.refined.emulation
        if emulation is not None:
            notes += emulator_warnings(emulation)
        if isinstance(likelihood, Problem):
            if emulation is None:
                notes += on_surfaces.surface_warnings(likelihood, self.surface_error, ids)
            if not self._refusals:
                notes += on_surfaces.density_notes(self.exact, inference, likelihood)
        else:
            notes += self._of_individuals(likelihood)
            if not self._refusals:
                notes += diagnostics.node_warnings(self._end.gap, diagnostics.EXPERIMENTS.noted_gap)
        if made or emulation or exact:
            notes += diagnostics.failure_warnings(diagnostics.failure_report(runner))
        against = "the outcome's scatter" if exact else "the noise"
        notes += on_surfaces.budget_warnings(runner.account, made, against)
        if made is not None and (self._refusals or made.broken):
            notes += on_surfaces.step_warnings(made, likelihood.inputs)
        return notes

    def _of_individuals(self, likelihood: IndividualLikelihood) -> list[Diagnostic]:
        """Warnings about failing or missing data, and about covariates that push laws to limits."""
        ids, alpha, model = self._seen.ids, self._end.alpha, likelihood.inputs.covariate_model
        failing = failing_share(likelihood, alpha)
        return [
            *diagnostics.limit_warnings({} if model is None else model.on_limits(alpha), ids),
            *diagnostics.review_data(
                self.table.observations, self._seen.observations, failing, ids
            ),
        ]

    @property
    def _centering(self) -> list[Diagnostic]:
        """Advice to centre a condition, if one parameter acts like another times this condition.

        It is based on the slopes of the simulator at the medians of the parameters.
        """
        certain, seen = self.answer.inferred, self._seen.observations
        likelihood, alpha = certain.maximum.likelihood, certain.maximum.alpha
        inputs = likelihood.inputs
        conditions = self._seen.conditions.iloc[seen.row]
        if isinstance(likelihood, Problem):
            if not likelihood.free:
                # With collocation the slopes would need further simulator runs.
                return []
            middle = inputs.marginal(alpha, np.full((1, len(inputs.names)), 0.5))[0]
            slopes = likelihood.at_point(middle)[1]
        elif len(inputs.classes) > 1:
            return []
        else:
            slopes = np.empty((len(seen), len(inputs.names)))
            for block in likelihood.blocks:
                at = likelihood.at(alpha, block, np.zeros((len(block), 1, inputs.scattering)))
                slopes[block.rows] = at.slopes[:, :, 0].T
        return diagnostics.centering_advice(
            slopes, inputs, likelihood.hyperparameters, certain.inference, conditions
        )

    @property
    def _estimated(self) -> Array:
        likelihood = self.answer.inferred.maximum.likelihood
        if isinstance(likelihood, Problem):
            assert likelihood.surface is not None
            return likelihood.surface.error[likelihood.condition]
        predictor = likelihood.predictor
        assert isinstance(predictor, OnSurfaces)
        return predictor.surface.error[predictor.of]

    @property
    def _lost(self) -> Flags:
        """Which observations (M,) have no surface because too few simulator runs succeeded."""
        if self.answer.inferred.refined.direct:
            return np.zeros(len(self._seen.observations), dtype=np.bool_)
        return np.asarray(np.isinf(self._estimated))


def failing_share(likelihood: IndividualLikelihood, alpha: Array, points: int = 64) -> Array:
    """The probability (N,) that a run fails at parameters drawn from each experiment's law.

    It is estimated with `points` quasi-random draws of each law.
    """
    inputs, found = likelihood.inputs, np.zeros(likelihood.count)
    theta = standard_points(points, inputs.scattering)
    for block in likelihood.layout.blocks(points):
        xi = np.tile(theta, (len(block), len(inputs.classes), 1))
        with np.errstate(all="ignore"):
            law = inputs.individual(alpha[: inputs.size], xi, block.experiments)
            none = np.isnan(likelihood.predictor.values(block, law.x))
        failed = block.summed(none.astype(float)) > 0.0
        weights = np.exp(law.log_weight) / len(theta)
        found[block.experiments] = np.sum(failed * weights, axis=1)
    return found
