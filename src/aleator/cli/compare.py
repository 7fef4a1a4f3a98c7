"""`aleator compare`."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import click

from aleator.cli.ending import told
from aleator.cli.running import (
    FILE,
    FOLDER,
    SEED,
    RunOptions,
    identified,
    make_place,
    makes_runs,
    name_of,
    running,
)
from aleator.cli.showing import can_draw, shown
from aleator.errors import AleatorError
from aleator.results import documents
from aleator.study import Study, load_study
from aleator.tasks.compare import compare as compare_models
from aleator.views.figures import save_compare
from aleator.views.models import comparison


@click.command()
@click.argument("studies", type=FILE, metavar="A.toml B.toml ...", nargs=-1, required=True)
@click.option(
    "--nested",
    type=(str, str),
    multiple=True,
    metavar="SMALL LARGE",
    help="Model SMALL is a special case of LARGE; may be given several times [default: what is "
    "found by the names of the hyperparameters].",
)
@click.option(
    "--bootstrap",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="R",
    help="Judge likelihood ratios by R data sets drawn under the smaller model, too.",
)
@click.option("--no-ceiling", is_flag=True, help="Do not look for the best law of each model.")
@click.option(
    "--output",
    type=FOLDER,
    metavar="DIR",
    help="Folder of compare.json and compare.png [default: out/compare].",
)
@SEED
@click.option("--no-verify", is_flag=True, help="Leave out the check on the simulator.")
@makes_runs
@click.option("--no-figures", is_flag=True, help="Draw no figure.")
def compare(
    studies: tuple[Path, ...],
    nested: tuple[tuple[str, str], ...],
    bootstrap: int,
    no_ceiling: bool,
    output: Path | None,
    seed: int | None,
    no_verify: bool,
    no_figures: bool,
    options: RunOptions,
) -> None:
    """Tell which of several models is to be believed.

    Each study is identified, by the runs in its store where they are known, and called as its file
    is, or as its folder where that is study.toml. Prints the log-likelihood, AIC, AICc and BIC, the
    predictive log-likelihood of experiments left out with the error of the differences, and
    likelihood ratios of nested models; writes DIR/compare.json and DIR/compare.png. Models of
    different data, or of different transforms of the outcome, are refused.
    """
    folder = output or (Path("out") / "compare").absolute()
    values = _named(studies, seed, not no_verify)
    make_place(folder / "compare.json", studies[0].absolute())
    with ExitStack() as stack:
        runners = {name: stack.enter_context(running(v, options)) for name, v in values.items()}
        progress = stack.enter_context(shown(options.quiet))
        found = {name: identified(v, runners[name], progress) for name, v in values.items()}
        result = compare_models(
            nested=nested, bootstrap=bootstrap, ceilings=not no_ceiling, seed=seed or 0,
            progress=progress, **found,
        )  # fmt: skip
    titles = {name: value.title for name, value in values.items()}
    document = documents.plain({"titles": titles, "seed": seed or 0, **result.to_dict()})
    documents.write_json(document, folder / "compare.json")
    files = [folder / "compare.json"]
    if not no_figures and can_draw(quiet=options.quiet):
        files.append(save_compare(document, folder))
    told(comparison(document), files, options.quiet)


def _named(studies: tuple[Path, ...], seed: int | None, verified: bool) -> dict[str, Study]:
    """The studies by their names."""
    if len(studies) < 2:
        raise AleatorError(f"compare: {len(studies)} study", "name two or more")
    found: dict[str, Study] = {}
    for path in studies:
        name = name_of(path)
        if name in found:
            raise AleatorError(
                f"{path}: another study is called '{name}' too", "rename one of the files"
            )
        found[name] = load_study(path).overridden(seed, verified=verified)
    return found
