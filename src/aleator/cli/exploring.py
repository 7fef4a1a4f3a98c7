"""`aleator check`, `box`, `sensitivity` and `next`: what to simulate and to measure."""

from __future__ import annotations

from pathlib import Path

import click

from aleator.cli.running import (
    FILE,
    LAW_OF,
    NO_FIGURES,
    OUTPUT,
    SEED,
    STUDY,
    RunOptions,
    Work,
    folder_of,
    makes_runs,
    output_option,
    require_at_most_one,
    tell_expected_runs,
    tell_odd_repeats,
    whole_number,
)
from aleator.errors import AleatorError, count, short
from aleator.fit.question import Choices
from aleator.inference.outcome_event import OutcomeEvent
from aleator.inference.outcome_question import require_laws_at
from aleator.observations.experiments import Conditions
from aleator.study import Study
from aleator.tasks.box import feasible_box
from aleator.tasks.documents import box_document, look_document, sensitivity_document
from aleator.tasks.first_look import (
    expected_cost,
    first_look,
    fixed_noise,
    planned_look,
    understated_noise,
)
from aleator.tasks.new_experiments import Exploration
from aleator.tasks.next_experiment import (
    Predicted,
    next_experiments,
    require_enough_candidates,
    require_free,
)
from aleator.tasks.screen import SCREEN, screen
from aleator.views import planning
from aleator.views.figures import save_check, save_sensitivity


@click.command()
@STUDY
@output_option("Write DIR/box.json.")
@SEED
@makes_runs
def box(
    study: Path,
    output: Path | None,
    seed: int | None,
    options: RunOptions,
) -> None:
    """Find the largest box in which every experiment works.

    Looks within the boxes and limits that STUDY.toml states: make them as wide as physics allows.
    A run that raises, or returns no finite number, counts as a failure and does not stop the
    search. Tells for every side of the box which experiment limits it, and where that one failed.
    """
    work = Work.on("box", study, options, folder=output, seed=seed, verified=True)
    value = work.study
    with work.running() as (runner, progress):
        progress.stage("feasible box")
        found = feasible_box(
            runner, value.experiments, value.inputs, seed=value.seed, progress=progress
        )
    work.end(box_document(found), planning.box)


@click.command()
@STUDY
@OUTPUT
@SEED
@makes_runs
@NO_FIGURES
def check(
    study: Path,
    output: Path | None,
    seed: int | None,
    options: RunOptions,
    no_figures: bool,
) -> None:
    """Make the first runs, and tell what the rest will cost.

    Each parameter takes three values over its limits while the others are in the middle of theirs.
    Runs at the corners, where every parameter is at a limit, follow: in all 3 runs for each
    experiment with one parameter, 9 with two, 15 with three. If runs are slow and experiments are
    many, some experiments are chosen, evenly over the measured values. Every run is kept in the
    store.

    Where no run comes to a measured value, more runs are made near the closest one, for twenty
    values at most. Tells for which experiments none comes there, which parameters have no
    influence, how long a run takes, and how many runs an identification will need. Writes
    DIR/check.json, and DIR/check.png, the outcome over each parameter, if matplotlib is installed.
    """
    work = Work.on(
        "check", study, options, folder=folder_of(output, study), seed=seed, verified=True
    )
    value = work.study
    Choices.of(
        value.experiments, value.inputs, value.noise, value.propagation, value.density,
        restricted=value.restricted, small_sample=value.small_sample,
    ).require_enough()  # fmt: skip
    tell_odd_repeats(value, options)
    with work.running() as (runner, progress):
        plan = planned_look(runner, value.experiments, value.inputs)
        options.say(
            f"{count(plan.runs, 'run')}: {count(len(plan.x), 'point')} under {len(plan.cases)} of "
            f"{count(plan.count, 'different condition')}"
        )
        progress.stage("first runs")
        runner.progress = progress
        look = first_look(runner, value.experiments, plan, value.noise, progress)
        cost = expected_cost(
            runner, value.experiments, value.inputs, value.noise, value.propagation,
            value.density, value.verification, plan,
        )  # fmt: skip
    held = fixed_noise(value.experiments, value.noise)
    workers, fault = options.workers or 1, runner.array_fault
    understated = understated_noise(runner, value.experiments, value.inputs, value.noise)
    document = look_document(look, cost, workers, held, understated, fault, value.experiments)
    work.end(document, planning.first_look, draw=None if no_figures else save_check)
    if options.quiet:
        return
    asked = [value.event(question) for question in value.questions]
    simulated = [event for event in asked if value.for_event(event) is value]
    events = sum(event is not None for event in simulated)
    if simulated and cost is not None and not cost.direct:
        also = f", and of {count(events, 'event')} some {Exploration().runs} runs or more each"
        click.echo(
            f"{count(len(simulated), 'question')} of the study: the runs of a surface for "
            f"each, not counted above{also if events else ''}"
        )
    if planning.to_mend(document):
        again = f"then aleator check {short(work.file)} again"
        click.echo(f"Next: look at these values and the limits, {again}")
    else:
        click.echo(f"Next: aleator identify {short(work.file)}")


