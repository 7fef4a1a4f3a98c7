"""What commands ask of a study or of its law: what is written and said, and misuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from studies import done, estimate, read, refused, shown_again

from aleator.cli import running
from aleator.study import load_study
from aleator.views.figures import check_figure

LAW = "out/identification.json"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(**texts: str) -> None:
    """Files into the current folder; an ending that is not told is .csv."""
    for name, text in texts.items():
        ending = {"model": "py", "study": "toml"}.get(name, "csv")
        Path(f"{name}.{ending}").write_text(text)


# ------------------------------------------------------------------------------ check

CHECKED = """\
[experiments]
file = "springs.csv"
outcome = "travel"
[simulator]
function = "model.py:spring"
[parameters.stiffness]
law = "truncated_normal"
box = [2.0, 6.0]
[parameters.idle]
law = "constant"
value = {lower = 0, upper = 1}
"""


@pytest.mark.usefixtures("folder")
def test_check_tells_what_is_out_of_reach_and_idle_and_its_runs_are_kept() -> None:
    write(
        springs="id,force,travel\nA,10,4.9\nB,20,10.2\nC,30,15.4\nD,40,12\nE,50,8\n",
        model="def spring(force, stiffness, idle):\n    return force / stiffness\n",
        study=CHECKED,
    )
    first = done("check", "study.toml", "--output", "out")
    result = read("out/check.json")
    assert result["out_of_reach"] == ["C", "E", "B"]
    assert [row["influence"] for row in result["parameters"]] == [True, False]
    assert result["runs"] == 5 * 9 + 3  # a step from the limit for each value out of reach
    assert result["seconds_a_run"] > 0.0
    assert (result["cost"]["direct"], result["array_fault"]) == (True, "")
    assert result["fixed_noise"] == {}
    assert "45 runs: 9 points under 5 of 5" in first.stderr
    assert "aleator identify" not in first.stdout  # three values are to be looked at before
    shown_again(first, "out/check.json")
    figure = check_figure(result)
    labels = [axes.get_xlabel() for axes in figure.axes if axes.get_visible()]
    assert labels == ["stiffness", "idle"]
    assert len(figure.axes[0].lines) == 5
    assert Path("out/check.png").stat().st_size > 10_000
    again = done("check", "study.toml", "--output", "out", "--no-figures", "--quiet")
    assert "3 of 5 measured values are out of reach" in again.stdout
    assert read("out/check.json")["observations"] == result["observations"]
    assert "48" in done("runs", "list", "study.toml").output


def write_logarithmic(springs: str) -> None:
    """A study of the logarithm of the travel, with noise and a function that takes arrays."""
    write(
        springs=springs,
        model="def spring(force, stiffness, idle):\n    return force / stiffness\n",
        study=CHECKED.replace('"travel"\n', '"travel"\ntransform = "log"\n').replace(
            ':spring"\n', ':spring"\nvectorized = true\n'
        )
        + "[noise]\nsd = 0.1\n",
    )


@pytest.mark.usefixtures("folder", "unreported", "unjudged_commands")
def test_an_experiment_without_a_run_is_told_and_outcomes_are_in_their_own_unit() -> None:
    write_logarithmic("id,force,travel\nA,10,4\nB,-20,6\nC,30,25\nD,40,15\n")
    said = done("check", "study.toml", "--output", "out", "--no-figures", "--quiet").stdout
    assert "All 4 measured" not in said
    assert "Of 1 experiment no run works" in said
    result = read("out/check.json")
    assert [*result["lost"]] == ["B"]
    assert all(word in result["lost"]["B"] for word in ("line 3", "force = -20", "logarithm of"))
    assert result["out_of_reach"] == ["C"]
    assert result["fixed_noise"] == {"travel": {"sd": 0.1}}
    of = {row["id"]: row for row in result["observations"]}
    assert of["C"]["reached"] == pytest.approx([5.0, 15.0])
    assert of["C"]["beyond"] == pytest.approx(25.0 - 15.0)
    assert of["C"]["accepted"] == pytest.approx([25.0 * np.exp(-0.3), 25.0 * np.exp(0.3)])
    assert result["measured"]["travel"] == pytest.approx([4.0, 25.0])
    assert result["parameters"][0]["moves_at_most"]["travel"] == pytest.approx(40 / 2 - 40 / 6)
    identified = done("identify", "study.toml", "--no-figures", "--quiet").stdout
    assert "Left out: 1 of 4 experiments" in identified


# ------------------------------------------------------------------------------ sensitivity

SCREENED = """\
title = "Springs"
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
vectorized = true
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
[parameters.slack]
law = "constant"
value = {lower = 0.0, upper = 2.0}
[parameters.twist]
law = "constant"
value = {lower = 0.0, upper = 1.0}
"""


@pytest.mark.usefixtures("folder")
def test_sensitivity_prints_tables_writes_files_and_obeys_its_options() -> None:
    write(
        springs="id,load,length\nA,1,1.0\nB,2,2.0\nC,4,4.0\n",
        model="def length(load, softness, slack, twist):\n"
        "    return load * (softness + 0.1 * twist) + slack\n",
        study=SCREENED,
    )
    shown = done("sensitivity", "study.toml", "--output", "out")
    assert "softness, twist" in shown.stdout  # both act in proportion to the load
    shown_again(shown, "out/sensitivity.json")
    result = read("out/sensitivity.json")
    assert [row["parameter"] for row in result["parameters"]] == ["slack", "softness", "twist"]
    assert result["study"]["outcome"] == "length"
    assert result["runs"] == 3 * result["expansion"]["runs"]
    # variances load^2/12, 4/12, load^2/1200
    first = {row["id"]: row["first"] for row in result["experiments"]}
    assert first["A"]["softness"] == pytest.approx(1.0 / (1.0 + 4.0 + 0.01))
    assert first["C"]["slack"] == pytest.approx(4.0 / (16.0 + 4.0 + 0.16))
    table = pd.read_csv("out/sensitivity.csv")
    assert len(table) == 9
    assert table["first"].sum() == pytest.approx(3.0)
    assert Path("out/sensitivity.png").stat().st_size > 10_000
    for file in ("json", "csv", "png"):
        assert f"sensitivity.{file}" in shown.stdout
    options = ("--runs", 20, "--experiments", "C, A", "--no-figures", "--quiet", "--seed", 5)
    for folder in ("one", "two"):
        quiet = done("sensitivity", "study.toml", "--output", folder, *options)
        assert (quiet.stderr, quiet.stdout.count("\n")) == ("", 1)
    result = read("one/sensitivity.json")
    assert [row["id"] for row in result["experiments"]] == ["C", "A"]
    assert (result["expansion"]["runs"], result["seed"]) == (20, 5)
    assert not Path("one/sensitivity.png").exists()
    assert Path("two/sensitivity.csv").read_bytes() == Path("one/sensitivity.csv").read_bytes()
    assert "'D'" in refused("sensitivity", "study.toml", "--experiments", "A,D")


# ------------------------------------------------------------------------------ next

NEXT = """\
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
vectorized = true
[parameters.softness]
law = "normal"
mean = {lower = 0.2, upper = 3.0}
sd = {lower = 0.001, upper = 1.0}
[noise]
sd = 0.1
"""


@pytest.fixture
def to_measure(folder: Path) -> None:
    rng = np.random.default_rng(3)
    load = np.tile([1.0, 2.0, 3.0], 8)
    length = load * (1.0 + 0.15 * rng.standard_normal(24)) + 0.1 * rng.standard_normal(24)
    pd.DataFrame({"load": load, "length": length}).to_csv(folder / "springs.csv", index=False)
    write(
        model="def length(load, softness): return load * softness\n",
        study=NEXT,
        new="id,load\nA,0.5\nB,1\nC,6\n",
        use="id,load\nuse,5\n",
    )


@pytest.mark.usefixtures("to_measure")
def test_next_prints_tables_and_writes_files() -> None:
    asked = ("next", "study.toml", "--candidates", "new.csv")
    shown = done(*asked, "--count", 2, "--output", "out")
    assert "softness.sd" in shown.stdout
    shown_again(shown, "out/next.json")
    result = read("out/next.json")
    assert [row["id"] for row in result["candidates"]] == ["C", "B", "A"]
    assert [row["id"] for row in result["chosen"]] == ["C", "B"]
    table = pd.read_csv("out/next.csv", index_col="id")
    assert table.loc["C", "standard_error"] < table.loc["A", "standard_error"]
    given = ("--count", 4, "--repeat", 4, "--quiet", "--for-prediction", "use.csv")
    quiet = done(*asked, *given, "--event", "length > 6", "--no-noise")
    assert quiet.stdout.count("\n") == 1
    assert "4 experiments" in quiet.stdout
    # Without names the candidates are numbered.
    pd.read_csv("springs.csv").to_csv("springs.csv", index_label="rod")
    Path("study.toml").write_text(NEXT.replace("[experiments]", '[experiments]\nid = "rod"'))
    Path("new.csv").write_text("load\n0.5\n1\n6\n")
    done(*asked, "--count", 2, "--output", "out")
    assert [row["id"] for row in read("out/next.json")["chosen"]] == ["3", "2"]


@pytest.mark.usefixtures("to_measure", "unreported", "unjudged_commands")
def test_next_takes_the_stored_answer_of_the_same_study_only() -> None:
    asked = ("next", "study.toml", "--candidates", "new.csv", "--count", 1, "--output", "out")
    done(*asked)
    before = read("out/next.json")
    done("identify", "study.toml", "--output", "out", "--no-figures", "--quiet")
    assert "search" not in done(*asked).stderr
    after = read("out/next.json")
    assert after["now"] == pytest.approx(before["now"], rel=1e-5)
    found, expected = (
        {row["id"]: row["standard_error"] for row in one["candidates"]} for one in (after, before)
    )
    assert found == pytest.approx(expected, rel=1e-5)
    Path("study.toml").write_text(NEXT.replace("sd = 0.1", "sd = 0.2"))
    assert "identification.json was not" in refused(*asked, "--answer", "out")
    assert "identified again" in done(*asked).stderr
    assert read("out/next.json")["now"] != pytest.approx(before["now"], rel=1e-2)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("--count 4", "4 experiments of 3 candidates"),
        ("--for softness.s", "did you mean"),
        ("--for noise.sd", "is fixed"),
        ("--event y>6", "--for-prediction"),
        ("--for-prediction use.csv --no-noise", "--event"),
        ("--for all --for-prediction use.csv", "contradict"),
        ("--for-prediction use.csv --event y>1 --quantile 0.9", "contradict"),
    ],
)
@pytest.mark.usefixtures("to_measure")
def test_misuse_of_next_is_told_before_anything_is_run(given: str, told: str) -> None:
    asked = ("next", "study.toml", "--candidates", "new.csv", "--count", "2")
    assert told in refused(*asked, *given.split())
    assert not Path("runs.sqlite").exists()


@pytest.mark.usefixtures("to_measure")
def test_candidates_of_a_level_that_no_experiment_has_are_told_before_anything_is_run() -> None:
    table = pd.read_csv("springs.csv")
    table.assign(oil=["a", "b"] * 12).to_csv("springs.csv", index=False)
    study = NEXT.replace("mean = {", 'mean = {formula = "1 + oil", ')
    write(
        model="def length(load, softness): return load * softness\n",
        study=study,
        new="id,load,oil\nA,1,a\nB,1,c\n",
    )
    asked = ("next", "study.toml", "--candidates", "new.csv", "--count", "1")
    assert "the level 'c'" in refused(*asked)
    assert not Path("runs.sqlite").exists()


# ------------------------------------------------------------------------------ bootstrap, ceiling

LEVELS = """
[experiments]
file = "table.csv"
outcome = "y"
[simulator]
function = "model.py:model"
vectorized = true
[parameters.x]
law = "normal"
mean = {lower = 0, upper = 5}
sd = {lower = 0, upper = 2}
[noise]
sd = 0.2
[verification]
samples = 0
"""
ITSELF = "def model(x):\n    return x\n"


def test_bootstrap_goes_on_from_its_replicates_and_refuses_those_of_another_kind(
    folder: Path,
) -> None:
    y = np.random.default_rng(0).normal(2.0, 0.5, 30)
    pd.DataFrame({"y": y}).to_csv(folder / "table.csv", index=False)
    write(model=ITSELF, study=LEVELS)
    asked = ("bootstrap", "study.toml", "--output", "out")
    shown = done(*asked, "--replicates", "20", "--experiments")
    assert "20 climbs arrived" in " ".join(shown.output.split())
    shown_again(shown, "out/bootstrap.json")
    document = read("out/bootstrap.json")
    error = document["hyperparameters"]["x.mean"]["standard_error"]
    assert error == pytest.approx(0.1, rel=0.5)
    assert document["statuses"] == {"arrived": 20}
    first = pd.read_csv("out/bootstrap.csv")
    done(*asked, "--replicates", "22", "--experiments", "--quiet")
    assert pd.read_csv("out/bootstrap.csv").iloc[:20].equals(first)
    assert "bootstrap.jsonl" in refused(*asked, "--replicates", "2")


CEILING = """\
title = "Springs"
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
vectorized = true
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
[noise]
sd = 0.1
"""


@pytest.mark.usefixtures("folder")
def test_ceiling_tells_both_log_likelihoods_and_writes_all() -> None:
    rng = np.random.default_rng(0)
    load = rng.uniform(1.0, 4.0, 24)
    length = load * rng.choice([0.7, 1.3], 24) + rng.normal(0.0, 0.1, 24)
    rows = [f"{k},{a:.4f},{b:.4f}" for k, (a, b) in enumerate(zip(load, length, strict=True))]
    model = "def length(load, softness): return load * softness\n"
    write(springs="\n".join(["id,load,length", *rows, ""]), model=model, study=CEILING)
    shown = done("ceiling", "study.toml", "--output", "found", "--replicates", 19)
    shown_again(shown, "found/ceiling.json")
    document = read("found/ceiling.json")
    value = document["log_likelihood"]
    assert value["ceiling"] == pytest.approx(value["estimated"] + value["gap"])
    assert document["bootstrap"]["p_value"] == pytest.approx(0.05)
    assert sum(point["probability"] for point in document["points"]) == pytest.approx(1.0)
    for text in ("best possible law", "chosen law", f"{value['ceiling']:.3f}", "p = 0.05"):
        assert text in shown.stdout
    assert Path("found/ceiling.png").read_bytes().startswith(b"\x89PNG")


# ------------------------------------------------------------------------------ compare

COMPARED = """
[experiments]
file = "table.csv"
id = "unit"
outcome = "y"
{transform}
[simulator]
function = "model.py:model"
vectorized = true
[parameters.x]
{law}
[noise]
sd = {{lower = 0.01, upper = 2}}
[verification]
samples = 0
"""
CONSTANT = 'law = "constant"\nvalue = {lower = 0, upper = 5}'
NORMAL = 'law = "normal"\nmean = {lower = 0, upper = 5}\nsd = {lower = 0, upper = 2}'
KINDS = {"alike": (CONSTANT, ""), "differing": (NORMAL, ""), "logged": (NORMAL, 'transform="log"')}


@pytest.fixture
def compared(folder: Path) -> None:
    """Twelve units of three values about levels that differ, and three studies of them."""
    rng = np.random.default_rng(0)
    unit = np.repeat(np.arange(12), 3)
    y = rng.normal(2.0, 0.3, 12)[unit] + rng.normal(0.0, 0.1, 36)
    pd.DataFrame({"unit": unit, "y": y}).to_csv(folder / "table.csv", index=False)
    write(model=ITSELF)
    for name, (law, transform) in KINDS.items():
        Path(f"{name}.toml").write_text(COMPARED.format(law=law, transform=transform))


@pytest.mark.usefixtures("compared")
def test_two_models_are_compared() -> None:
    shown = done("compare", "alike.toml", "differing.toml", "--bootstrap", "2", "--output", "out")
    shown_again(shown, "out")
    document = read("out/compare.json")
    best, other = document["models"]
    assert (best["name"], best["free"], best["of_law"]) == ("differing", 3, 2)
    assert other["difference"] < -3.0 * other["difference_error"]
    (ratio,) = document["nested"]
    assert ratio["p"] < 1e-4
    assert ratio["replicates"] == 2
    assert len(document["left_out"]) == document["experiments"] == 12
    assert "alike does worse by more than chance explains" in " ".join(shown.output.split())
    assert max(map(len, shown.output.splitlines()[:-2])) <= 80
    assert Path("out/compare.png").stat().st_size > 5000


@pytest.mark.usefixtures("compared", "unreported", "unjudged_commands")
def test_stored_answers_are_compared_without_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """The print is that of new identifications, for which one study changes, one loses its file."""
    for name in ("alike", "differing"):
        on_surfaces = Path(f"{name}.toml").read_text().replace("= true", "= false")
        Path(f"{name}.toml").write_text(on_surfaces)
        done("identify", f"{name}.toml", "--no-figures", "--quiet")
    made, whole = [], running.identify
    monkeypatch.setattr(
        running, "identify", lambda *given, **by: made.append(given) or whole(*given, **by)
    )
    asked = ("compare", "alike.toml", "differing.toml", "--no-ceiling", "--no-figures")
    stored = done(*asked)
    assert not made
    assert "the law is that of out/differing/identification.json" in stored.stderr
    with Path("alike.toml").open("a") as study:
        study.write("# changed\n")
    Path("out/differing/identification.json").unlink()
    new = done(*asked)
    assert len(made) == 2
    assert "alike.toml is identified again" in new.stderr
    assert new.stdout == stored.stdout


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ("alike.toml", "two or more"),
        ("alike.toml alike.toml", "'alike'"),
        ("differing.toml logged.toml", "Jacobian"),
        ("alike.toml differing.toml --nested alike diferring", "did you mean"),
    ],
)
@pytest.mark.usefixtures("compared")
def test_misuse_of_compare_is_one_message(arguments: str, told: str) -> None:
    assert told in refused("compare", *arguments.split())


# ------------------------------------------------------------------------------ predict


@pytest.fixture(scope="module")
def stretched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of forty springs whose law is identified."""
    folder = tmp_path_factory.mktemp("springs")
    rng = np.random.default_rng(4)
    load = np.linspace(1.0, 3.0, 40)
    length = load * (1.0 + 0.1 * rng.normal(size=40)) + 0.05 * rng.normal(size=40)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        pd.DataFrame({"load": load, "length": length}).to_csv("springs.csv", index=False)
        write(
            model="def length(load, softness):\n    return load * softness\n",
            study=NEXT.replace("sd = 0.1", "sd = 0.05"),
            new="id,load\nnear,2\nfar,6\n",
            near="id,load\nnear,2\n",
        )
        done("identify", "study.toml", "--output", "out", "--no-figures", "--no-verify")
    return folder


