"""Tables of NONMEM: the records that are read, those that are refused, and a study that ends."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from studies import done, read, refused

from aleator.errors import ExperimentsError
from aleator.study import load_study
from aleator.study.nonmem import SubjectTable, subject_table
from aleator.study.roles import sheet_of

THEOPHYLLINE = Path(__file__).parent / "data" / "theophylline.csv"
pytestmark = pytest.mark.usefixtures("unreported", "unjudged_commands")
MODEL = """
import json
import numpy as np

def concentration(time, amt, ka, cl, v):
    ke = cl / v
    return amt * ka / (v * (ka - ke)) * (np.exp(-ke * time) - np.exp(-ka * time))

def bolus(TIME, doses, ke, v=10.0):
    given = json.loads(doses)
    return sum(a / v * np.exp(-ke * (TIME - t)) * (TIME >= t) for t, a in given)
"""
STUDY = """
[experiments]
file = "theophylline_observations.csv"
outcome = "DV"
id = "ID"
conditions = ["time", "amt"]
[simulator]
function = "model.py:concentration"
vectorized = true
[parameters.ka]
law = "lognormal"
mean = {lower = 0.5, upper = 5.0}
sd = {lower = 0.05, upper = 4.0}
[parameters.cl]
law = "lognormal"
mean = {lower = 0.01, upper = 0.1}
sd = {lower = 0.001, upper = 0.05}
[parameters.v]
law = "constant"
value = {lower = 0.2, upper = 1.0}
[noise]
sd = {lower = 0.05, upper = 2.0}
[search]
starts = 2
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.py").write_text(MODEL)
    return tmp_path


def table(text: str, *names: str) -> SubjectTable:
    """The table of experiments of records, whose rows stand one a line."""
    Path("records.csv").write_text(text.strip() + "\n")
    return subject_table(sheet_of(Path("records.csv")), names)


def rows(text: str, *names: str) -> list[str]:
    return table(text, *names).text.splitlines()


def by_quadrature(alpha: dict[str, float], nodes: int = 20) -> float:
    """The log-likelihood of theophylline by Gauss-Legendre nodes over both parameters' logarithms.

    The range is that of eight standard deviations, cut into panels.
    """
    records = np.genfromtxt(THEOPHYLLINE, delimiter=",", names=True, missing_values=".")
    z, w = np.polynomial.legendre.leggauss(nodes)
    ends = np.linspace(-8.0, 8.0, 13)
    half = np.diff(ends) / 2.0
    points = (half[:, None] * z + (ends[:-1] + half)[:, None]).ravel()
    weights = (half[:, None] * w).ravel() * stats.norm.pdf(points)
    x = {}
    for name in ("ka", "cl"):
        s2 = np.log1p((alpha[f"{name}.sd"] / alpha[f"{name}.mean"]) ** 2)
        x[name] = alpha[f"{name}.mean"] * np.exp(np.sqrt(s2) * points - s2 / 2.0)
    ka, v = x["ka"][:, None], alpha["v.value"]
    ke = x["cl"][None, :] / v
    total = 0.0
    for subject in np.unique(records["ID"]):
        own = records[records["ID"] == subject]
        dose, seen = own["AMT"][own["EVID"] == 1][0], own[own["EVID"] == 0]
        log_p = np.zeros((points.size, points.size))
        for time, value in zip(seen["TIME"], seen["DV"], strict=True):
            eta = dose * ka / (v * (ka - ke)) * (np.exp(-ke * time) - np.exp(-ka * time))
            log_p += stats.norm.logpdf(value, eta, alpha["noise.sd"])
        total += float(np.log(weights @ np.exp(log_p) @ weights))
    return total


@pytest.mark.usefixtures("folder")
def test_theophylline_is_read_and_its_likelihood_is_the_integral() -> None:
    shown = done("new", THEOPHYLLINE, "--function", "model.py:concentration").output
    assert "132 observations and 12 doses of 12 subjects" in shown
    assert "conditions: time, amt" in shown
    assert "laws may follow: WT" in shown
    Path("study.toml").write_text(STUDY)
    experiments = load_study("study.toml").experiments
    assert len(experiments.ids) == 12
    assert experiments.conditions["amt"].iloc[0] == 4.02
    done("identify", "study.toml", "--output", "out", "--no-figures", "--quiet", "--no-verify")
    found = read("out/identification.json")
    alpha = {name: value["estimate"] for name, value in found["alpha"].items()}
    log_likelihood = found["log_likelihood"]["estimated"]
    assert log_likelihood == pytest.approx(by_quadrature(alpha), abs=2e-3)
    for name, step in (("ka.mean", 0.03), ("cl.sd", 0.001), ("v.value", 0.004)):
        for sign in (-1.0, 1.0):  # a maximum
            beside = {**alpha, name: alpha[name] + sign * step}
            assert by_quadrature(beside) < log_likelihood


