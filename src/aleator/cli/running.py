"""What all commands share: options, worker processes, the store of runs, progress, results."""

from __future__ import annotations

import errno
import functools
import importlib
import importlib.util
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from aleator.core.progress import Progress, Silent
from aleator.errors import AleatorError, count, installing, short
from aleator.fit.question import start_point
from aleator.observations.experiments import Conditions
from aleator.observations.gross_errors import odd_repeats
from aleator.results import documents
from aleator.results.printed import Content, number
from aleator.results.schema import IDENTIFICATION, answer_file, read_answer
from aleator.results.units import seen_label
from aleator.simulators import ProcessPool, Runner, Store, notified
from aleator.simulators.clusters import dask_executor, mpi_executor
from aleator.study import Study, load_study
from aleator.tasks.identification import Identification
from aleator.tasks.identify import identify
from aleator.tasks.new_experiments import Exploration
from aleator.tasks.outcome_questions import runs_for_condition
from aleator.tasks.session import Runners, Session, runners_like
from aleator.views.progress import Receivers, shown_on
from aleator.views.progress_page import PROGRESS_PAGE, ProgressPage
from aleator.views.terminal import terminal


def say(text: str) -> None:
    """Print a note on the standard error."""
    click.echo(f"aleator: {text}", err=True)


@contextmanager
def shown(quiet: bool, page: ProgressPage | None = None) -> Iterator[Progress]:
    """A context that shows progress on the standard error, unless `quiet`, and in a `page`."""
    with nullcontext(Silent()) if quiet else shown_on(Console(stderr=True)) as progress:
        yield progress if page is None else Receivers((progress, page))


def can_draw(missing: str = "no figures are drawn: they need", quiet: bool = False) -> bool:
    """Whether matplotlib is installed; if not, a note says what is `missing`, unless `quiet`."""
    found = importlib.util.find_spec("matplotlib") is not None
    if not (found or quiet):
        say(f"{missing} matplotlib (pip install matplotlib)")
    return found


def can_report(quiet: bool = False) -> bool:
    """Whether Bokeh, which draws report.html, is installed; if not, a note says so.

    A `quiet` command prints no note.
    """
    try:
        require_report()
    except AleatorError as error:
        if not quiet:
            say(f"no report.html is written: {error.problem}. {error.remedy}")
        return False
    return True


def require_report() -> None:
    """Raise AleatorError if Bokeh, which draws the charts of report.html, is not installed."""
    try:
        importlib.import_module("bokeh")
    except ModuleNotFoundError:
        raise AleatorError(
            "report.html needs bokeh, which is not installed", installing("report")
        ) from None


class _Named(click.Path):
    """A type of command-line path that refuses a name too long for the file system."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            os.lstat(value)
        except OSError as error:
            if error.errno == errno.ENAMETOOLONG:
                self.fail(f"{str(value)[:40]}...: the name is too long", param, ctx)
        return super().convert(value, param, ctx)


class _Placed(_Named):
    """A type of command-line path that is made absolute: a simulator may change the folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        path: Path = super().convert(value, param, ctx)
        return path.absolute()


FILE = _Named(path_type=Path)
"""The type of a command-line argument: a file that is read before the simulator runs."""
RESULT = _Placed(path_type=Path, dir_okay=False)
"""The type of a command-line argument: a file that is written, or read after runs."""
ANSWER = _Placed(path_type=Path)
"""The type of a command-line argument: an answer's file, or the folder that has it."""
FOLDER = _Placed(path_type=Path, file_okay=False)
"""The type of a command-line argument: a folder."""
STUDY = click.argument("study", type=FILE, metavar="STUDY.toml")
NO_FIGURES = click.option("--no-figures", is_flag=True, help="Draw no figure.")
NO_VERIFY = click.option("--no-verify", is_flag=True, help="Leave out the check on the simulator.")
SEED = click.option(
    "--seed", type=click.IntRange(min=0), help="Seed of everything random [default: the study's]."
)


def output_option(help: str) -> Callable[..., Any]:
    """A command-line option --output that names a folder."""
    return click.option("--output", type=FOLDER, metavar="DIR", help=help)


OUTPUT = output_option("Folder of the results [default: out/ and the name of the study's folder].")
"""The option --output for the folder of results; `folder_of` gives its default."""


LAW_OF = click.option(
    "--answer",
    type=ANSWER,
    metavar="IDENTIFICATION.json",
    help="Take the law from there [default: from the folder of the results or, if there is none of "
    "this study, the study is identified first].",
)
"""The option --answer for a stored identification; `Work.answered` gives its default."""


def whole_number(name: str, default: int, help: str, least: int = 1) -> Callable[..., Any]:
    """A command-line option for a whole number that is not below `least`."""
    kind = click.IntRange(min=least)
    return click.option(name, type=kind, default=default, show_default=True, help=help)