@pytest.fixture
def inside(stretched: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(stretched)


def predicted(*options: object) -> pd.Series:
    done("predict", LAW, "--at", "near.csv", "--output", "p.csv", "--quiet", *options)
    return pd.read_csv("p.csv").iloc[0]


@pytest.mark.usefixtures("inside")
def test_the_probability_of_the_true_value_is_the_normal_tail() -> None:
    limit = 2.0 * (estimate("softness.mean") + 4.0 * estimate("softness.sd"))
    event = ("--event", f"length > {limit!r}", "--no-noise")
    alone = predicted(*event, "--no-uncertainty")
    assert alone["probability"] == pytest.approx(stats.norm.sf(4.0), rel=0.1)
    assert np.isnan(alone["lower"])
    row = predicted(*event)
    assert row["lower"] < row["at_estimate"] < row["probability"] < row["upper"]
    assert row["at_estimate"] == pytest.approx(stats.norm.sf(4.0), rel=0.1)


@pytest.mark.usefixtures("inside")
def test_what_is_beyond_the_tested_conditions_is_told() -> None:
    asked = ("predict", LAW, "--at", "new.csv", "--event", "1.5 < length < 2.5")
    said = done(*asked, "--output", "p.json").stderr
    made = read("p.json")
    rows = made["rows"]
    assert [row["id"] for row in rows] == ["near", "far"]
    assert ["load is 1.5" in why for why in made["beyond"].values()] == [True]
    assert rows[1]["beyond"] == pytest.approx(1.5)
    assert "load is 1.5 tested ranges above the highest" in said
    assert "near" not in said


@pytest.mark.usefixtures("inside")
def test_limits_and_design_values() -> None:
    mean = 2.0 * estimate("softness.mean")
    sd = np.hypot(2.0 * estimate("softness.sd"), 0.05)
    row = predicted("--tolerance", "95%", 0.95)
    for end, side in (("lower", -1.0), ("upper", 1.0)):
        assert 2.1 < side * (row[end] - mean) / sd < 2.8
    for side, z in (("upper", 3.09), ("lower", -3.09)):
        row = predicted("--tolerance", 0.999, 0.5, "--side", side)
        assert row[side] == pytest.approx(mean + z * sd, abs=0.15 * sd)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        (("--event", "length > 1", "--tolerance", "0.9", "0.9"), "--event"),
        (("--event", "2 < length < 1"), "between"),
        (("--event", "lenght > 2"), "did you mean 'length'?"),
        (("--tolerance", "1.5", "0.9"), "content = 1.5"),
        (("--tolerance", "0.9", "0"), "confidence"),
        (("--side", "upper"), "--tolerance"),
    ],
)
@pytest.mark.usefixtures("inside")
def test_what_cannot_be_asked_of_a_law_is_one_message(options: tuple[str, ...], name: str) -> None:
    assert name in refused("predict", LAW, "--at", "new.csv", *options)