@pytest.mark.usefixtures("folder")
def test_several_doses_are_one_condition() -> None:
    rng = np.random.default_rng(7)
    ke, lines = rng.normal(0.2, 0.03, 8), ["ID,TIME,DV,AMT,EVID,ADDL,II"]
    for k, one in enumerate(ke):
        lines.append(f"{k},0,.,100,1,{k % 3},12")
        given = 12.0 * np.arange(1 + k % 3)
        for time in (1.0, 6.0, 20.0, 30.0):
            past = given[given <= time]
            value = np.sum(10.0 * np.exp(-one * (time - past))) + 0.05 * rng.standard_normal()
            lines.append(f"{k},{time:g},{value:.4f},.,0,.,.")
    Path("pk.csv").write_text("\n".join([*lines, ""]))
    done("new", "pk.csv", "--function", "model.py:bolus", "--parameter", "ke=0.05:0.5")
    study = load_study("study.toml")
    assert (
        study.experiments.conditions["doses"].iloc[8]
        == "[[0.0, 100.0], [12.0, 100.0], [24.0, 100.0]]"
    )
    done("identify", "study.toml", "--output", "out", "--no-figures", "--quiet", "--no-verify")
    alpha = read("out/identification.json")["alpha"]
    assert alpha["ke.mean"]["estimate"] == pytest.approx(ke.mean(), abs=0.003)
    assert alpha["noise.sd"]["estimate"] == pytest.approx(0.05, abs=0.02)
    said = refused("new", "pk.csv", "--function", "model.py:concentration", "--force")
    assert "subject '1' has 2 doses" in said


@pytest.mark.usefixtures("folder")
def test_records_become_observations_with_their_doses() -> None:
    text = """
C,Id,TIME,DV,Amt,MDV,RATE,WT
.,1,0.5,.,100,1,50,70
.,1,1,9.5,.,0,.,70
C,1,2,7.5,.,0,.,70
.,1,3,.,.,0,.,70
.,2,0,.,80,1,.,60
.,2,1,8.5,.,0,.,60
"""
    found = table(text, "time", "amt")
    assert found.text.splitlines() == [
        "Id,time,DV,WT,amt,AMT_TIME,AMT_RATE", "1,1,9.5,70,100,0.5,50", "2,1,8.5,60,80,0,0"
    ]  # fmt: skip
    assert found.outcomes == ("DV",)
    assert found.id == "Id"
    assert found.notes[-1] == "left out: 2 records without a measured value"
    assert rows(text, "Doses")[1].endswith('"[[0.5, 100.0, 50.0]]"')


@pytest.mark.usefixtures("folder")
def test_observations_before_a_dose_at_the_same_time_are_told() -> None:
    found = table("ID,TIME,DV,AMT\n1,0,.,9\n1,8,3,.\n1,8,.,9\n1,16,4,.", "doses")
    assert found.notes[1].startswith("observations before a dose at the same time: 1; ")
    after = table("ID,TIME,DV,AMT\n1,0,.,9\n1,0,9,.\n1,8,.,9\n1,16,4,.", "doses")
    assert len(after.notes) == 1


@pytest.mark.usefixtures("folder")
def test_a_value_below_a_limit_may_be_blank() -> None:
    text = "ID,TIME,DV,AMT,BLQ,LLOQ\n1,0,.,9,0,.\n1,1,5,.,0,0.1\n1,2,.,.,1,0.1\n1,3,.,.,0,0.1"
    assert [row.split(",")[2] for row in rows(text)[1:]] == ["5", "<0.1"]


