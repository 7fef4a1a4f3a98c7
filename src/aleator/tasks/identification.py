"""The result of `identify`, with its methods for predictions, and `load` to read it from a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aleator.core.progress import Progress, Silent
from aleator.errors import InputsError
from aleator.fit.question import DEFAULT_PROPAGATION
from aleator.inference.alpha_draws import DRAWING, AlphaDraws, alpha_draws, estimated
from aleator.inference.fit import Fit
from aleator.inference.likelihood_draws import plausible_draws
from aleator.inference.outcome_question import Tolerance
from aleator.inference.pictures import PICTURES, opening_pictures, pictures
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.observations.experiments import Experiments
from aleator.results.law import JointLaw
from aleator.results.result import Result
from aleator.results.values import in_order
from aleator.simulators import Runner, Simulator, Store, as_simulator
from aleator.surrogates import ResponseSurface
from aleator.tasks.arguments import AnyNoise, Laws, RequestedConditions, inputs_of, noise_of
from aleator.tasks.event_points import SAMPLE
from aleator.tasks.p_box import PBox, p_box_of, require_one_law
from aleator.tasks.prediction import PREDICTION
from aleator.tasks.probability import limits, probabilities, requested_responses
from aleator.tasks.session import Runners, Session, kept, missing, runners, runners_like

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation
    from aleator.views.page import HtmlReport
    from aleator.views.plots import Plots

NO_SESSION = Session()
"""The empty session of an identification that was read from a file without further arguments."""


@dataclass(frozen=True, repr=False, eq=False)
class Identification(Result):
    """An identified law: alpha with its uncertainty, its log-likelihood, and how it was computed.

    `sound` is true only if the search converged, every density was solved with every outcome in
    its support, and the check on the simulator, if it was made, agrees. `undetermined` names the
    hyperparameters whose values the experiments leave open. `consistent` is true if the
    experiments agree with the identified model; `consistency` has the tests. `warnings` are
    sentences about problems and their remedies. It prints as a short report. `session` holds the
    model, the simulator and the surfaces. An identification that was read from a file has only
    those parts of the session that were passed to `load`.

    >>> from aleator import Free, Inputs, Check, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y",
    ...                  verification=Check(0))
    >>> found
    95 % of experiments: x 0.79 to 1.27 (each end +- 0.29, 95 % confidence).
    A new experiment like experiment 3: y 2.36 to 3.82 (95 %).
    2 hyperparameters identified from 4 experiments
    hyperparameter  estimate  std. error   95 % interval  note
    x.mean             1.031       0.062  0.873 .. 1.189
    x.sd               0.124       0.044  0.071 .. 0.303  sandwich error 0.018
    log-likelihood -0.511 +- ... by level sets
    ...
    Computed soundly: the search converged, every density was solved; the simulator
    itself was integrated over.
    Not tested whether consistent with the experiments: there are only 4 observations.
    >>> float(found.values["x.mean"]), found.intervals.loc["x.mean"].round(3).tolist()
    (1.031, [0.873, 1.189])
    >>> found.predict({"load": 10.0})["mean"].tolist()
    [10.31]
    """

    session: Session = field(default=NO_SESSION, compare=False)

    @classmethod
    def of(cls, result: Result, session: Session) -> Identification:
        """The identification with the values of a result and with a session."""
        own = {each.name: getattr(result, each.name) for each in fields(Result)}
        return cls(**own, session=session)

    @property
    def law(self) -> JointLaw:
        """The identified joint law of the parameters, with `sample`, `pdf`, `cdf`, `marginals`.

        Raises AleatorError if the identification was read from a file without the inputs.
        """
        return self.session.law(self.alpha)

    @property
    def fit(self) -> Fit:
        """The likelihood with its data and estimates, from which other tasks compute; no runs.

        Raises AleatorError if the identification was read from a file, where surfaces are not
        saved.
        """
        return kept(self.session.fit)

    def with_fit(self, progress: Progress | None = None) -> Identification:
        """This identification with its `fit`, which is made again if it was read from a file.

        No search and no run for the measured experiments is made: the response surfaces are in the
        store of runs. The log-likelihood must come out as it was. Raises AleatorError if the file
        was read without simulator or experiments, if these are not those of the identification, or
        if the store has no surfaces of it. Cost: the evaluations of the standard errors.
        """
        session = self.session.with_fit(progress or Silent())
        return self if session is self.session else replace(self, session=session)

    def law_at(self, covariates: Mapping[str, object] | pd.Series) -> JointLaw:
        """The joint law of the parameters of an experiment with these covariates, by name.

        It equals `law` if no law depends on covariates. Raises InputsError for a missing covariate,
        and for a level of a covariate that no experiment had.
        """
        return self.session.law(self.alpha, covariates)

    def log_likelihood_at(self, alpha: Mapping[str, float] | ArrayLike) -> float:
        """log L(alpha) on the response surfaces of the identification.

        It is minus infinity if an outcome is outside its support. `alpha` maps names to values, and
        hyperparameters not named keep their estimates; or it is an array (K,) in the order of
        `values`. The surfaces are accurate near the estimate and over its intervals; far beyond
        them the value is rough. Raises InputsError for an unknown name and a value beyond its
        limits. Raises AleatorError if the identification was read from a file, where surfaces are
        not saved. Cost: some milliseconds, no run.
        """
        return self.session.log_likelihood(alpha, self.alpha)

    def draws(
        self, count: int = DRAWING.count, *, seed: int = 0, by_likelihood: bool = False
    ) -> AlphaDraws:
        """Draws of alpha that represent its uncertainty, with weights, within its limits.

        They are drawn from the estimates, their intervals and correlations (see `alpha_draws`),
        which a file has too. Where such draws do not agree with the likelihood, they are the
        draws by the likelihood that the identification made (see `plausible`): no more than those,
        whatever the `seed`. With `by_likelihood` they are weighted by the likelihood itself, which
        is exact also for very skew intervals and few experiments, and takes one evaluation of the
        likelihood for each draw. Raises AleatorError for a count below one, if the identification
        was read from a file without inputs, and with `by_likelihood` if it was read from any file.
        """
        if count < 1:
            raise InputsError(f"draws: {count} draws", "ask for one or more; 256 tell quantiles")
        known = estimated(
            self.alpha, self.correlation_names, self.correlation, self._hyperparameters
        )
        names = tuple(h.name for h in self._hyperparameters)
        if by_likelihood:
            found = replace(alpha_draws(known, count, seed, DRAWING.wide), names=names)
            return found.reweighted(kept(self.session.fit).objective())
        # The laws may be given to `load` in another order than to the identification.
        order = [[*self.alpha].index(name) for name in names]
        plausible = None if self.plausible is None else self.plausible.reordered(order)
        return replace(plausible_draws(known, plausible, count, seed), names=names)

    def predict(
        self,
        at: RequestedConditions = None,
        *,
        of: str | None = None,
        noise: bool = True,
        uncertainty: bool | AlphaDraws = True,
        quantiles: tuple[float, ...] = PREDICTION.quantiles,
        progress: Progress | None = None,
    ) -> pd.DataFrame:
        """The distribution of the outcome under conditions that need not have been tested.

        `at` are the conditions: a mapping from names to values, or to lists of one length, a data
        frame, which may have further columns, or None for those of the experiments, each once.

        It is the distribution of a measurement in a new experiment, or of the simulated value with
        `noise` False. `of` is the name of a measured experiment, or a column of the conditions with
        such names ("id" for their own ids). The distribution is then that of a further measurement
        of that experiment. With levels a new experiment belongs to the group that the conditions
        name; without the column of a level, or with a name that no experiment had, to a new one.

        The uncertainty of alpha is included: the distribution is a mixture over plausible laws (see
        `draws`), and columns ``q<p>.lower`` and ``q<p>.upper`` have a 95 % interval of each
        quantile. With `uncertainty` False alpha is fixed at its estimate. `uncertainty` may also be
        draws of alpha.

        The table has a row for each row of the conditions and each outcome. Its first columns are
        the conditions, then ``outcome``, its name; ``attrs["units"]`` has the units by name, and
        ``attrs["beyond"]`` says by row which conditions lie outside those of the experiments, and
        how far; ``attrs["plausible"]`` how well the plausible laws are drawn, and the status is
        "poor_draws" where their draws do not represent the likelihood. If the outcome has a "log"
        transform, all predicted values are of the logarithm, and a column ``scale`` is "log".
        Raises AleatorError
        if the identification was read from a file without the simulator. Cost: with a slow
        simulator the runs of one response surface for each condition.
        """
        draws = self._taken(uncertainty)
        found = self.session.predict(at, draws, quantiles, progress, of, noise)
        return self._told(found, uncertainty)

    def probability(
        self,
        event: str,
        at: RequestedConditions = None,
        *,
        of: str | None = None,
        noise: bool = True,
        uncertainty: bool | AlphaDraws = True,
        checks: int = SAMPLE.checks,
        progress: Progress | None = None,
    ) -> pd.DataFrame:
        """The probability of an event such as "travel > 26" or "20 < travel < 26", rare or not.

        The event compares an outcome, by its name, with values in its unit, which may follow them:
        "travel > 26 mm". `at` are the conditions, as in `predict`. The event may be one of a
        parameter: "gap > 15" asks for the share of its law beyond 15, or with `of` for the
        probability that the experiment's own parameter is so large. That takes no run and no noise,
        and of the conditions only those that the law follows.

        With `noise` it is the probability of a measured value. For the probability of a failure use
        the true value, with `noise=False`. `checks` is the number of simulator runs that check a
        response surface for each row; 0 means no check.

        The columns are the conditions, ``outcome``, the ``probability`` (the mean over plausible
        laws: it includes the uncertainty of alpha), ``lower`` and ``upper``: an interval with at
        most 2.5 % of the plausible laws on either side, widened to contain the probability and
        ``at_estimate``, the probability at the estimate of alpha alone. Then follow the standard
        ``error`` of the computation, the ``distance`` of the most probable point of a rare event in
        standard deviations, the number of ``checks``, ``unseen``, the distance ``beyond`` the
        tested conditions and ``status``. ``unseen`` is the largest probability of a region that the
        runs all over the law, in all their rounds, do not exclude with 95 % confidence; those of
        `checks` do not count, as they lie near the event that the surface shows. The status is
        "never" if no parameters within 6.5 standard deviations lead to the event, and "always" if
        none lead to its contrary. It is "unsettled" if the last runs still change the probability,
        or leave open which outcomes are in the event.

        Raises InputsError for a text that is no event of one name, AleatorError as `predict`.
        """
        draws = self._taken(uncertainty)
        asked = self.session.event(event, self.units)
        context = self.session.event_context(asked, at, draws.estimate, of, noise)
        found = probabilities(context, draws, asked, checks, progress)
        return self._told(found, uncertainty)

    def p_box(
        self,
        at: RequestedConditions = None,
        *,
        noise: bool = True,
        progress: Progress | None = None,
    ) -> PBox:
        """The distributions of new outcomes that bounded hyperparameters leave possible.

        For each value b of the hyperparameters that are only bounded (`Between`), the others are
        identified again: alpha(b). The band holds P(y <= t) for every b that the experiments do not
        rule out, those with log L(alpha(b)) at most 1.92 below the highest. A second, wider band
        has the uncertainty of the identified ones too: all alpha and b with log L(alpha, b) at most
        1.92 below the highest. Ask `quantiles`, `probability` and `pinched` of the result. `at` are
        the conditions, as in `predict`.

        Identifying again takes no runs: it uses the surfaces of the identification, which was made
        with b at its start. Raises InputsError if nothing is only bounded, AleatorError if the
        identification was read from a file.
        """
        return p_box_of(
            self.session, in_order(self.alpha, self._hyperparameters), at,
            noise=noise, sound=self.sound, units=self.units, progress=progress,
        )  # fmt: skip

    def tolerance(
        self,
        content: float = 0.95,
        confidence: float = 0.95,
        at: RequestedConditions = None,
        *,
        side: str = "both",
        outcome: str | None = None,
        of: str | None = None,
        noise: bool = True,
        uncertainty: bool | AlphaDraws = True,
        progress: Progress | None = None,
    ) -> pd.DataFrame:
        """Tolerance limits, which contain the share `content` of all outcomes with a confidence.

        `at` are the conditions, as in `predict`; `outcome` is one of several outcomes, else all are
        meant. After the conditions and ``outcome`` the columns ``lower`` and ``upper`` are two
        limits. With the `side` "upper" or "lower" there is one limit, such as the design value for
        a reliability, and the standard ``error`` of its computation. Limits are in the unit of the
        outcome. Raises InputsError for a share that is not between 0 and 1, AleatorError as
        `predict`.
        """
        requested = Tolerance(content, confidence, side)
        draws = self._taken(uncertainty)
        context = self.session.context(at, draws.estimate, of, noise)
        which = np.flatnonzero(
            np.isin(context.seen.response, requested_responses(context, outcome))
        )
        return self._told(limits(context, draws, requested, which, progress), uncertainty)

    def _told(self, table: pd.DataFrame, uncertainty: bool | AlphaDraws) -> pd.DataFrame:
        """The table of predictions with units by name, and with how well plausible laws are drawn.

        ``attrs["plausible"]`` has the status, agreement and effective number of `plausible`, if its
        draws are used. Where they are poor, rows that are solved have the status "poor_draws".
        """
        names = [*map(str, table.columns), *table["outcome"].unique()]
        table.attrs["units"] = {name: self.units[name] for name in names if name in self.units}
        if uncertainty is not True or self.plausible is None:
            return table
        table.attrs["plausible"] = self.plausible.summary
        if self.plausible.status == "poor":
            status = table["status"] if "status" in table else ["solved"] * len(table)
            table["status"] = ["poor_draws" if each == "solved" else each for each in status]
        return table

    def _taken(self, uncertainty: bool | AlphaDraws) -> AlphaDraws:
        require_one_law(self._hyperparameters)
        if isinstance(uncertainty, AlphaDraws):
            return uncertainty
        if not isinstance(uncertainty, bool):
            raise InputsError(
                f"uncertainty = {uncertainty!r:.40} is neither True, False nor draws of alpha",
                "write uncertainty=found.draws(1024)",
            )
        if uncertainty:
            return self.draws()
        return AlphaDraws.at(in_order(self.alpha, self._hyperparameters))

    @property
    def _hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters of the model; raises AleatorError if the session has no inputs."""
        known = self.session.hyperparameters
        if not known:
            raise missing(
                "this needs the inputs, and for predictions the simulator",
                "aleator.load(path, simulator=..., inputs=..., noise=...)",
            )
        return known

    @cached_property
    def plot(self) -> Plots:
        """Charts on matplotlib axes: `plot.law()`, `plot.outcomes()`, `plot.profiles()`.

        Their data are computed from the fit once, in seconds, without runs. Raises AleatorError if
        matplotlib is not installed. `aleator.plot` has all charts.
        """
        from aleator.views.plots import Plots  # imported where a chart is wanted

        return Plots(lambda: self._whole().to_dict())

    def _repr_html_(self) -> str:
        """The first screen of the report for a notebook: sentences, verdicts, charts, estimates."""
        from aleator.views.notebook import first_screen  # imported in a notebook only

        document = self.to_dict()
        if not self.pictures and self.session.fit is not None:
            own = opening_pictures(self, self.session.fit, self.draws(PICTURES.laws))
            document["pictures"] = own
        return first_screen(document)

    def _whole(self, progress: Progress | None = None) -> Identification:
        """The identification with the data of its charts, if they can be computed."""
        if self.pictures or self.session.fit is None:
            return self
        return pictured(self, progress)

    def report(self, *, progress: Progress | None = None) -> HtmlReport:
        """A page of charts that needs no network: a notebook shows it, `.save(path)` writes it.

        Data for further charts are computed from the fit in seconds, without runs. For an
        identification that was read from a file the page has only the charts whose data the file
        has. Raises AleatorError if Bokeh is not installed.
        """
        from aleator.views.page import report_of  # imported where a page is wanted

        return report_of(self._whole(progress).to_dict())


