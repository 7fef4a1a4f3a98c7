"""`aleator compare`, `ceiling`, `bootstrap`, `posterior`, `recover`: how good a result is."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path

import click

from aleator.cli.running import (
    ANSWER,
    FILE,
    LAW_OF,
    NO_FIGURES,
    NO_VERIFY,
    OUTPUT,
    SEED,
    STUDY,
    RunOptions,
    Work,
    can_draw,
    folder_of,
    identified,
    make_place,
    makes_runs,
    name_of,
    output_option,
    running,
    show_answer,
    whole_number,
)
from aleator.core.progress import Progress
from aleator.errors import AleatorError, nearest, short
from aleator.inference.posterior import SAMPLER, installed
from aleator.results import documents
from aleator.simulators import Runner
from aleator.study import Study, load_study
from aleator.tasks.bootstrap import FILE as FINISHED
from aleator.tasks.bootstrap import NONPARAMETRIC, PARAMETRIC
from aleator.tasks.bootstrap import bootstrap as resample
from aleator.tasks.ceiling import ceiling as best_possible
from aleator.tasks.ceiling import require_one_law
from aleator.tasks.compare import compare as compare_models
from aleator.tasks.compare import require_plain
from aleator.tasks.documents import ceiling_document, recovery_document
from aleator.tasks.identification import load
from aleator.tasks.posterior import posterior as drawn
from aleator.tasks.recover import recover as recover_law
from aleator.views import models, uncertainty
from aleator.views.figures import save_ceiling, save_compare


@click.command()
@STUDY
@whole_number("--replicates", 200, "Number of data sets.", least=2)
@click.option(
    "--parametric/--experiments",
    default=True,
    show_default=True,
    help="Draw data under the identified law, or draw experiments with replacement.",
)
@OUTPUT
@SEED
@makes_runs
def bootstrap(
    study: Path,
    replicates: int,
    parametric: bool,
    output: Path | None,
    seed: int | None,
    options: RunOptions,
) -> None:
    """Tell how far the estimates scatter, by a bootstrap.

    The study is identified first, with the runs in its store if there are any. Then other data sets
    (replicates) are drawn, and the likelihood of each is maximized on the same response surfaces,
    without a run; a fast simulator is run itself. Prints standard errors, biases and 95 %
    intervals; writes DIR/bootstrap.json, and DIR/bootstrap.csv with every replicate. Finished
    replicates are kept in DIR/bootstrap.jsonl: after Ctrl-C, and for more replicates, the same
    command goes on from there. With --workers N, N processes do the work.
    """
    folder = folder_of(output, study)
    work = Work.on("bootstrap", study, options, folder=folder, seed=seed)
    with work.running() as (runner, progress):
        found = resample(
            identified(work.study, runner, progress, consistency=False),
            replicates=replicates,
            kind=PARAMETRIC if parametric else NONPARAMETRIC,
            seed=work.study.seed,
            workers=options.workers or 1,
            folder=folder,
            progress=progress,
        )
    work.end(
        found.to_dict(), uncertainty.bootstrap, texts={"csv": found.replicates().to_csv()},
        beside=[folder / FINISHED],
    )  # fmt: skip


@click.command()
@STUDY
@OUTPUT
@whole_number(
    "--replicates",
    99,
    "Data sets drawn from the identified law, at most; 0 for no p value.",
    least=0,
)
@NO_VERIFY
@LAW_OF
@SEED
@makes_runs
@NO_FIGURES
def ceiling(
    study: Path,
    answer: Path | None,
    output: Path | None,
    replicates: int,
    no_verify: bool,
    seed: int | None,
    no_figures: bool,
    options: RunOptions,
) -> None:
    """Tell how far any law could go, and where this one lacks.

    Takes the law from the answer that `aleator identify` stored; without one it identifies the law
    of STUDY.toml first (runs that are kept are not made again). Then finds the best possible law:
    the one, of any shape, under which the experiments are most likely. Data drawn from the
    identified law show whether chance explains how much higher the log-likelihood of the best law
    is. Tells also where the identified law lacks mass.

    If response surfaces stand for the simulator, it is run at the points of the best law to verify
    the result. Needs measurement noise. Constants, and noise that was identified, stay at their
    estimates. Writes DIR/ceiling.json, and DIR/ceiling.png if matplotlib is installed.
    """
    work = Work.on("ceiling", study, options, folder=folder_of(output, study), seed=seed)
    require_one_law(work.study.inputs)
    with work.running() as (runner, progress):
        identification = work.answered(answer, runner, progress, consistency=False)
        found = best_possible(
            identification, replicates=replicates, verify=not no_verify, seed=work.study.seed,
            progress=progress,
        )  # fmt: skip
    work.end(
        {**ceiling_document(found), "seed": work.study.seed}, models.ceiling,
        draw=None if no_figures else save_ceiling,
    )  # fmt: skip


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
@output_option("Folder of compare.json and compare.png [default: out/compare].")
@SEED
@NO_VERIFY
@makes_runs
@NO_FIGURES
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

    A study has the name of its file, or of its folder if the file is study.toml. Takes the answer
    that `aleator identify` stored in out/ and this name; a study without one is identified first
    (runs that are kept are not made again). Prints the log-likelihood, AIC, AICc and BIC, the
    predictive log-likelihood of experiments left out with the standard error of the differences,
    and likelihood ratios of nested models; writes DIR/compare.json and DIR/compare.png. Models of
    different data, or of different transforms of the outcome, are refused.
    """
    folder = output or (Path("out") / "compare").absolute()
    works = _named(studies, seed, options, not no_verify)
    make_place(folder / "compare.json", studies[0].absolute())
    with ExitStack() as stack:
        runners = [stack.enter_context(running(work.study, options)) for work in works.values()]
        progress = stack.enter_context(options.shown(folder, "Comparison of models"))
        found = {
            name: work.answered(None, runner, progress)
            for (name, work), runner in zip(works.items(), runners, strict=True)
        }
        result = compare_models(
            nested=nested, bootstrap=bootstrap, ceilings=not no_ceiling, seed=seed or 0,
            progress=progress, **found,
        )  # fmt: skip
    titles = {name: work.study.title for name, work in works.items()}
    document = documents.plain({"titles": titles, "seed": seed or 0, **result.to_dict()})
    documents.write_json(document, folder / "compare.json")
    files = [folder / "compare.json"]
    if not no_figures and can_draw(quiet=options.quiet):
        files.append(save_compare(document, folder))
    if options.watch is not None:
        options.watch.link(files)
    show_answer(models.comparison(document), [*map(short, files)], options.quiet)