def require_at_most_one(options: Mapping[str, Any]) -> None:
    """Raise AleatorError if more than one of these options has a value other than None.

    >>> require_at_most_one({"--above": 1.0, "--below": None})
    """
    chosen = [name for name, value in options.items() if value is not None]
    if len(chosen) > 1:
        raise AleatorError(f"{' and '.join(chosen)} contradict each other", "choose one of them")


@dataclass(frozen=True)
class RunOptions:
    """The options of a command about runs: the store that keeps them and the workers they use.

    `store` is the file that keeps runs; None means the file that the study names. At most one of
    `workers`, `dask` and `mpi` is given; without any of them this process makes the runs. `watch`
    is the page of progress, if one is requested.
    """

    store: Path | None
    no_store: bool
    workers: int | None
    dask: str | None
    mpi: bool
    quiet: bool
    watch: ProgressPage | None

    def say(self, text: str) -> None:
        """Print a note on the standard error, unless the command has the option --quiet."""
        if not self.quiet:
            say(text)

    def shown(self, folder: Path | None, title: str) -> AbstractContextManager[Progress]:
        """A context that shows progress; a page, if requested, begins here in `folder`."""
        if self.watch is not None and folder is not None:
            self.watch.open(folder, title, f"aleator {click.get_current_context().info_name}")
            self.say(f"progress: {short(folder / PROGRESS_PAGE)}")
        return shown(self.quiet, self.watch)


def makes_runs(command: Callable[..., Any]) -> Callable[..., Any]:
    """A decorator for a command: adds options that reach it as one RunOptions, `options`."""

    @click.option(
        "--store",
        type=RESULT,
        metavar="FILE",
        help="Keep the runs there [default: the study's, runs.sqlite beside it].",
    )
    @click.option("--no-store", is_flag=True, help="Keep no runs, and use none.")
    @click.option(
        "--workers",
        type=click.IntRange(min=1),
        metavar="N",
        help="Run the simulator in N processes at once; the answer is the same unless N is large "
        "(docs/runs.md) [default: in this one].",
    )
    @click.option(
        "--dask",
        metavar="ADDRESS",
        help="Run it on the workers of a Dask cluster: its scheduler's address, or its file.",
    )
    @click.option(
        "--mpi", is_flag=True, help="Run it in the processes of this MPI job (docs/clusters.md)."
    )
    @click.option(
        "--quiet",
        is_flag=True,
        help="Show neither progress nor notes, and of the report only what it concludes.",
    )
    @click.option(
        "--watch",
        is_flag=True,
        help="Write DIR/progress.html as well, which a browser reads again every few seconds.",
    )
    @functools.wraps(command)
    def collected(**given: Any) -> Any:
        chosen = {field.name: given.pop(field.name) for field in fields(RunOptions)}
        if chosen["dask"] and chosen["dask"].endswith(".json"):
            chosen["dask"] = str(Path(chosen["dask"]).absolute())
        with ProgressPage() if chosen["watch"] else nullcontext() as chosen["watch"]:
            return command(options=RunOptions(**chosen), **given)

    return collected


def require_folder(options: RunOptions, folder: Path | None) -> None:
    """Raise AleatorError if a page of progress is requested and there is no folder for it."""
    if options.watch is not None and folder is None:
        raise AleatorError(f"--watch: {PROGRESS_PAGE} has no folder", "add --output")


@contextmanager
def running(
    study: Study, options: RunOptions, conditions: Conditions | None = None
) -> Iterator[Runner]:
    """A context with the runner of a study, which runs the simulator for a command.

    At the end a note tells how many runs were made, workers and store are closed, and the current
    folder is restored. Raises SimulatorError if the first run of a function would end this process.
    """
    require_at_most_one({"--store": options.store, "--no-store": options.no_store or None})
    with (
        _workers(options) as executor,
        nullcontext() if options.no_store else Store(options.store or study.store) as kept,
        _folder_kept(),
    ):
        runner = study.runner(conditions, kept, executor)
        tell = None if options.quiet else say
        first = np.clip(start_point(study.inputs), *study.inputs.box.T)
        with (
            closing(study),
            notified(runner.cache, str(study.file), tell),
            runner.survived(first),
        ):
            if options.watch is not None:
                options.watch.counts(lambda: runner.runs)
            yield runner
            made = runner.fresh if kept is None else kept.added
            if made and tell is not None:
                tell(f"note: made {count(made, 'run')} of the simulator")