def pictured(found: Identification, progress: Progress | None = None) -> Identification:
    """The identification with the data of its report's charts in `pictures`.

    They are computed by `inference.pictures`. Raises AleatorError if the identification was read
    from a file.

    >>> from aleator import Free, Inputs, Check, Noise, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.5))})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y", noise=Noise(0.1),
    ...                  verification=Check(0))
    >>> sorted(pictured(found).pictures)[:4]
    ['conditions', 'contours', 'laws', 'laws_by_level']
    """
    fit, draws = found.fit, found.draws(PICTURES.laws)
    return replace(found, pictures=pictures(found, fit, draws, progress or Silent()))


def load(
    path: str | Path,
    *,
    simulator: Callable[..., Any] | Simulator | None = None,
    inputs: Laws | None = None,
    vectorized: bool | None = None,
    series: bool = False,
    noise: AnyNoise = None,
    experiments: Experiments | None = None,
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
    density: Density | None = None,
    store: Store | None = None,
) -> Identification:
    """Read an identification that `found.save` or the command `aleator identify` wrote.

    `path` is its file, or the folder with identification.json. All numbers come back as they were.
    Other parts are passed again, as to `identify`: `inputs` and `noise` for `found.law`, and
    `simulator` as well for `found.predict`. `experiments` are needed for predictions of a measured
    experiment, and if a law depends on covariates. With all of these, and with the `store` of the
    runs where response surfaces were used, further questions are asked of the file (see
    `Identification.with_fit`). Raises AleatorError, with the file and the key,
    if the file is no identification. Raises InputsError if the inputs and the noise have other
    hyperparameters than those identified.

    >>> from tempfile import TemporaryDirectory
    >>> import pandas as pd
    >>> from aleator import Free, Check, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y",
    ...                  verification=Check(0))
    >>> with TemporaryDirectory() as folder:
    ...     found.save(f"{folder}/found.json")
    ...     again = load(f"{folder}/found.json", inputs=law)
    >>> again == found, again.law.marginals["x"].mean
    (True, 1.031)
    """
    from aleator.results.schema import read_answer  # pydantic, which only a file needs

    found = Identification.from_document(read_answer(path))
    if inputs is None:
        return found
    laws, runner = inputs_of(inputs), None
    if experiments is not None and not isinstance(experiments, Experiments):
        raise InputsError(
            "load: experiments is a table, not Experiments",
            "give Experiments.from_frame(table, outcome=..., id=...), as in the identification",
        )
    if simulator is not None:
        made = as_simulator(simulator, vectorized, series=series)
        runner = _runners(found, made, laws, experiments, store)
    session = Session.again(
        found, path, laws, noise_of(noise), experiments, propagation, density, runner
    )
    try:
        in_order(found.alpha, session.hyperparameters)
    except InputsError as error:
        raise InputsError(
            f"{path} was identified with other inputs or another noise: {error.problem}",
            "give those of the identification",
        ) from None
    return replace(found, session=session)


def _runners(
    found: Identification,
    simulator: Simulator,
    inputs: Inputs,
    experiments: Experiments | None,
    store: Store | None,
) -> Runners:
    """A function that makes the runner of a table, as in the identification.

    Conditions that varied within an experiment are passed to the simulator as arrays again.
    """
    if experiments is not None:
        return runners_like(Runner(simulator, experiments, inputs.names, store=store), experiments)
    if not found.observations:
        return runners(simulator, inputs.names)
    varying = {name for entry in found.observations for name in entry.conditions}
    return lambda asked: Runner(simulator, asked, inputs.names, varying=varying)
