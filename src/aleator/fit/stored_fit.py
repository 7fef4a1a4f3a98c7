"""The fit of a stored answer, made again at its estimates: without a search, and without its runs.

An identification on response surfaces keeps these in the store of runs, under the estimates. With
them, and the same quadrature nodes, the likelihood is what it was. It is accepted only if the
experiments, the estimates and the log-likelihood are those of the answer.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np

from aleator.core.progress import Progress
from aleator.core.types import Array, Flags, Indices
from aleator.errors import AleatorError
from aleator.fit import outcome_range
from aleator.fit.quadrature import NODE_ACCURACY, AnyLikelihood, with_enough_nodes
from aleator.fit.question import Question, failing_observations
from aleator.fit.regions import first_region
from aleator.fit.uncertainty import informed
from aleator.inference.fit import Fit
from aleator.inference.likelihood_at import OutcomesAt
from aleator.laws.hyperparameter import has_prior, log_prior
from aleator.likelihood.individual import Direct, OnProcesses, OnSurfaces
from aleator.likelihood.level_sets.likelihood import BY_LEVEL_SETS
from aleator.likelihood.problem import Problem, prepare
from aleator.results.result import Result
from aleator.results.values import in_order
from aleator.simulators import Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.simulators.store import keep, kept
from aleator.surrogates.surface import Axes, Group, Surface


@dataclass(frozen=True)
class StoredFitSettings:
    """Settings of fits that are made again from a stored answer."""

    same: float = 1e-3
    """The difference of two log-likelihoods, relative to the number of experiments if these are
    more than ten, from which they are not of the same study. Quadrature nodes and rounding make
    1e-6 (`pytest tests/fit/test_stored_fit.py`). By judgement."""
    format: int = 1
    """The version of kept surfaces; it must be raised when their form changes."""


STORED_FIT = StoredFitSettings()

OTHER_STUDY = "identify again, or name the answer of this study"


@dataclass(frozen=True, eq=False)
class KeptSurfaces:
    """The response surfaces of an answer on a region (n, 2), and what they are of.

    `seen` (M,) marks the observations of the table that have a surface; `of` has its number for
    each of those.
    """

    surface: Surface
    region: Array
    of: Indices
    seen: Flags

    @classmethod
    def of_fit(cls, fit: Fit, seen: Flags) -> KeptSurfaces | None:
        """The surfaces of a fit; None without any, and where processes themselves are used."""
        at = fit.likelihood
        if isinstance(at, OutcomesAt):
            problem = at.problem
            if problem.surface is None:
                return None
            return cls(problem.surface, problem.region, problem.condition, seen)
        predictor = at.integral.predictor
        if isinstance(predictor, OnProcesses) or not isinstance(predictor, OnSurfaces):
            return None
        return cls(predictor.surface, predictor.region, predictor.of, seen)

    def text(self) -> str:
        """The surfaces as a text with all digits, which `read` takes."""
        surface = self.surface
        arrays = {each.name: getattr(surface, each.name) for each in fields(Surface)}
        axes, groups = arrays.pop("axes"), arrays.pop("groups")
        return json.dumps({
            "region": self.region.tolist(), "of": self.of.tolist(), "seen": self.seen.tolist(),
            "box": axes.box.tolist(), "axes": axes.logarithmic.tolist(),
            "groups": [[g.members.tolist(), g.coefficients.tolist()] for g in groups],
            "surface": {name: value.tolist() for name, value in arrays.items()},
        })  # fmt: skip

    @classmethod
    def read(cls, text: str) -> Self:
        """The surfaces that `text` describes."""
        known: dict[str, Any] = json.loads(text)
        whole = ("indices", "runs", "failed")
        flags = ("converged", "logarithmic")
        arrays = {
            name: np.array(
                value, dtype=np.intp if name in whole else bool if name in flags else np.float64
            )
            for name, value in known["surface"].items()
        }
        box = np.array(known["box"], dtype=np.float64)
        arrays["indices"] = arrays["indices"].reshape(-1, len(box))
        groups = tuple(
            Group(np.array(members, dtype=np.intp), np.array(coefficients, dtype=np.float64))
            for members, coefficients in known["groups"]
        )
        axes = Axes(box, np.array(known["axes"], dtype=bool))
        return cls(
            Surface(axes=axes, groups=groups, **arrays),
            np.array(known["region"], dtype=np.float64),
            np.array(known["of"], dtype=np.intp),
            np.array(known["seen"], dtype=bool),
        )


def keep_surfaces(found: Result, fit: Fit, seen: Flags, runner: Runner) -> None:
    """Keep the surfaces of an answer in the store of its runs, if there are both.

    `seen` (M,) marks the observations of the table that the fit has.
    """
    surfaces = KeptSurfaces.of_fit(fit, seen)
    if runner.cache is not None and surfaces is not None:
        key = _key(found)
        keep(runner.cache.store, runner.cache.identity.fingerprint, key, surfaces.text())


def _key(found: Result) -> str:
    """A hash of the estimates and of the log-likelihood of an answer."""
    values = {name: float(value) for name, value in found.values.items()}
    content = repr((STORED_FIT.format, values, found.log_likelihood.estimated))
    return f"surfaces {hashlib.sha256(content.encode()).hexdigest()}"


def stored_fit(found: Result, question: Question, progress: Progress) -> Fit:
    """The fit of an answer at its estimates.

    Raises AleatorError if the answer is of another study, with what differs, and if the surfaces of
    the answer are not in the store. Cost: the evaluations of the standard errors, some for each
    hyperparameter. A simulator that takes arrays is evaluated; no other run is made.
    """
    alpha = in_order(found.alpha, question.choices.hyperparameters)
    progress.stage("stored answer")
    question, likelihood, enough = _likelihood(found, question, progress)
    for what in _differences(found, question):
        raise AleatorError(f"the stored answer is of another study: {what}", OTHER_STUDY)
    end = with_enough_nodes(likelihood, alpha, enough)
    end, inference = informed(end)
    at, table = end.likelihood.adapted(alpha), question.table
    if isinstance(at, Problem):
        fit = Fit.of_outcomes(at, alpha, inference, table)
    else:
        assert end.coarse is not None
        fit = Fit.of_individuals(at, alpha, inference, table, end.coarse.rule)
    _require_same_value(found, fit)
    return fit


def _likelihood(
    found: Result, question: Question, progress: Progress
) -> tuple[Question, AnyLikelihood, float]:
    """The question, the likelihood of an answer, and the error left to quadrature nodes."""
    runner, inputs = question.runner, question.inputs
    if found.surface is None and found.density != BY_LEVEL_SETS and question.exact:
        raise _lost("it was computed by collocation")
    if found.surface is None and question.exact:
        return question, outcome_range.on_simulator(question, progress), NODE_ACCURACY.enough
    if found.surface is None:
        hyperparameters = question.choices.hyperparameters
        region = first_region(inputs, hyperparameters, len(question.ids))
        lost = failing_observations(runner, region, question.unit, question.column)
        question = question.without(lost)
        itself = Direct(runner, moving_parameters(inputs.box), inputs.box)
        return question, question.integral(itself), NODE_ACCURACY.enough
    if runner.cache is None:
        raise _lost("there is no store of runs")
    text = kept(runner.cache.store, runner.cache.identity.fingerprint, _key(found))
    if text is None:
        raise _lost("the store of runs has no surfaces of this answer and this simulator")
    known, progressive = KeptSurfaces.read(text), "estimates_error" in found.surface
    enough = NODE_ACCURACY.on_surfaces if progressive else NODE_ACCURACY.enough
    if known.seen.size != question.kept.size:
        raise AleatorError(
            f"the stored answer is of another study: {known.seen.size} observations, not "
            f"{question.kept.size}",
            OTHER_STUDY,
        )
    question = question.without(~known.seen[question.kept])
    if question.exact:
        made = prepare(
            runner, question.measured, question.choices.model, known.region, None, known.surface,
            question.bounds,
        )  # fmt: skip
        return question, made, enough
    return question, question.integral(OnSurfaces(known.surface, known.region, known.of)), enough


def _lost(why: str) -> AleatorError:
    return AleatorError(
        f"the surfaces of the stored answer are not known: {why}",
        "identify again: with a store no run is repeated",
    )


def _differences(found: Result, question: Question) -> Iterator[str]:
    """What of the experiments is not as in the answer, and the priors."""
    table, hyperparameters = question.table, question.choices.hyperparameters
    alpha = in_order(found.alpha, hyperparameters)
    ids = [each.id for each in found.experiments]
    if ids != [*table.ids]:
        other = sorted(set(ids) ^ set(table.ids)) or ["in another order"]
        yield f"its experiments are not those of the table ({', '.join(other[:3])})"
    seen, names = table.observations, [table.ids[k] for k in table.observations.experiment]
    if found.observations:
        lower = [-np.inf if each.lower is None else each.lower for each in found.observations]
        upper = [np.inf if each.upper is None else each.upper for each in found.observations]
    else:
        lower = upper = [each.outcome for each in found.experiments if hasattr(each, "outcome")]
    if len(lower) != len(seen):
        yield f"it has {len(lower)} measured values, the table {len(seen)}"
    else:
        off = (np.array(lower) != seen.lower) | (np.array(upper) != seen.upper)
        if off.any():
            yield f"the measured value of experiment '{names[int(np.argmax(off))]}' is another"
    prior = log_prior(hyperparameters, alpha) if has_prior(hyperparameters) else 0.0
    if not np.isclose(prior, found.log_likelihood.log_prior or 0.0):
        yield "its priors are others"


def _require_same_value(found: Result, fit: Fit, settings: StoredFitSettings = STORED_FIT) -> None:
    """Raise AleatorError unless the log-likelihood at the estimates is that of the answer."""
    told, value = found.log_likelihood.estimated, fit.likelihood.log_likelihood()
    if abs(value - told) <= settings.same * max(1.0, fit.count / 10.0):
        return
    raise AleatorError(
        f"the stored answer is of another study: its log-likelihood is {told:.6g}, and at the same "
        f"estimates it is {value:.6g} here. Laws, noise, conditions or the simulator are others",
        OTHER_STUDY,
    )