@pytest.mark.usefixtures("folder")
def test_each_compartment_has_a_column() -> None:
    text = "ID,TIME,DV,AMT,EVID,CMT\n1,0,.,9,1,1\n1,1,5,.,0,2\n1,1,80,.,0,3\n1,2,4,.,0,2"
    found = table(text)
    assert found.outcomes == ("DV_2", "DV_3")
    assert found.text.splitlines()[1:] == ["1,1,5,,9", "1,1,,80,9", "1,2,4,,9"]


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("head", "cells", "cell", "bounds"),
    [
        ("CENS", "1,0,-1", ["<0.5", "3", ">0.5"], [(-np.inf, 0.5), (3, 3), (0.5, np.inf)]),
        ("BLQ,LLOQ", "1 0.2,0 0,0 0", ["<0.2", "3", "0.5"], [(-np.inf, 0.2), (3, 3), (0.5, 0.5)]),
        ("CENS,LIMIT", "1 0.1,0 .,0 .", ["0.1", "3", "0.5"], [(0.1, 0.5), (3, 3), (0.5, 0.5)]),
    ],
)  # fmt: skip
def test_values_below_a_limit_become_bounds(
    head: str, cells: str, cell: list[str], bounds: list[tuple[float, float]]
) -> None:
    values = zip((0.5, 3, 0.5), cells.split(","), strict=True)
    lines = [f"1,{t},{v},.,0,{c.replace(' ', ',')}" for t, (v, c) in enumerate(values)]
    dose = f"1,0,.,9,1{',.' * (1 + head.count(','))}"
    Path("blq.csv").write_text("\n".join([f"ID,TIME,DV,AMT,EVID,{head}", dose, *lines, ""]))
    assert [row.split(",")[2] for row in rows(Path("blq.csv").read_text())[1:]] == cell
    Path("model.py").write_text("def level(TIME, AMT, rate=0.1):\n    return AMT - rate * TIME\n")
    done("new", "blq.csv", "--function", "model.py:level")
    seen = load_study("study.toml").experiments.observations
    assert [*zip(seen.lower.tolist(), seen.upper.tolist(), strict=True)] == bounds


RECORDS = "ID,TIME,DV,AMT,EVID,{}\n1,0,.,9,1,{}\n1,1,5,.,{},.\n2,0,6,.,0,."
REFUSED = {
    "reset": ("X", ".", "3", "line 3, column 'EVID' resets the subject"),
    "unknown": ("X", ".", "101", "line 3, column 'EVID' is none of 0, 1 and 2"),
    "steady": ("SS", "1", "0", "line 2, column 'SS' asks for a steady state"),
    "rate": ("RATE", "-2", "0", "line 2, column 'RATE' asks for a modelled rate"),
    "more": ("ADDL", "3", "0", "line 2, column 'ADDL' adds doses"),
    "date": ("DATE", "1-1-99", "0", "line 2, column 'DATE' is a date"),
    "text": ("RATE", "x", "0", "line 2, column 'RATE': 'x' is not a number"),
}


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("case", REFUSED)
def test_records_that_no_table_can_say_are_refused(case: str) -> None:
    head, cell, event, said = REFUSED[case]
    with pytest.raises(ExperimentsError, match=said) as error:
        table(RECORDS.format(head, cell, event))
    assert error.value.remedy


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ID,TIME,DV,AMT\n1,0,.,9\n2,0,.,9\n2,1,5,.\n1,1,5,.", "line 5, column 'ID' ended"),
        ("ID,TIME,DV,AMT,EVID\n1,0,.,9,0\n1,1,5,.,0", "line 2, column 'EVID' is 0, and the record"),
        ("ID,TIME,DV,AMT\n1,0,1,.\n1,0,.,9\n2,0,.,9\n2,0,8,.", "line 2, column 'TIME' is the time"),
        ("ID,TIME,DV,AMT\n1,0,.,9", "no record is an observation"),
        ("ID,TIME,DV,AMT\n1,0,.,9\n1,.,5,.", "line 3, column 'TIME' is blank"),
        ("ID,TIME,DV,AMT,BLQ\n1,0,.,9,0\n1,1,0,.,1", "line 3, column 'BLQ' is 1, and nothing says"),
        ("ID,TIME,DV,MDV,CENS\n1,1,.,0,1\n1,2,2,0,0", "line 2, column 'DV' is blank, and CENS"),
        ("ID,TIME,DV,MDV,CENS\n1,1,1,0,2\n1,2,2,0,0", "line 2, column 'CENS' is none of -1, 0"),
        ("ID,TIME,DV,MDV,CENS,LIMIT\n1,1,2,0,1,1\n1,2,2,0,1,.", "line 3, column 'LIMIT' is blank"),
    ],
)
def test_records_that_contradict_themselves_are_refused(text: str, said: str) -> None:
    with pytest.raises(ExperimentsError, match=said):
        table(text)


@pytest.mark.usefixtures("folder")
def test_blanks_between_columns_and_a_file_that_is_there_are_told() -> None:
    Path("a.csv").write_text("ID TIME DV AMT\n1 0 . 9\n1 1 5 .\n")
    assert "separate the cells by commas" in refused("new", "a.csv", "--function", "model.py:bolus")
    Path("a.csv").write_text("ID,TIME,DV,AMT\n1,0,.,9\n1,1,5,.\n")
    Path("a_observations.csv").write_text("mine")
    assert "--force" in refused("new", "a.csv", "--function", "model.py:bolus")
    assert Path("a_observations.csv").read_text() == "mine"