@click.command()
@STUDY
@OUTPUT
@SEED
@click.option(
    "--runs",
    type=click.IntRange(min=4),
    help=f"Runs an experiment [default: {SCREEN.first_runs} a parameter, and more until the "
    "expansions are good].",
)
@click.option(
    "--experiments",
    metavar="ID,ID,...",
    help="Only these experiments [default: all].",
)
@makes_runs
@NO_FIGURES
def sensitivity(
    study: Path,
    output: Path | None,
    seed: int | None,
    runs: int | None,
    experiments: str | None,
    no_figures: bool,
    options: RunOptions,
) -> None:
    """Tell which parameters deserve a law.

    These are the parameters whose scatter moves the outcome. Tells also which ones act alike.

    Expands the outcome of every experiment in polynomials of the parameters and computes Sobol'
    indices from the coefficients. A parameter varies by its law if STUDY.toml states all of that
    law. If any of it is to be identified, the parameter varies uniformly over its limits or box.
    To screen a parameter, make it a constant with limits.

    Writes DIR/sensitivity.json (all), DIR/sensitivity.csv (a row for each experiment and
    parameter) and DIR/sensitivity.png if matplotlib is installed.
    """
    work = Work.on(
        "sensitivity", study, options, folder=folder_of(output, study), seed=seed, verified=True
    )
    value = work.study
    ids = None if experiments is None else [name.strip() for name in experiments.split(",")]
    with work.running() as (runner, progress):
        progress.stage("sensitivity")
        runner.progress = progress
        found = screen(
            runner, value.experiments, value.inputs, only=ids, runs=runs, seed=value.seed,
            progress=progress,
        )  # fmt: skip
    work.end(
        {**sensitivity_document(found), "runs": runner.runs, "seed": value.seed},
        planning.sensitivity,
        texts={"csv": found.table().to_csv(index=False, lineterminator="\n")},
        draw=None if no_figures else save_sensitivity,
    )