@pytest.mark.usefixtures("inside")
def test_conditions_are_values_by_name_or_those_of_the_experiments() -> None:
    """Of a mean proportional to the load, whatever way the load is given."""
    asked = ("predict", LAW, "--output", "p.csv", "--quiet", "--no-uncertainty")
    done(*asked, "--at", "load=2,6")
    table = pd.read_csv("p.csv")
    assert [*table.columns[:3]] == ["load", "outcome", "mean"]
    assert table["load"].tolist() == [2.0, 6.0]
    mean = estimate("softness.mean")
    assert table["mean"].to_numpy() == pytest.approx([2.0 * mean, 6.0 * mean], rel=1e-3)
    done(*asked)
    whole = pd.read_csv("p.csv")
    measured = pd.read_csv("springs.csv")
    assert whole["load"].to_numpy() == pytest.approx(measured["load"].unique())
    assert whole["mean"].to_numpy() == pytest.approx(mean * measured["load"].unique(), rel=1e-3)
    rows, study = Path("springs.csv").read_text(), Path("study.toml").read_text()
    Path("springs.csv").write_text(rows.replace(",", ";").replace(".", ","))
    signs = '[experiments]\ndelimiter = ";"\ndecimal = ","\n'
    Path("study.toml").write_text(study.replace("[experiments]\n", signs))
    done(*asked, "--at", "load=2,5;6")
    assert pd.read_csv("p.csv")["load"].tolist() == [2.5, 6.0]