def identified(
    study: Study,
    runner: Runner,
    progress: Progress,
    *,
    best_law: bool = False,
    **further: Any,
) -> Identification:
    """The identification of a study with the runs of `runner`.

    `further` are arguments of `aleator.identify` that the study does not state.
    """
    runner.progress = progress
    return identify(
        runner,
        study.experiments,
        study.inputs,
        noise=study.noise,
        propagation=study.propagation,
        density=study.density,
        search=study.search,
        verification=study.verification,
        restricted=study.restricted,
        small_sample=study.small_sample,
        seed=study.seed,
        progress=progress,
        best_law=best_law,
        units=study.units,
        **further,
    )


def tell_expected_runs(
    options: RunOptions,
    surface: Mapping[str, Any] | None,
    runner: Runner,
    what: str,
    *,
    event: bool = False,
) -> None:
    """Print a note on how many runs the response surfaces of new conditions will take.

    `surface` tells of those of the identification, and `what` names the conditions of the runner.
    As many runs are expected for each as each experiment of the study took. An event takes a round
    of runs more, which look for other regions of it. Which of the runs that are stored under these
    conditions will be needed is not known before: those of the same surface, if it was made before.
    """
    each = runs_for_condition(surface, event=event)
    if not each:
        return
    size, searching = len(runner.cases), Exploration().runs if event else 0
    seeking = f", {size * searching:,} of them to look for other regions of the event"
    took, stored, cache = "", "", runner.cache
    if cache is not None:
        if cache.at_start.runs:
            second = number(cache.at_start.seconds / cache.at_start.runs, 2)
            took = f", {second} s a run"
        known = count(int(cache.by_case().sum()), "run")
        stored = f"; {known} under {'it' if size == 1 else 'them'} in the store, not made again"
    options.say(
        f"note: some {size * each:,} runs for {'a surface' if size == 1 else 'surfaces'} of "
        f"{count(size, what)}, as in the identification{seeking if event else ''}{took}{stored}"
    )


def tell_odd_repeats(study: Study, options: RunOptions) -> None:
    """Print a note on each experiment with another number of rows than all the others."""
    table = study.experiments
    for odd in odd_repeats([table.ids[k] for k in table.experiment.tolist()], table.places):
        options.say(f"note: {odd}")


def joined(study: Study, document: Mapping[str, Any], runner: Runners) -> Identification:
    """The identification of a document, joined with its study; `runner` makes runners of tables."""
    found = Identification.from_document(document)
    session = Session.again(
        found, study.file, study.inputs, study.noise, study.experiments, study.propagation,
        study.density, runner,
    )  # fmt: skip
    return replace(found, session=session)


def units_in(study: Study) -> dict[str, Any]:
    """Entries for the document of a result: the units, and the transform of each response."""
    responses = study.experiments.observations.responses
    return {
        "units": dict(study.units),
        "responses": {each.name: str(each.transform) for each in responses},
    }


def linked(
    result: Mapping[str, Any], study: Study, study_file: Path, folder: Path
) -> dict[str, Any]:
    """The document of a result, with the title, the file and the hash of its study added.

    The study file is named relative to `folder`, so that both can be moved together.
    """
    known = units_in(study)
    entry = {
        "file": Path(os.path.relpath(study_file, folder)).as_posix(),
        "sha256": study.sha256,
        "outcome": ", ".join(seen_label(known, name) for name in known["responses"]),
    }
    return {"title": study.title, "study": entry, **result}


def name_of(study: Path) -> str:
    """The name of a study: the name of its file, or of its folder if the file is study.toml."""
    return study.resolve().parent.name if study.stem == "study" else study.stem


def folder_of(output: Path | None, study: Path) -> Path:
    """The folder of the results: `output`, or by default a folder in out/ named as the study."""
    return output or (Path("out") / name_of(study)).absolute()


@contextmanager
def _folder_kept() -> Iterator[None]:
    """A context that restores the current folder, which importing a simulator may change."""
    here = click.get_current_context().obj
    try:
        yield
    finally:
        if here is not None:
            with suppress(OSError):  # The folder may have been removed.
                os.chdir(here)


def make_place(result: Path, study: Path | None = None) -> None:
    """Make the folder of a result, and print a note if an older result will be replaced.

    Raises AleatorError if the older result belongs to another study.
    """
    documents.make_folder(result.parent)
    if note := documents.replaced(result, study):
        say(f"note: {note}")


def _workers(options: RunOptions) -> AbstractContextManager[Executor | None]:
    """The executor (processes, Dask or MPI) that the options choose; None for this process."""
    require_at_most_one(
        {"--workers": options.workers, "--dask": options.dask, "--mpi": options.mpi or None}
    )
    if options.dask:
        return dask_executor(options.dask, options.say)
    if options.mpi:
        return mpi_executor()
    return nullcontext() if options.workers is None else _processes(options.workers)


