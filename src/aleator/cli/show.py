"""`aleator show`: a stored answer as text, without a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from aleator.cli.identify import show_identification
from aleator.cli.predict import predicted
from aleator.cli.running import FILE, show_answer
from aleator.errors import AleatorError, short
from aleator.results.printed import Content
from aleator.results.schema import NEEDED, answer_file, read_answer, read_ceiling, read_document
from aleator.views import models, p_boxes, planning, uncertainty

Document = Mapping[str, Any]
View = Callable[[Document], Content]

KEYS = {
    "predict": ("request", "rows"),
    "ceiling": ("region", "points", "gains"),
    "compare": ("models", "left_out"),
    "check": ("conditions", "observations", "cost"),
    "box": ("box", "sides"),
    "sensitivity": ("expansion", "pairs"),
    "next": ("candidates", "chosen"),
    "bootstrap": ("statuses", "hyperparameters"),
    "posterior": ("chains", "draws"),
    "recover": ("replicates", "hyperparameters"),
    "pbox": ("bounded", "rows", "pinched"),
}
"""The keys by which the document of a command is recognized; the first that has all is meant."""

VIEWS: Mapping[str, View] = {
    "ceiling": models.ceiling,
    "compare": models.comparison,
    "check": planning.first_look,
    "box": planning.box,
    "sensitivity": planning.sensitivity,
    "next": planning.next_experiments,
    "bootstrap": uncertainty.bootstrap,
    "posterior": uncertainty.posterior,
    "recover": uncertainty.recovery,
    "pbox": p_boxes.bounds,
}
"""The report of each command's document; that of predictions has one for each response."""


@click.command()
@click.argument("result", type=FILE, metavar="RESULT")
@click.option("--details", is_flag=True, help="Of an identification also all that it tells.")
@click.option("--quiet", is_flag=True, help="Only what the report concludes.")
def show(result: Path, details: bool, quiet: bool) -> None:
    """Print a stored answer again.

    RESULT is a JSON file that a command wrote: identification.json, check.json, box.json,
    sensitivity.json, ceiling.json, compare.json, bootstrap.json, posterior.json, recovery.json,
    next.json, pbox.json, or the predictions of `aleator predict --output FILE.json`. For a folder
    it is the identification.json in it, or its only JSON file. The text is that of the command,
    with --details and --quiet as `aleator identify` has them. No run of the simulator is made, and
    no file is written.
    """
    path = answer_file(result)
    document = read_document(path)
    if all(key in document for key in NEEDED):
        show_identification(read_answer(path), details=details, quiet=quiet)
        return
    command = next((c for c, keys in KEYS.items() if all(key in document for key in keys)), None)
    if command is None:
        raise AleatorError(
            f"{short(path)}: this is no answer of Aleator",
            "name a JSON file that a command wrote, such as identification.json",
        )
    if command == "ceiling":
        read_ceiling(path)
    try:
        contents = [*_contents(command, document)]
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise AleatorError(
            f"{short(path)}: this is not as `aleator {command}` writes it: "
            f"{type(error).__name__} {error}",
            f"run `aleator {command}` again to write the file anew",
        ) from None
    for content in contents:
        show_answer(content, quiet=quiet and bool(content.verdicts))


def _contents(command: str, document: Document) -> Iterator[Content]:
    if command == "predict":
        yield from predicted(document)
    else:
        yield VIEWS[command](document)