@pytest.mark.usefixtures("folder", "unreported", "unjudged_commands")
def test_why_runs_fail_under_new_conditions_is_told() -> None:
    write_logarithmic("id,force,travel\nA,10,4\nB,20,6\nC,30,10\nD,40,12\n")
    done("identify", "study.toml", "--output", "out", "--no-figures", "--quiet")
    said = done("predict", "out/identification.json", "--at", "force=-7").stderr
    assert "has no logarithm" in said
    done("predict", "out/identification.json", "--at", "force=15", "--output", "p.csv")
    table = pd.read_csv("p.csv")  # the quantiles are logarithms, and marked as such
    assert table["scale"].tolist() == ["log"]
    assert 1.5 < table["q0.5"][0] < 2.0


@pytest.mark.parametrize(
    ("at", "told"),
    [
        (("lod=2",), "did you mean 'load'?"),
        (("load=two",), "'two' is not a number"),
        (("load=1,2", "load=3"), "given twice"),
        (("new.csv", "load=3"), "is a table"),
        (("absent.csv",), "absent.csv"),
    ],
)
@pytest.mark.usefixtures("inside")
def test_misuse_of_conditions_is_one_message(at: tuple[str, ...], told: str) -> None:
    assert told in refused("predict", LAW, *(part for one in at for part in ("--at", one)))