def _named(
    studies: tuple[Path, ...], seed: int | None, options: RunOptions, verified: bool
) -> dict[str, Work]:
    """The work on each study by its name, in the folder where `aleator identify` writes.

    Raises AleatorError for fewer than two studies, and for equal names.
    """
    if len(studies) < 2:
        raise AleatorError(f"compare: {len(studies)} study", "name two or more")
    found: dict[str, Work] = {}
    for path in studies:
        name = name_of(path)
        if name in found:
            raise AleatorError(
                f"{path}: another study is called '{name}' too", "rename one of the files"
            )
        study = load_study(path).overridden(seed, verified=verified)
        found[name] = Work("compare", study, path.absolute(), folder_of(None, path), options)
        require_plain(name, restricted=study.restricted)
    return found


@click.command()
@STUDY
@whole_number("--draws", 1000, "Draws of each chain.", least=10)
@whole_number("--chains", 4, "Number of chains.", least=2)
@LAW_OF
@SEED
@OUTPUT
@makes_runs
def posterior(
    study: Path,
    draws: int,
    chains: int,
    answer: Path | None,
    seed: int | None,
    output: Path | None,
    options: RunOptions,
) -> None:
    """Draw from the posterior of alpha, priors included.

    The law is that of the answer that `aleator identify` stored; without one the study is
    identified first (without the check on the simulator). Then the No-U-Turn sampler draws values
    of alpha, the hyperparameters, with the exact gradient of the log-likelihood; a slow simulator
    is not run for them. A prior stands beside the limits in STUDY.toml; without one the prior is
    flat between the limits:

    \b
      mean = {lower = 0.5, upper = 1.5, prior = {law = "normal", mean = 1.0, sd = 0.1}}

    Prints mean, standard deviation and 95 % interval of each hyperparameter, with R-hat and the
    effective sample size, and whether the chains converged. Writes DIR/posterior.nc, which ArviZ
    and xarray read, DIR/posterior.csv with a row for each draw, and DIR/posterior.json. Every 50
    draws are kept in DIR/posterior.jsonl: after Ctrl-C, and for more draws, the same command goes
    on from there. Needs the packages of the extra `bayes`; a message names those that are missing.
    docs/statistics/posterior.md explains the method.
    """
    for package in (SAMPLER, "arviz_stats", "arviz_base", "h5netcdf"):
        installed(package)
    folder = folder_of(output, study)
    work = Work.on("posterior", study, options, folder=folder, seed=seed)
    with work.running() as (runner, progress):
        found = work.answered(answer, runner, progress)
        made = drawn(found, draws, chains, work.study.seed, progress, folder=folder)
    made.save(folder / "posterior.nc")
    text = made.frame().to_csv(index=False)
    document, files = work.write(
        made.to_dict(), texts={"csv": text}, beside=[folder / "posterior.nc"]
    )
    show_answer(uncertainty.posterior(document), files, options.quiet)