@click.command()
@STUDY
@click.option(
    "--candidates",
    type=FILE,
    required=True,
    metavar="NEW.csv",
    help="Table of experiments that could be made, written as the study's is, without outcomes.",
)
@whole_number("--count", 5, "Number of experiments to choose.")
@click.option(
    "--for",
    "about",
    metavar="NAME|all",
    help="The hyperparameter to know better, or all together "
    "[default: the standard deviation that is least known for its size].",
)
@click.option(
    "--for-prediction",
    type=FILE,
    metavar="CONDITIONS.csv",
    help="Know better what is predicted under these conditions: a quantile or a probability.",
)
@click.option("--quantile", type=float, help="The quantile that is predicted [default: 0.95].")
@click.option(
    "--event", metavar="EVENT", help='The event whose probability is predicted: "travel > 26".'
)
@click.option(
    "--no-noise", is_flag=True, help="The event of the true value, without the error of measuring."
)
@whole_number("--repeat", 1, "How often a candidate may be chosen.")
@whole_number(
    "--laws",
    1,
    "Plan for the mean over so many laws that the experiments leave possible; 1: for the "
    "identified one.",
)
@LAW_OF
@output_option("Write DIR/next.json and DIR/next.csv.")
@SEED
@makes_runs
def next(
    study: Path,
    candidates: Path,
    count: int,
    about: str | None,
    for_prediction: Path | None,
    quantile: float | None,
    event: str | None,
    no_noise: bool,
    repeat: int,
    laws: int,
    answer: Path | None,
    output: Path | None,
    seed: int | None,
    options: RunOptions,
) -> None:
    """Tell which experiments should be made next.

    Takes the law from the answer that `aleator identify` stored, without a search; without one it
    identifies the law of STUDY.toml first (runs that are kept are not made again). For each row of
    NEW.csv it computes the standard error that a hyperparameter or a prediction would have after
    that experiment. It then chooses the set of experiments that tell most together, and tells how
    often all experiments would have to be repeated for the same effect. Rows with one id are one
    experiment. Nothing is measured; the simulator is run for the candidates.
    """
    work = Work.on("next", study, options, folder=output, seed=seed)
    value = work.study
    table = value.read_conditions(candidates)
    # Mistakes in the arguments are reported before a slow simulator runs.
    require_enough_candidates(count, len(table.ids), repeat)
    require_free(about, value.hyperparameters)
    require_at_most_one({"--for": about, "--for-prediction": for_prediction})
    at = None if for_prediction is None else value.read_conditions(for_prediction)
    predicted = _predicted(value, at, quantile, event, no_noise)
    for new in (table, at):
        if new is not None:
            require_laws_at(new, value.inputs, value.experiments, None)
    with work.running() as (runner, progress):
        found = work.answered(answer, runner, progress)
        session, surface = found.session, found.surface
        others = session.runner_on(table)
        tell_expected_runs(options, surface, others, "candidate")
        aimed = None if event is None else session.event(event, value.units)
        if at is not None and (aimed is None or aimed.outcome in session.outcomes):
            there = session.runner_on(at)
            tell_expected_runs(options, surface, there, "new condition", event=aimed is not None)
        plan = next_experiments(
            found, table, count, about=predicted or about, repeat=repeat, laws=laws,
            simulator=others, progress=progress,
        )  # fmt: skip
    work.end(
        {"seed": value.seed, **plan.to_dict()}, planning.next_experiments,
        texts={"csv": plan.table().to_csv(index_label="id", lineterminator="\n")},
    )  # fmt: skip


def _predicted(
    study: Study,
    at: Conditions | None,
    quantile: float | None,
    event: str | None,
    no_noise: bool,
) -> Predicted | None:
    """The prediction that new experiments shall make more precise; None if none is requested.

    It is a quantile, or the probability of an event if one is given.
    """
    wanted = {"--quantile": quantile, "--event": event}
    if at is None:
        for option, given in {**wanted, "--no-noise": no_noise or None}.items():
            if given is not None:
                raise AleatorError(
                    f"{option} says what to predict, but not under which conditions",
                    "add --for-prediction CONDITIONS.csv",
                )
        return None
    require_at_most_one(wanted)
    if no_noise and event is None:
        raise AleatorError(
            "--no-noise says which event is meant, and there is no event",
            'add --event "travel > 26", or leave it out: a quantile is that of a measurement',
        )
    if event is not None:
        names = study.experiments.observations.names
        OutcomeEvent.of(event, names, study.units, study.inputs.names)
    elif quantile is None:
        quantile = 0.95
    return Predicted(at, quantile, event, not no_noise)
