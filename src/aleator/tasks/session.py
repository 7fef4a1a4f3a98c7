"""The session of an identification: its model, simulator and fit, kept for further tasks."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aleator.core.progress import Progress
from aleator.core.status import Status
from aleator.core.types import Array
from aleator.errors import AleatorError, InputsError, SimulatorError, nearest
from aleator.fit.question import DEFAULT_PROPAGATION, Choices, first_rule, varying_conditions
from aleator.fit.refine import under_law
from aleator.fit.regions import draws, plausible_alphas
from aleator.fit.stored_fit import stored_fit
from aleator.inference.alpha_draws import AlphaDraws
from aleator.inference.fit import Fit
from aleator.inference.likelihood_at import IndividualsAt
from aleator.inference.outcome_event import OutcomeEvent
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import (
    GaussHermite,
    IndividualLikelihood,
    Layout,
    LevelRule,
    Predictor,
)
from aleator.likelihood.level_sets.likelihood import BY_LEVEL_SETS
from aleator.likelihood.model import Model
from aleator.observations.errors import MeasurementErrors, noise_hyperparameters
from aleator.observations.experiments import (
    Conditions,
    Experiments,
    conditions_at,
    covariates,
    first_rows,
    unmeasured,
)
from aleator.observations.noise import Noise, noise_columns
from aleator.observations.responses import Response, Transform, with_limits_of_test
from aleator.results.law import JointLaw
from aleator.results.result import Result
from aleator.results.values import Estimate, in_order
from aleator.simulators import Runner, Simulator, as_runner
from aleator.simulators.parameter import ParameterItself
from aleator.surrogates import ResponseSurface
from aleator.tasks.arguments import RequestedConditions, frame_of
from aleator.tasks.new_experiments import (
    MeasuredExperiments,
    PredictionContext,
    local_surfaces,
    simulator_itself,
)
from aleator.tasks.prediction import Draws, in_rows, scales, tabled

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation

DIRECT = "direct"
"""The name of the propagation method in a result where the simulator itself was integrated over."""

SAME = "id"
"""The value of `of` that means: new rows belong to the measured experiments with the same ids."""

Runners = Callable[[Experiments | Conditions], Runner]
"""The type of a function that returns the runner of a simulator for a table of conditions."""


@dataclass(frozen=True, eq=False)
class Session:
    """The parts of an identification: laws, noise, experiments, simulator, and the fit.

    Missing parts are None. An identification that was read from a file has only the parts passed to
    `load`, and never the fit. `runner` makes the runner of a table. Without noise, `model` says how
    the density of an outcome is computed. `on_simulator` is true if the simulator itself is
    evaluated; otherwise response surfaces are made with the settings `surfaces`. Laws that depend
    on covariates have the covariates of the experiments.
    """

    inputs: Inputs | None = None
    noise: Noise | Mapping[str, Noise] | None = None
    responses: tuple[Response, ...] = ()
    experiments: Experiments | None = None
    runner: Runners | None = None
    fit: Fit | None = None
    on_simulator: bool = False
    surfaces: ResponseSurface = DEFAULT_PROPAGATION
    model: Model | None = None
    refit: Callable[[Progress], Fit] | None = None

    @classmethod
    def again(
        cls,
        found: Result,
        source: object,
        inputs: Inputs,
        noise: Noise | Mapping[str, Noise] | None,
        experiments: Experiments | None,
        propagation: ResponseSurface | Collocation,
        density: Density | None,
        runner: Runners | None,
    ) -> Session:
        """The session of a result read from the file `source`, from the arguments of `load`.

        Raises AleatorError if noise or experiments are missing that the result needs. Raises
        InputsError for noise if the identification had none.
        """
        refit = None
        if runner is not None and experiments is not None:
            refit = partial(
                _refit, found, (inputs, noise, propagation, density), experiments, runner
            )
        seen = tuple(Response(name, Transform(each)) for name, each in found.responses.items())
        if not found.observations or found.density == BY_LEVEL_SETS:
            if noise is not None:
                raise InputsError(
                    f"{source} was identified from exact outcomes, without noise",
                    "leave the noise out",
                )
            model = Model.of(inputs, propagation, density)
            surfaces = model.surfaces or ResponseSurface()
            responses = seen or (Response(found.outcome, found.transform),)
            direct = bool(seen) and found.propagation == DIRECT
            return cls(
                inputs, None, responses, experiments, runner, None, direct, surfaces, model, refit
            )  # fmt: skip
        made = inputs.regressed and inputs.covariate_model is None
        unresolved = made or (bool(inputs.levels) and inputs.grouping is None)
        if noise is None or (experiments is None and unresolved):
            lacking = "noise" if noise is None else "experiments, whose columns the laws follow,"
            raise AleatorError(
                f"what can be asked of {source} needs the {lacking} too",
                f"aleator.load(path, ..., {'noise' if noise is None else 'experiments'}=...)",
            )
        if experiments is not None and unresolved:
            inputs = inputs.resolved(covariates(experiments, inputs.columns))
        surfaces = propagation if isinstance(propagation, ResponseSurface) else ResponseSurface()
        on_simulator = found.propagation == DIRECT
        return cls(
            inputs, noise, seen, experiments, runner, None, on_simulator, surfaces, refit=refit
        )

    def with_fit(self, progress: Progress) -> Session:
        """The session with its fit, which is made again if the answer was stored (`stored_fit`).

        Raises AleatorError if the answer was read without simulator or experiments, or is of
        another study, or its surfaces are not in the store.
        """
        if self.fit is not None:
            return self
        if self.refit is None:
            raise missing(
                "this needs the likelihood of the experiments",
                "aleator.load(path, simulator=..., inputs=..., noise=..., experiments=...)",
            )
        return replace(self, fit=self.refit(progress))

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters, those of the laws first; empty if there are no inputs."""
        if self.inputs is None:
            return ()
        own = noise_hyperparameters(self.noise, self.outcomes)
        return (*self.inputs.hyperparameters, *own)

    @property
    def outcomes(self) -> tuple[str, ...]:
        """The names of the outcomes."""
        return tuple(response.name for response in self.responses)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the parameters; empty if there are no inputs."""
        return () if self.inputs is None else tuple(self.inputs.names)

    def law(
        self,
        values: Mapping[str, float | Estimate],
        at: Mapping[str, object] | pd.Series | None = None,
    ) -> JointLaw:
        """The joint law of the parameters at these values of the hyperparameters.

        `at` has the covariates of the experiment; they are needed only if a law depends on some.
        """
        inputs = self.inputs
        if inputs is None:
            raise missing("the law needs the inputs", "aleator.load(path, inputs=...)")
        alpha = in_order(values, self.hyperparameters)[: inputs.size]
        if not inputs.regressed:
            return JointLaw(inputs, alpha)
        if at is None:
            raise InputsError(
                f"the law follows {', '.join(inputs.covariates)}: experiments have laws of "
                "their own",
                f"say of which: found.law_at({{'{inputs.covariates[0]}': ...}})",
            )
        row = pd.DataFrame([dict(at)], index=["asked"])
        one, own = inputs.resolved(row).of_experiment(alpha, 0)
        return JointLaw(one, own)

    def log_likelihood(
        self, alpha: Mapping[str, float] | ArrayLike, values: Mapping[str, float | Estimate]
    ) -> float:
        """The log-likelihood at alpha, with quadrature nodes adapted to it.

        Hyperparameters that `alpha` does not name have their `values`. At the estimate the nodes
        are those of the identification, so that the reported log-likelihood is reproduced.
        """
        here = kept(self.fit).likelihood
        at = alpha_from(alpha, values, here.hyperparameters)
        return (here if np.array_equal(at, here.alpha) else here.at(at)).log_likelihood()

    def predict(
        self,
        at: RequestedConditions,
        plausible: AlphaDraws,
        quantiles: tuple[float, ...],
        progress: Progress | None,
        of: str | None = None,
        noise: bool = True,
    ) -> pd.DataFrame:
        """The table of `Identification.predict` under plausible alphas, or the estimate alone.

        Without noise, with one outcome and under the estimate alone, it is computed from the
        density of the outcome.
        """
        context = self.context(at, plausible.estimate, of, noise)
        if progress is not None:
            progress.stage("prediction")
        alone = self.model is not None and context.conditions.simple and len(self.responses) == 1
        if self.model is None or not alone or not plausible.certain:
            return tabled(context, plausible, quantiles, progress)
        return _by_density(context, self.model, plausible.estimate, quantiles, progress)

    def context(
        self, at: RequestedConditions, alpha: Array, of: str | None = None, noise: bool = True
    ) -> PredictionContext:
        """The context for predicting new experiments, or further values of measured ones.

        `of` is the name of a measured experiment or of a column with such names; None for new ones.
        """
        noises = self.noise.values() if isinstance(self.noise, Mapping) else [self.noise]
        if of is not None and noise and any(n and n.correlation for n in noises):
            raise InputsError(
                f"of '{of}': further errors of this experiment hang together with those that were "
                "measured, and their law given these is not computed",
                "predict without the errors (noise=False, --no-noise), or predict new experiments",
            )
        conditions = self.requested(at, of)
        errors = MeasurementErrors.of(self.noise, conditions) if noise and self.noise else None
        runner = self.runner_on(conditions, "a prediction")
        return self._context(conditions, runner, errors, alpha, of)

    def event(self, sentence: str, units: Mapping[str, str]) -> OutcomeEvent:
        """The event that a sentence states of an outcome or of a parameter; see `OutcomeEvent`."""
        return OutcomeEvent.of(sentence, self.outcomes, units, self.parameters)

    def event_context(
        self,
        event: OutcomeEvent,
        at: RequestedConditions,
        alpha: Array,
        of: str | None = None,
        noise: bool = True,
    ) -> PredictionContext:
        """The context for the probability of an event, as `context` has it for an outcome.

        An event of a parameter needs no run: the parameter is its own outcome, without noise.
        """
        if event.outcome in self.outcomes:
            return self.context(at, alpha, of, noise)
        once = self.event_conditions(event, at, of)
        runner = Runner(ParameterItself(event.outcome), once, self.parameters)
        return replace(self._context(once, runner, None, alpha, of), on_simulator=True)

    def event_conditions(
        self, event: OutcomeEvent, at: RequestedConditions, of: str | None = None
    ) -> Conditions:
        """The conditions that `at` gives for an event, as `requested` has them for an outcome.

        An event of a parameter has one row for each experiment. Of the conditions only those that
        its law follows matter.
        """
        if event.outcome in self.outcomes:
            return self.requested(at, of)
        seen, itself = (Response(event.outcome),), ParameterItself(event.outcome)
        at = {} if at is None and self.experiments is None else at
        own = replace(self, noise=None, responses=seen, runner=runners(itself, self.parameters))
        return first_rows(own.requested(at, of), seen)

    def _context(
        self,
        conditions: Conditions,
        runner: Runner,
        errors: MeasurementErrors | None,
        alpha: Array,
        of: str | None,
    ) -> PredictionContext:
        if of is not None and self.model is not None:
            raise InputsError(
                f"of '{of}': without noise the parameters of an experiment have no density",
                "predict new experiments: leave `of` out",
            )
        inputs = self.inputs
        assert inputs is not None
        known = None if of is None else self._measured(conditions, alpha, of)
        if inputs.individual_laws and known is None:
            inputs, known = self._of_groups(conditions, alpha)
        return PredictionContext(
            conditions, inputs, errors, runner, self.on_simulator, self.surfaces, known,
            self.experiments,
        )  # fmt: skip

    def requested(self, at: RequestedConditions, of: str | None = None) -> Conditions:
        """The conditions that `at` gives; for None those of the experiments.

        Raises InputsError for a name in a mapping that is no column of the experiments, and
        ExperimentsError for a text where the experiments have numbers.
        """
        if isinstance(at, Conditions):
            return at
        table = self.experiments
        if table is None or self.runner is None:
            if at is None or self.runner is None:
                raise missing(
                    "a prediction needs the simulator and the inputs"
                    if self.runner is None
                    else "a prediction without `at` needs the experiments",
                    "aleator.load(path, simulator=..., inputs=..., noise=..., experiments=...)",
                )
            if isinstance(at, Mapping) and not at:
                return self._runnable()
            return Conditions.from_frame(frame_of(at, "at"), responses=self.responses)
        taken = self.runner(table).used_conditions
        if at is None:
            assert self.inputs is not None
            columns = [*taken, *self.inputs.columns, *noise_columns(self.noise)]
            return conditions_at(table, of, dict.fromkeys(columns))
        covariates = self.inputs.covariates if self.inputs else ()
        if isinstance(at, Mapping) and not at:
            needed = [*dict.fromkeys([*taken, *covariates, *noise_columns(self.noise)])]
            if not needed:
                return self._runnable()
            raise InputsError(
                "at: no condition has a value",
                f"give {', '.join(needed)}: at={{'{needed[0]}': ...}}",
            )
        frame = frame_of(at, "at")
        if isinstance(at, Mapping):
            _require_known(
                at, [*table.table.columns, *([table.id] if table.id else [])], covariates
            )
        asked = Conditions.from_frame(
            frame,
            id=table.id if table.id in frame else None,
            conditions=[name for name in taken if name in frame],
            numbers=[name for name in taken if table.conditions[name].dtype != object],
            responses=self.responses,
        )
        absent = [name for name in taken if name not in frame]
        return self._runnable(asked, absent) if absent else asked

    def _runnable(self, asked: Conditions | None = None, absent: Sequence[str] = ()) -> Conditions:
        """New experiments, by default one; InputsError if the simulator takes what is `absent`."""
        assert self.runner is not None
        if asked is None:
            asked = Conditions(("1",), pd.DataFrame(index=[0]), responses=self.responses)
        try:
            self.runner(asked)
        except SimulatorError as error:
            names = ", ".join(absent)
            raise InputsError(
                f"at: no value of {names or 'any condition'}; {error.problem}",
                f"give {names or 'them'}: at={{'{absent[0] if absent else 'name'}': ...}}",
            ) from None
        return asked

    def exact_fit(self) -> Fit | None:
        """The fit with the simulator itself in place of the response surfaces; it makes runs.

        None if there are no surfaces, and without noise, where it is not available.
        """
        fit, runner, table = self.fit, self.runner, self.experiments
        if self.on_simulator or fit is None or runner is None or table is None:
            return None
        here = fit.likelihood
        if not isinstance(here, IndividualsAt):
            return None
        return replace(fit, likelihood=here.on(runner(table)))

    def runner_on(self, conditions: Conditions, what: str = "this") -> Runner:
        """The runner for other experiments, which makes runs as in the identification.

        Raises AleatorError, about the task `what`, if there is no simulator.
        """
        if self.runner is None:
            raise missing(
                f"{what} needs the simulator and the inputs",
                "aleator.load(path, simulator=..., inputs=..., noise=...)",
            )
        return self.runner(conditions)

    def fit_on(
        self, candidates: Conditions, alpha: Array, runner: Runner, progress: Progress
    ) -> Fit:
        """The fit of candidate experiments at alpha (K,), whose outcomes are unknown.

        Its methods `drawn` and `seeing` add outcomes; the limits of measurement are those of the
        measured experiments. If response surfaces are needed, runs are made for them, with the
        accuracy of a prediction.
        """
        fit, table = kept(self.fit), unmeasured(candidates)
        if self.model is not None:
            ready = under_law(runner, self.model, alpha, progress)
            limited = with_limits_of_test(table.observations, fit.table.observations)
            problem = ready.with_outcomes(limited.numbers, limited.bounds)
            table = table.with_observations(limited)
            return Fit.of_outcomes(problem, alpha, fit.inference, table)
        assert isinstance(fit.likelihood, IndividualsAt)
        assert self.inputs is not None
        runner.progress = progress
        inputs, seen = self.inputs, candidates.observations
        if inputs.individual_laws:
            self._require_new_groups(candidates)
            inputs = inputs.resolved(_columns(candidates, inputs))
        table = table.with_observations(with_limits_of_test(seen, fit.table.observations))
        likely = plausible_alphas(fit.alpha, fit.inference, fit.hyperparameters)
        x = draws(inputs, [alpha, *likely], len(candidates.ids))
        # Candidate experiments have as many quadrature nodes as the identification needed.
        rule, made = fit.likelihood.integral.rule, self._integral(inputs, table, runner, x, 1)
        if isinstance(rule, LevelRule) and inputs.grouping is not None:
            rule = rule.on(inputs.grouping)
        likelihood = replace(made, rule=rule)
        return Fit.of_individuals(likelihood, alpha, fit.inference, table, fit.likelihood.fewest)

    def _require_new_groups(self, candidates: Conditions) -> None:
        """Raise InputsError where a candidate belongs to a group that was measured."""
        assert self.experiments is not None
        assert self.inputs is not None
        for level in self.inputs.levels.values():
            if level not in candidates.table.columns:
                continue
            known = {_text(cell) for cell in self.experiments.table[level]}
            for name, cell in covariates(candidates, [level])[level].items():
                if _text(cell) in known:
                    raise InputsError(
                        f"candidate '{name}' is of the {level} '{_text(cell)}', which was "
                        "measured, and what it adds depends on the measured ones",
                        f"let candidates be of new groups: give the column '{level}' other names",
                    )

    def _integral(
        self, inputs: Inputs, table: Experiments, runner: Runner, x: Array, nodes: int
    ) -> IndividualLikelihood:
        """The likelihood of a table, on the simulator or on surfaces accurate at points (D, n)."""
        assert self.noise is not None
        return IndividualLikelihood.of(
            inputs,
            MeasurementErrors.of(self.noise, table),
            self._predictor(runner, x),
            Layout(
                len(table.ids),
                table.observations.experiment,
                runner.unit,
                runner.column,
                grouping=inputs.grouping,
            ),
            GaussHermite(nodes) if inputs.grouping is None else first_rule(inputs),
        )

    def _predictor(self, runner: Runner, x: Array) -> Predictor:
        assert self.inputs is not None
        box = self.inputs.box
        if not self.on_simulator:
            return local_surfaces(runner, box, x, self.surfaces)
        return simulator_itself(runner, box, np.stack([x.min(axis=0), x.max(axis=0)], axis=1))

    def _measured(self, conditions: Conditions, alpha: Array, of: str) -> MeasuredExperiments:
        table = self.experiments
        if table is None:
            raise missing(
                f"of '{of}': that needs the experiments that were measured",
                "aleator.load(path, ..., experiments=...)",
            )
        which = [table.ids.index(name) for name in _named_by(table, conditions, of)]
        return MeasuredExperiments(self._adapted(table, alpha), np.array(which, dtype=np.intp))

    def _of_groups(
        self, conditions: Conditions, alpha: Array
    ) -> tuple[Inputs, MeasuredExperiments | None]:
        """The laws of new experiments, and these experiments if some are in a measured group.

        They are then added to the measured ones, without observations.
        """
        inputs, table = self.inputs, self.experiments
        assert inputs is not None
        new = _columns(conditions, inputs)
        alone = inputs.resolved(new)
        if not inputs.levels or table is None:
            return alone, None
        count, old = len(table.ids), covariates(table, inputs.columns)
        together = pd.concat([old, new], ignore_index=True)
        grouping = inputs.resolved(together).grouping
        assert grouping is not None
        if not any(np.isin(own[count:], own[:count]).any() for own in grouping.group):
            return alone, None
        # New experiments stand behind the last one that shares a parameter with them.
        last = np.full(grouping.clusters, count)
        last[grouping.cluster[:count]] = np.arange(count)
        order = np.argsort(
            np.append(np.arange(count), last[grouping.cluster[count:]]), kind="stable"
        )
        place = np.argsort(order)
        whole = inputs.resolved(together.iloc[order].reset_index(drop=True))
        likelihood = self._adapted(table, alpha).among(whole, place[:count])
        return whole, MeasuredExperiments(likelihood.adapted(alpha), place[count:], further=False)

    def _adapted(self, table: Experiments, alpha: Array, nodes: int = 7) -> IndividualLikelihood:
        """The likelihood of the measured experiments, made again if the fit was not kept.

        It is then made with seven Gauss-Hermite nodes for each variate, which are enough for
        predictions of single experiments.
        """
        if self.fit is not None:
            assert isinstance(self.fit.likelihood, IndividualsAt)
            return self.fit.likelihood.integral
        assert self.runner is not None
        assert self.inputs is not None
        x = Draws.new(self.inputs, alpha, len(table.ids)).x.reshape(-1, len(self.inputs.names))
        return self._integral(self.inputs, table, self.runner(table), x, nodes).adapted(alpha)


def _by_density(
    context: PredictionContext,
    model: Model,
    alpha: Array,
    quantiles: tuple[float, ...],
    progress: Progress | None,
) -> pd.DataFrame:
    """The table of predictions without noise, from the density of the outcome under alpha (K,)."""
    outcomes = under_law(context.runner, model, alpha, progress).predictor.under(alpha)
    found = outcomes.quantile(np.array(quantiles))
    columns: dict[str, Any] = {
        **scales(context),
        "mean": outcomes.mean,
        "standard_deviation": outcomes.sd,
        "skewness": outcomes.standardized[:, 3],
        "kurtosis": outcomes.standardized[:, 4],
    }
    columns |= {f"q{p:g}": found[:, i] for i, p in enumerate(quantiles)}
    return in_rows(context, columns, [Status(int(c)).name.lower() for c in outcomes.status])


def _require_known(at: Mapping[Any, object], known: Sequence[str], needed: Collection[str]) -> None:
    """Raise InputsError for a name in the mapping `at` that is not `known`, or a `needed` one."""
    for name in needed:
        if name not in at:
            raise InputsError(
                f"at: a law follows '{name}', which has no value", f"add it: {{'{name}': ...}}"
            )
    for name in at:
        if name not in known:
            raise InputsError(
                f"at: '{name}' is no condition of the experiments{nearest(str(name), known)}",
                f"the columns are {', '.join(known)}" if known else "leave it out: there are none",
            )


def _named_by(table: Experiments, conditions: Conditions, of: str) -> list[str]:
    """The name of the measured experiment to which each new one belongs.

    Raises InputsError for a name that no measured experiment has.
    """
    if of in (SAME, conditions.id):
        ids = [*conditions.ids]
    elif of in conditions.table.columns:
        ids = [_text(cell) for cell in covariates(conditions, [of])[of]]
    else:
        ids = [of] * len(conditions.ids)
    for name in ids:
        if name not in table.ids:
            raise InputsError(
                f"of '{of}': there is no experiment '{name}'{nearest(name, table.ids)}",
                "name an experiment that was measured, or a column of the conditions with such",
            )
    return ids


def _columns(conditions: Conditions, inputs: Inputs) -> pd.DataFrame:
    """The columns that the laws follow; without that of a level each experiment is a new group."""
    absent = [n for n in inputs.levels.values() if n not in conditions.table.columns]
    found = covariates(conditions, [n for n in inputs.columns if n not in absent])
    return found.assign(**{n: [f"new group {k}" for k in range(len(found))] for n in absent})


def _text(cell: object) -> str:
    return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell)


def runners(simulator: Simulator | Runner, parameters: Sequence[str]) -> Runners:
    """A function that returns the runner of a simulator for any table, without a store."""
    return lambda asked: as_runner(simulator, asked, parameters)


def runners_like(runner: Runner, table: Experiments) -> Runners:
    """A function that returns a runner for any table, with the simulator of `runner`.

    It takes and keeps runs in the same store, and has the same workers. Conditions that vary within
    an experiment of `table` are passed to the simulator as arrays.
    """
    varying = varying_conditions(table, tuple(runner.cases.columns))
    store = None if runner.cache is None else runner.cache.store

    def of(asked: Experiments | Conditions) -> Runner:
        if asked is table:
            return runner
        return Runner(
            runner.simulator, asked, runner.parameters, store=store, executor=runner.executor,
            retries=runner.retries, max_failed=runner.max_failed, varying=varying,
        )  # fmt: skip

    return of


def alpha_from(
    alpha: Mapping[str, float] | ArrayLike,
    values: Mapping[str, float | Estimate],
    hyperparameters: Sequence[Hyperparameter],
) -> Array:
    """The alpha (K,) from a mapping or an array; hyperparameters not named have their `values`.

    Raises InputsError for an unknown name and for a value outside its limits.
    """
    if isinstance(alpha, Mapping | pd.Series):
        given = {str(name): value for name, value in alpha.items()}
    else:
        given = _named(np.asarray(alpha, dtype=np.float64), [h.name for h in hyperparameters])
    return in_order({**values, **given}, hyperparameters)


def _named(alpha: Array, names: Sequence[str]) -> dict[str, float]:
    if alpha.shape != (len(names),):
        raise InputsError(
            f"alpha has shape {alpha.shape}, and there are {len(names)} hyperparameters",
            f"give one number for each of {', '.join(names)}",
        )
    return dict(zip(names, alpha.tolist(), strict=True))


def _refit(
    found: Result,
    parts: tuple[
        Inputs, Noise | Mapping[str, Noise] | None, ResponseSurface | Collocation, Density | None
    ],
    experiments: Experiments,
    runner: Runners,
    progress: Progress,
) -> Fit:
    """The fit of a stored answer; `parts` are laws, noise, propagation and density of its study."""
    inputs, noise, propagation, density = parts
    choices = Choices.of(
        experiments, inputs, noise, propagation, density,
        restricted=found.log_likelihood.restricted is not None,
    )  # fmt: skip
    made = runner(experiments)
    made.progress = progress
    return stored_fit(found, choices.question(made, experiments.observations, found.seed), progress)


def kept(fit: Fit | None) -> Fit:
    """The fit; raises AleatorError if it is None, since the identification was read from a file."""
    if fit is None:
        raise missing(
            "this needs the surfaces, which are not saved",
            "identify again: with a Store no run is repeated",
        )
    return fit


def missing(what: str, remedy: str) -> AleatorError:
    """The error for a task that an identification read from a file cannot do."""
    return AleatorError(f"{what}; this identification was read from a file", remedy)