@click.command()
@STUDY
@whole_number("--replicates", 40, "Number of virtual data sets.", least=2)
@output_option("Write DIR/recovery.json, with every replicate.")
@SEED
@click.option(
    "--law",
    type=ANSWER,
    metavar="IDENTIFICATION.json",
    help="Take the true law from there [default: the study is identified first].",
)
@click.option(
    "--truth",
    multiple=True,
    metavar="NAME=VALUE",
    help="The true value of one hyperparameter, such as v.sd=0.03; may be given several times.",
)
@makes_runs
def recover(
    study: Path,
    replicates: int,
    output: Path | None,
    seed: int | None,
    law: Path | None,
    truth: tuple[str, ...],
    options: RunOptions,
) -> None:
    """Check that the method finds a law that is known.

    Draws virtual outcomes of the study's experiments from the simulator under a true law, and
    identifies each virtual data set as if it were measured. Tells for each hyperparameter the bias
    with its Monte Carlo error, the scatter, and how often the 95 % interval contains the truth.
    Data sets are identified in as many processes as there are processors, or in N processes with
    --workers N.
    """
    work = Work.on("recovery", study, options, folder=output, seed=seed)
    value = work.study
    with work.running() as (runner, progress):
        alpha = _truth(value, runner, law, truth, progress)
        found = recover_law(
            runner,
            value.experiments,
            value.inputs,
            alpha,
            noise=value.noise,
            propagation=value.propagation,
            density=value.density,
            search=value.search,
            restricted=value.restricted,
            small_sample=value.small_sample,
            replicates=replicates,
            seed=value.seed,
            workers=options.workers or os.cpu_count() or 1,
            progress=progress,
        )
    work.end({"seed": value.seed, **recovery_document(found)}, uncertainty.recovery)


def _truth(
    study: Study, runner: Runner, law: Path | None, given: tuple[str, ...], progress: Progress
) -> dict[str, float]:
    """The true value of each hyperparameter: the stated ones, the others from an identified law."""
    free = [h.name for h in study.hyperparameters if h.free]
    values: dict[str, float] = {}
    for entry in given:
        name, _, text = entry.partition("=")
        if name not in free:
            raise AleatorError(
                f"--truth {entry}: the study identifies no '{name}'{nearest(name, free)}",
                f"it identifies {', '.join(free)}",
            )
        try:
            values[name] = float(text)
        except ValueError:
            raise AleatorError(
                f"--truth {entry}: '{text}' is not a number", f"write --truth {name}=0.1"
            ) from None
    if law is not None:
        return {**load(law).values, **values}
    if set(free) <= set(values):
        return values
    result = identified(study, runner, progress)
    return {**{name: value.estimate for name, value in result.alpha.items()}, **values}