# ------------------------------------------------------------------------------ series

PLANTS = """\
[experiments]
file = "plants.csv"
id = "plant"
outcomes = ["height", "mass"]
conditions = ["time"]
transform = {mass = "log"}
censored = {height = {column = "status", right = "Cut"}}
[simulator]
function = "model.py:growth"
[parameters.rate]
law = "normal"
mean = {formula = "1 + light", lower = 0.1, upper = 4}
sd = {lower = 0.01, upper = 1}
[parameters.density]
law = "lognormal"
mean = {lower = 0.2, upper = 5}
sd = {lower = 0.01, upper = 2}
[noise.height]
sd = {lower = 0.01, upper = 1}
[noise.mass]
sd = 0.1
[search]
starts = 1
"""
GROWTH = """\
def growth(time, rate, density):
    height = rate * time
    return {"height": height, "mass": density * height}
"""


def plants() -> pd.DataFrame:
    rng = np.random.default_rng(5)
    rows = []
    for l in range(10):
        light = float(l % 2)
        rate, density = 1.0 + 0.5 * light + 0.2 * rng.normal(), np.exp(0.3 * rng.normal())
        for time in (1.0, 2.0, 4.0):
            height = rate * time
            seen = height + 0.1 * rng.normal()
            mass = density * height * np.exp(0.1 * rng.normal())
            cut = "Cut" if seen > 5.0 else ""
            rows.append([f"p{l}", time, light, min(seen, 5.0), cut, mass])
    return pd.DataFrame(rows, columns=["plant", "time", "light", "height", "status", "mass"])


