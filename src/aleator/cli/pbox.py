"""`aleator pbox`: bounds of predictions where hyperparameters are only bounded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from aleator.cli.predict import AT, requested_conditions
from aleator.cli.running import (
    OUTPUT,
    SEED,
    STUDY,
    RunOptions,
    Work,
    folder_of,
    identified,
    makes_runs,
    require_at_most_one,
)
from aleator.inference.outcome_event import OutcomeEvent
from aleator.results.documents import plain
from aleator.tasks.p_box import require_bounded
from aleator.views.p_boxes import bounds


@click.command()
@STUDY
@AT
@click.option(
    "--event",
    metavar="EVENT",
    help='The probability of this event: "travel > 26" or "20 < travel < 26".',
)
@click.option("--outcome", metavar="NAME", help="Quantiles of this outcome, not of all.")
@click.option("--no-noise", is_flag=True, help="Bound what is simulated, without errors.")
@OUTPUT
@SEED
@makes_runs
def pbox(
    study: Path,
    at: tuple[Any, ...],
    event: str | None,
    outcome: str | None,
    no_noise: bool,
    output: Path | None,
    seed: int | None,
    options: RunOptions,
) -> None:
    """Bound predictions where hyperparameters are only bounded.

    A hyperparameter with {between = [0.9, 1.1]} in STUDY.toml is only known to lie there. The study
    is identified first, with the runs in its store if there are any. For each value of the bounded
    hyperparameters the others are then identified again. Tells the bounds of quantiles of the
    outcome under the conditions --at, over all values that the experiments do not rule out; and
    wider ones with the uncertainty of the identified hyperparameters.

    With --event: the bounds of its probability, and how much narrower they become where one of the
    bounded hyperparameters is known: the bound to reduce first. Writes DIR/pbox.json.
    """
    work = Work.on("pbox", study, options, folder=folder_of(output, study), seed=seed)
    value = work.study
    names = value.experiments.observations.names
    require_bounded(value.hyperparameters)
    require_at_most_one({"--event": event, "--outcome": outcome})
    asked = None if event is None else OutcomeEvent.of(event, names, value.units)
    table = requested_conditions(value, at, None)
    with work.running() as (runner, progress):
        found = identified(value, runner, progress, consistency=False)
        box = found.p_box(table, noise=not no_noise, progress=progress)
        pinched: list[Any] = []
        if asked is None:
            rows = box.quantiles(outcome=outcome)
        else:
            rows = box.probability(str(asked))
            if len(box.names) > 1:
                pinched = box.pinched(str(asked)).to_dict("records")
    known = {h.name: [h.lower, h.upper] for h in value.hyperparameters if h.bounded}
    work.end(
        {
            "seed": value.seed, "event": None if asked is None else str(asked), "bounded": known,
            "rows": plain(rows.to_dict("records")), "pinched": plain(pinched),
        },
        bounds,
    )  # fmt: skip