@contextmanager
def _processes(number: int) -> Iterator[Executor]:
    """A context with a pool of processes; Ctrl-C cancels the runs that have not begun."""
    pool = ProcessPool(number)
    try:
        yield pool
    except KeyboardInterrupt:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    finally:
        pool.shutdown()


Document = Mapping[str, Any]


@dataclass(frozen=True)
class Work:
    """A command with its study, its options and the folder of its results.

    `name` begins the names of the files that are written; if `folder` is None no file is written.
    """

    name: str
    study: Study
    file: Path
    folder: Path | None
    options: RunOptions

    @classmethod
    def on(
        cls,
        name: str,
        file: Path,
        options: RunOptions,
        *,
        folder: Path | None,
        seed: int | None,
        verified: bool = False,
    ) -> Work:
        """The work of the command `name` on a study file, which is read here.

        `seed` replaces the seed of the study unless it is None. Only with `verified` the check on
        the simulator is made.
        """
        require_folder(options, folder)
        study = load_study(file).overridden(seed, verified=verified)
        return cls(name, study, file.absolute(), folder, options)

    @contextmanager
    def running(self, conditions: Conditions | None = None) -> Iterator[tuple[Runner, Progress]]:
        """A context with the runner of the study and its progress; makes the folder of the results.

        A command checks its arguments before it enters, because a simulator may be slow.
        """
        if self.folder is not None:
            make_place(self.folder / f"{self.name}.json", self.file)
        with (
            running(self.study, self.options, conditions) as runner,
            self.options.shown(self.folder, self.study.title or self.name) as progress,
        ):
            yield runner, progress

    def answered(
        self, answer: Path | None, runner: Runner, progress: Progress, **further: Any
    ) -> Identification:
        """The stored answer of the study with its fit; the study identified where there is none.

        `answer` names the file. By default it is in the folder of the results, or in the one where
        `aleator identify` writes. The study is identified if there is no such file, or if it does
        not serve, which a note says. `further` are arguments of `aleator.identify`. Raises
        AleatorError if the named file does not serve.
        """
        found = self._stored(answer, runner, progress)
        if found is not None:
            return found
        progress.stage(f"{name_of(self.file)}: identification")
        return identified(self.study, runner, progress, **further)

    def _stored(
        self, answer: Path | None, runner: Runner, progress: Progress
    ) -> Identification | None:
        """The stored answer of the study with its fit; None where none serves."""
        folders = [self.folder, folder_of(None, self.file)]
        usual = [folder / IDENTIFICATION for folder in folders if folder is not None]
        there = [one for one in usual if one.is_file()] if answer is None else [answer_file(answer)]
        if not there:
            return None
        try:
            document = read_answer(there[0])
            if self.study.sha256 != documents.study_entry(document).get("sha256"):
                raise AleatorError(
                    f"{short(there[0])} was not identified from {short(self.file)} as it is now",
                    "identify again, or name the answer of this study",
                )
            runners = runners_like(runner, self.study.experiments)
            found = joined(self.study, document, runners).with_fit(progress)
        except AleatorError as error:
            if answer is not None:
                raise
            self.options.say(f"note: {short(self.file)} is identified again: {error.problem}")
            return None
        self.options.say(f"note: the law is that of {short(there[0])}")
        return found

    def end(self, made: Document, content: Callable[[Document], Content], **files: Any) -> None:
        """Store a result and its `files` by `write`, and print the text of `content`."""
        document, names = self.write(made, **files)
        show_answer(content(document), names, self.options.quiet)

    def write(
        self,
        made: Document,
        *,
        texts: Mapping[str, str] = {},
        beside: Sequence[Path] = (),
        draw: Callable[[Document, Path], Path] | None = None,
    ) -> tuple[Document, list[str]]:
        """Write a result; returns its document and the names of all files.

        `texts` are the texts of further files by ending ("csv"), `beside` files that exist already;
        `draw` writes a figure of the document if matplotlib is installed.
        """
        made, files = {**units_in(self.study), **made}, []
        if self.folder is None:
            return documents.plain({"title": self.study.title, **made}), []
        document = documents.plain(linked(made, self.study, self.file, self.folder))
        files.append(self.folder / f"{self.name}.json")
        documents.write_json(document, files[0])
        for ending, text in texts.items():
            files.append(self.folder / f"{self.name}.{ending}")
            documents.write_text(text, files[-1])
        files += beside
        if draw is not None and can_draw("no figure is drawn: it needs", self.options.quiet):
            files.append(draw(document, self.folder))
        if self.options.watch is not None:
            self.options.watch.link(files)
        return document, [short(file) for file in files]


def show_answer(content: Content, files: Sequence[str] = (), quiet: bool = False) -> None:
    """Print the report of a result with the names of its files; only its verdict if `quiet`."""
    if quiet:
        click.echo(content.verdict)
    else:
        Console().print(terminal(content, files))