@pytest.fixture(scope="module")
def grown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of series, two responses, censored values and a covariate, identified."""
    folder = tmp_path_factory.mktemp("plants")
    plants().to_csv(folder / "plants.csv", index=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        write(
            model=GROWTH, study=PLANTS, new="plant,time,light,like\na,1,1,p3\na,3,1,p3\nb,3,0,p2\n"
        )
        done("identify", "study.toml", "--output", "out", "--no-figures", "--quiet")
    return folder


@pytest.fixture
def garden(grown: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(grown)


def series(*options: str) -> pd.DataFrame:
    done("predict", LAW, "--at", "new.csv", "--output", "p.csv", "--quiet", *options)
    return pd.read_csv("p.csv")


@pytest.mark.usefixtures("garden")
def test_predictions_are_of_each_row_and_response() -> None:
    table = series("--no-uncertainty")
    assert table["plant"].tolist() == ["a", "a", "a", "a", "b", "b"]
    assert table["outcome"].tolist() == ["height", "mass"] * 3
    assert table["time"].tolist() == [1.0, 1.0, 3.0, 3.0, 3.0, 3.0]
    light, time = np.array([1.0, 1.0, 0.0]), np.array([1.0, 3.0, 3.0])
    rate = estimate("rate.mean[Intercept]") + estimate("rate.mean[light]") * light
    heights = table[table["outcome"] == "height"]
    assert heights["mean"].to_numpy() == pytest.approx(rate * time, rel=2e-3)
    sd = np.hypot(estimate("rate.sd") * time, estimate("noise.height.sd"))
    assert heights["standard_deviation"].to_numpy() == pytest.approx(sd, rel=5e-3)


@pytest.mark.usefixtures("garden")
def test_a_measured_experiment_is_predicted_better_and_without_noise_still_better() -> None:
    new, old, mean = series(), series("--of", "like"), series("--of", "like", "--no-noise")
    spreads = [table["standard_deviation"].to_numpy() for table in (new, old, mean)]
    assert np.all(spreads[1] < spreads[0])
    assert np.all(spreads[2] < spreads[1])
    one = series("--of", "p3")
    assert one.loc[:3, "mean"].to_numpy() == pytest.approx(old.loc[:3, "mean"].to_numpy())
    assert "p33" in refused("predict", LAW, "--at", "new.csv", "--of", "p33")
    table = pd.read_csv("out/individuals.csv", index_col="id")
    stored = {row["id"]: row for row in read(LAW)["experiments"]}
    assert [*table.index] == [*stored]
    assert table.loc["p3", "rate.mean"] == pytest.approx(stored["p3"]["mean"]["rate"])
    # Of a parameter the conditions that only the simulator takes do not matter.
    middle = table.loc["p3", "rate.mean"]
    share = series("--of", "p3", "--event", f"rate > {middle}", "--no-uncertainty")
    assert share["probability"].tolist() == pytest.approx([0.5, 0.5], abs=0.05)
    write(loose="light,time\n1,1\n0,3\n")
    assert load_study("study.toml").read_conditions("loose.csv").ids == ("1", "2")
    write(dark="plant,time\na,1\n")
    for command in (("predict", LAW, "--at"), ("next", "study.toml", "--candidates")):
        assert "the table needs time, light" in refused(*command, "dark.csv")


@pytest.mark.usefixtures("garden")
def test_sensitivity_is_of_each_value() -> None:
    done("sensitivity", "study.toml", "--output", "s", "--no-figures", "--experiments", "p1")
    table = pd.read_csv("s/sensitivity.csv")
    assert set(table["experiment"]) == {
        f"p1, row {row}, {response}" for row in (1, 2, 3) for response in ("height", "mass")
    }
    height = table[table["experiment"].str.endswith("height")].set_index("parameter")
    assert height.loc["rate", "total"].to_numpy() == pytest.approx(1.0)


# ------------------------------------------------------------------------------ report


@pytest.fixture(scope="module")
def pictured(stretched: Path) -> dict[str, object]:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(stretched)
        done("identify", "study.toml", "--output", "page", "--no-verify", "--quiet")
    return read(stretched / "page/identification.json")


def kept(folder: str, document: object) -> Path:
    path = Path(folder) / "identification.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


@pytest.mark.usefixtures("folder")
def test_a_report_has_the_ceiling_of_its_own_study_only(pictured: dict[str, object]) -> None:
    kept("a", pictured | {"study": {"file": "gone.toml", "sha256": "one", "outcome": "length"}})
    for sha256, shown in (("one", True), ("another", False)):
        ceiling = {"study": {"sha256": sha256}, "points": [{"softness": 1.0, "probability": 1.0}]}
        Path("a/ceiling.json").write_text(json.dumps(ceiling), encoding="utf-8")
        done("report", "a")
        text = Path("a/report.html").read_text(encoding="utf-8")
        assert ("mass-softness" in text) == shown
        assert "gone.toml" in text


@pytest.mark.usefixtures("folder")
def test_two_reports_stand_side_by_side(pictured: dict[str, object]) -> None:
    kept("a", pictured)
    other = json.loads(json.dumps(pictured))
    other["alpha"]["softness.mean"]["estimate"] = 77.5
    kept("b", other)
    done("report", "a", "--compare", "b")
    text = Path("a/compared.html").read_text(encoding="utf-8")
    row = text[text.index("<td>softness.mean</td>") :].partition("</tr>")[0]
    assert "77.5" in row
    assert "Both saw the same outcomes." in text
    other["observations"][0]["lower"] += 1.0
    kept("b", other)
    done("report", "a", "--compare", "b")
    assert "cannot be compared" in Path("a/compared.html").read_text(encoding="utf-8")
    refused("report", "a", "--compare", "a")


DAMAGE = {
    "pictures.predicted": lambda d: d["pictures"]["predicted"].pop("0.025"),
    "profiles": lambda d: next(iter(d["pictures"]["profiles"].values()))["at"].pop(),
    "laws": lambda d: d["pictures"].update(laws={"softness": [1.0]}),
    "pictures.surface": lambda d: d["pictures"]["surface"]["below"].pop(),
    "log_density": lambda d: d["experiments"][0].update(log_density=10**400),
    "sound": lambda d: d.pop("sound"),
    "alpha": lambda d: d.update(alpha=3),
}


@pytest.mark.parametrize("key", DAMAGE)
@pytest.mark.usefixtures("folder")
def test_a_damaged_result_is_one_message_with_its_key(
    pictured: dict[str, object], key: str
) -> None:
    document = json.loads(json.dumps(pictured))
    DAMAGE[key](document)
    kept("a", document)
    said = refused("report", "a")
    assert key in said
    assert "Remedy" in said
    Path("empty").mkdir()
    assert "identification.json" in refused("report", "empty")
