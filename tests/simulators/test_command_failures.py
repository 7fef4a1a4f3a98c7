"""A program that is missing, crashes, prints garbage or writes nothing: one message each."""

import pickle
from pathlib import Path

import pytest
from programs import failing, script

from aleator.errors import SimulatorError, SurroundingsError
from aleator.simulators import RunFailed
from aleator.simulators.command import (
    CommandSimulator,
    CsvOutput,
    Delimiters,
    HookOutput,
    InputFile,
    JsonFeed,
    JsonOutput,
    Keep,
    OutputFile,
    RegexOutput,
    Template,
)

# ------------------------------------------------------------------- before anything runs


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["./progam"], r"program './progam' does not exist.*'program'"),
        (["./model.py"], r'may not be executed\n.*\["python3", "\{study\}/model.py"'),
        (["./text"], r"may not be executed\n.*chmod \+x ./text"),
        (["./folder"], r"program './folder' is a folder"),
        (["program"], r"is not on the PATH\n.*write './program'"),
        (["no_such_program_anywhere"], r"is not on the PATH\n.*install it"),
        (["./{x}"], r"program './\{x\}' changes from run to run"),
        ([], "the command is empty"),
        ("./program 'open", "cannot be cut into arguments"),
    ],
)
def test_a_command_that_cannot_be_run(tmp_path: Path, command: list[str], message: str) -> None:
    script(tmp_path, "echo 1")
    (tmp_path / "folder").mkdir()
    for name in ("model.py", "text"):
        (tmp_path / name).write_text("")
    with pytest.raises(SimulatorError, match=message):
        CommandSimulator(command, base=tmp_path)


def test_a_list_is_not_for_a_shell() -> None:
    with pytest.raises(SimulatorError, match="write the command as one text"):
        CommandSimulator(["echo", "1"], shell=True)


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"files": ("mesh.dta",)}, r"'mesh.dta' does not exist.*'mesh.dat'"),
        ({"files": ("mesh.dat", "more/mesh.dat")}, "two of the files are named 'mesh.dat'"),
        ({"timeout": 0.0}, "timeout = 0"),
        ({"timeout": float("inf")}, "timeout = inf"),
        ({"success_codes": ()}, "every run would fail"),
    ],
)
def test_choices_that_cannot_be(tmp_path: Path, choices: dict[str, object], message: str) -> None:
    (tmp_path / "more").mkdir()
    for name in ("mesh.dat", "more/mesh.dat"):
        (tmp_path / name).write_text("1")
    with pytest.raises(SimulatorError, match=message):
        CommandSimulator(["true"], base=tmp_path, **choices)  # type: ignore[arg-type]


def test_inputs_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "in.tpl").write_text("{x}")
    with pytest.raises(SimulatorError, match=r"'in.tpl'"):
        Template(tmp_path / "inn.tpl")
    template = Template(tmp_path / "in.tpl")
    for name in ("../in.dat", "/in.dat", ""):
        with pytest.raises(SimulatorError, match="not a file in the folder of a run"):
            InputFile(name, template)
    with pytest.raises(SimulatorError, match="is a file of the run already"):
        CommandSimulator(
            ["true"], base=tmp_path, files=("in.tpl",), inputs=(InputFile("in.tpl", template),)
        )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RegexOutput("stdout", "time = ("), "the regex 'time = .' is wrong"),
        (lambda: RegexOutput("stdout", "time"), "has 0 groups"),
        (lambda: RegexOutput("stdout", "(a)(b)"), "has 2 groups"),
        (lambda: CsvOutput("stdout", 0, delimiter=", "), "one character"),
        (lambda: OutputFile("/tmp/result.txt"), "not a file in the folder of a run"),
        (lambda: HookOutput("nowhere.py:outcome"), "nowhere.py does not exist"),
    ],
)
def test_outputs_that_cannot_be(make: object, message: str) -> None:
    with pytest.raises(SimulatorError, match=message):
        make()  # type: ignore[operator]


def test_placeholders_and_parameters_must_meet(tmp_path: Path) -> None:
    (tmp_path / "in.tpl").write_text("{stifness}")
    inputs = (InputFile("in.dat", Template(tmp_path / "in.tpl")),)
    told = CommandSimulator(["echo", "{load}"])
    with pytest.raises(SimulatorError, match=r"never told the parameter 'stiffness'"):
        told.asks(["load"], ["stiffness"])
    with pytest.raises(SimulatorError, match=r"the command: 'load' is neither.*mean 'loads'"):
        told.asks(["loads"], [])
    with pytest.raises(SimulatorError, match=r"'load' is both a condition and a parameter"):
        told.asks(["load"], ["load"])
    with pytest.raises(SimulatorError, match=r"template in.tpl: 'stifness'.*'stiffness'"):
        CommandSimulator(["true"], inputs=inputs).asks([], ["stiffness"])
    with pytest.raises(SimulatorError, match=r"'input' stands for the input file"):
        CommandSimulator(["cat", "{input}"], inputs=inputs).asks([], ["stifness", "input"])
    assert CommandSimulator(["echo", "{load}"], allow_unused=True).asks(["load"], ["k"]) == (
        "load",
    )
    assert CommandSimulator(["cat"], stdin=JsonFeed()).asks(["a", "b"], ["k"]) == ("a", "b")


def test_braces_that_are_no_placeholders_are_told_of(tmp_path: Path) -> None:
    (tmp_path / "in.json").write_text('{"a": {x}, "b": {"c": 3}}')
    template = Template(tmp_path / "in.json")
    with pytest.raises(SimulatorError, match="choose other delimiters for a file"):
        CommandSimulator(["true"], stdin=template).asks([], ["x"])
    (tmp_path / "in.json").write_text('{"a": <x>, "b": {"c": 3}}')
    template = Template(tmp_path / "in.json", Delimiters("<", ">"))
    assert template.names == ("x",)


# ------------------------------------------------------------------------- while it runs


def test_a_crash_is_told_with_its_last_words_and_its_folder_is_kept(tmp_path: Path) -> None:
    failure = failing(tmp_path, "echo begun; echo 'pressure too high' >&2; exit 3")
    assert failure.log == "begun\npressure too high"
    (kept,) = (tmp_path / "failed_runs").iterdir()
    assert failure.message == f"it ended with exit code 3 (kept in {kept})"
    assert (kept / "aleator.stdout").read_text() == "begun\n"
    copy = pickle.loads(pickle.dumps(failure))
    assert (copy.message, copy.log) == (failure.message, failure.log)


def test_other_exit_codes_may_be_a_success(tmp_path: Path) -> None:
    program = script(tmp_path, "echo 5; exit 3")
    assert CommandSimulator([program], base=tmp_path, success_codes=(0, 3)).run_one({}, {}) == 5


def test_nothing_is_kept_if_nothing_is_wanted(tmp_path: Path) -> None:
    assert failing(tmp_path, "exit 1", keep=Keep.NONE).message == "it ended with exit code 1"
    assert not (tmp_path / "failed_runs").exists()


def test_failed_runs_do_not_fill_the_disk(tmp_path: Path) -> None:
    for k in range(100):
        (tmp_path / f"failed_runs/{k}").mkdir(parents=True)
    assert "holds 100 runs" in failing(tmp_path, "exit 1").message
    assert len(list((tmp_path / "failed_runs").iterdir())) == 100


def test_a_signal_has_a_name(tmp_path: Path) -> None:
    assert failing(tmp_path, "kill -SEGV $$").message.startswith("it was ended by SIGSEGV")


@pytest.mark.parametrize(
    ("output", "text", "message"),
    [
        (
            OutputFile("result.txt"),
            "echo 1 > result.tx",
            r"no file 'result.txt' \(did you mean 're",
        ),
        (OutputFile(), "echo garbage", r"outcome in 'stdout' is 'garbage', not a number"),
        (OutputFile(), "echo 1_000", r"outcome in 'stdout' is '1_000', not a number"),
        (CsvOutput(), "head -c 200000 /dev/zero | tr '\\0' 1", "is not a table: field larger"),
        (OutputFile(), "true", r"outcome in 'stdout' is empty, not a number"),
        (OutputFile(), "echo NaN", "is NaN, which is not finite"),
        (OutputFile(), "echo -inf", "is -inf, which is not finite"),
        (RegexOutput("stdout", "t = (.*)"), "echo t: 3", "matches nothing in 'stdout'"),
        (RegexOutput("stdout", "t = (.*)", 2), "echo t = 3", "matches 1 times"),
        (CsvOutput("stdout", "time"), "echo tim,x", r"no column 'time' \(did you mean 'tim'"),
        (CsvOutput("stdout", "time"), "echo time", "has 0 rows"),
        (CsvOutput("stdout", 2), "echo 1,2", "has 2 columns"),
        (JsonOutput("stdout", "a"), "echo '{'", "'stdout' is not JSON"),
        (
            JsonOutput("stdout", "a.time"),
            """echo '{"a": {"tim": 1}}'""",
            r"mean 'tim'.*has tim there",
        ),
        (JsonOutput("stdout", "a.1"), """echo '{"a": [1]}'""", "no '1' at a; it has 1 entries"),
        (JsonOutput("stdout", "a"), """echo '{"a": null}'""", "is None, not a number"),
    ],
)
def test_an_outcome_that_is_not_there(
    tmp_path: Path, output: OutputFile, text: str, message: str
) -> None:
    failure = failing(tmp_path, text, output=output)
    with pytest.raises(RunFailed, match=message):
        raise failure


def test_a_hook_that_fails(tmp_path: Path) -> None:
    (tmp_path / "failing_hook.py").write_text(
        "def raises(folder, stdout):\n    return 1 / 0\n\n"
        "def text(folder, stdout):\n    return '3'\n\n"
        "def row(folder, stdout):\n    return [3]\n"
    )
    raises = HookOutput("failing_hook.py:raises", tmp_path)
    message = failing(tmp_path, "true", output=raises).message
    assert "raised ZeroDivisionError: division by zero (failing_hook.py, line 2)" in message
    text = HookOutput("failing_hook.py:text", tmp_path)
    assert "returned '3', not a number" in failing(tmp_path, "true", output=text).message
    row = HookOutput("failing_hook.py:row", tmp_path)
    assert "returned [3], not a number" in failing(tmp_path, "true", output=row).message


def test_a_program_that_is_not_one_for_this_machine(tmp_path: Path) -> None:
    (tmp_path / "program").write_bytes(b"\x7fELF garbage")
    (tmp_path / "program").chmod(0o755)
    with pytest.raises(SurroundingsError, match="cannot be started: Exec format error"):
        CommandSimulator(["./program"], base=tmp_path).run_one({}, {})


def test_a_value_that_does_not_have_the_format() -> None:
    with pytest.raises(RunFailed, match=r"'A' of 'bench' cannot be written with the format '.3f'"):
        CommandSimulator(["echo", "{bench:.3f}"], keep=Keep.NONE).run_one({"bench": "A"}, {})
