"""PEtab problems: the published log-likelihoods of its test suite, a study that ends, refusals."""

import re
import tomllib
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy import optimize, stats
from studies import done, read, refused

from aleator.observations.errors import MeasurementErrors
from aleator.simulators import load_function
from aleator.study import load_study

pytestmark = pytest.mark.usefixtures("unjudged_commands")
PROBLEM = """
format_version: 1
parameter_file: parameters.tsv
problems:
- condition_files: [conditions.tsv]
  measurement_files: [measurements.tsv]
  observable_files: [observables.tsv]
  sbml_files: [conversion.xml]
"""
MODEL = """
import numpy as np

def simulate(time, a0=None, b0=1.0, k1=0.8, k2=0.6, A=None, B=None, scaling=1.0,
             observableParameter1_obs_a=1.0, observableParameter2_obs_a=0.0):
    a0, b0 = (a0 if A is None else A), (b0 if B is None else B)
    end = (a0 + b0) * k2 / (k1 + k2)
    a = end + (a0 - end) * np.exp(-(k1 + k2) * np.asarray(time))
    scaled = scaling * observableParameter1_obs_a * a + observableParameter2_obs_a
    return {"obs_a": scaled, "obs_b": a0 + b0 - a}
"""
PARAMETERS = """
parameterId parameterScale lowerBound upperBound nominalValue estimate
k1 lin 0 10 0.8 1
k2 lin 0 10 0.6 1
"""
START = "a0 lin 0 10 1.0 1\nb0 lin 0 10 0.0 1\n"
TWO = "observableId simulationConditionId time measurement\nobs_a c0 0 0.7\nobs_a c0 10 0.1\n"
OBSERVABLE = "observableId observableFormula noiseFormula\nobs_a A 0.5"


class Case(NamedTuple):
    """The tables of a problem, with blanks between cells, and its log-likelihood."""

    llh: float
    measurements: str = TWO
    observables: str = OBSERVABLE
    conditions: str = "conditionId\nc0"
    parameters: str = PARAMETERS + START


# Cases 0001 to 0019 of https://github.com/PEtab-dev/petab_test_suite (v1.0.0, BSD-3-Clause), with
# the log-likelihood at the nominal values that stands in their solutions.
TRANSFORMED = (
    "observableId observableFormula observableTransformation noiseFormula\nobs_a A lin 0.5\n"
)
BOTH = "observableId simulationConditionId time measurement\nobs_a c0 10 0.2\nobs_b c0 10 0.8"
OVERRIDDEN = """observableId simulationConditionId time measurement {0}
obs_a c0 0 0.7 {1}
obs_a c0 10 0.1 {2}"""
SUITE = {
    "0001": Case(-0.84750169713188),
    "0002 conditions": Case(
        -4.09983582520606,
        "observableId simulationConditionId time measurement\nobs_a c0 0 0.7\nobs_a c0 10 0.1\n"
        "obs_a c1 0 0.8\nobs_a c1 10 0.2",
        OBSERVABLE.replace("0.5", "1"), "conditionId a0 b0\nc0 0.8 NaN\nc1 0.9 NaN", PARAMETERS,
    ),
    "0003 numeric overrides": Case(
        -15.87199287779978, OVERRIDDEN.format("observableParameters", "0.5;2", "0.5;2"),
        OBSERVABLE.replace(" A ", " observableParameter1_obs_a*A+observableParameter2_obs_a "),
    ),
    "0006 overrides of rows": Case(
        -65.10833033589059, OVERRIDDEN.format("observableParameters", "10", "15"),
        "observableId observableFormula noiseFormula\nobs_a observableParameter1_obs_a*A 1",
    ),
    "0007 log10": Case(-1.378941036858, BOTH, TRANSFORMED + "obs_b B log10 0.6"),
    "0008 replicates": Case(-1.17778328012676, TWO + "obs_a c0 10 0.2"),
    "0013 a parameter as condition": Case(
        -22.79033132827511, conditions="conditionId A B\nc0 1 par",
        parameters=PARAMETERS + "par lin 0 10 7.0 1",
    ),
    "0014 a sum of noise": Case(
        -3.68629528983135, OVERRIDDEN.format("noiseParameters", "0.5;2", "0.5;2"),
        OBSERVABLE.replace("0.5", "noiseParameter1_obs_a+noiseParameter2_obs_a"),
    ),
    "0015 a parameter of noise": Case(
        -5.06071208119597, OVERRIDDEN.format("noiseParameters", "noise", "noise"),
        OBSERVABLE.replace("0.5", "noiseParameter1_obs_a"),
        parameters=PARAMETERS + START + "noise lin 0 10 5.0 1",
    ),
    "0016 log": Case(-0.78492623889606, BOTH, TRANSFORMED + "obs_b B log 0.7"),
    "0019 log10 and known": Case(
        -12.17811234685187, conditions="conditionId A B\nc0 initial_A initial_B",
        parameters=PARAMETERS + "initial_A log10 1 10 2.0 1\ninitial_B lin 0 10 3.0 0",
    ),
}  # fmt: skip
VALUES = {"k1": 0.8, "k2": 0.6, "a0": 1.0, "b0": 0.0, "par": 7.0, "initial_B": 3.0,
          "log10_initial_A": np.log10(2.0), "noise.sd": 5.0}  # fmt: skip


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(case: Case, problem: str = PROBLEM) -> None:
    Path("problem.yaml").write_text(problem)
    for name in ("measurements", "observables", "conditions", "parameters"):
        text = getattr(case, name).strip()
        Path(f"{name}.tsv").write_text(re.sub(" +", "\t", text) + "\n")
    Path("model.py").write_text(MODEL)


@pytest.mark.parametrize("name", SUITE)
def test_the_log_likelihoods_of_the_test_suite_are_ours(name: str) -> None:
    case = SUITE[name]
    write(case)
    done("new", "problem.yaml")
    study = load_study("study.toml")
    seen, count = study.experiments.observations, len(study.experiments.ids)
    x = np.tile([VALUES[one] for one in study.inputs.names], (count, 1))
    values = study.runner().values(range(count), x)  # a column for each response of each row
    row = np.array([np.flatnonzero(np.flatnonzero(study.experiments.experiment == e) == r)[0]
                    for e, r in zip(seen.experiment, seen.row, strict=True)])  # fmt: skip
    eta = values[seen.experiment, row * len(seen.names) + seen.response]
    assert study.noise is not None
    errors = MeasurementErrors.of(study.noise, study.experiments)
    at = [VALUES[h.name] if h.free else h.start for h in errors.hyperparameters]
    log_p = errors.terms(np.array(at), eta[:, None], slice(0, eta.size)).value
    # ours is the density of the logarithm, PEtab's that of the value
    logs = [response.transform == "log" for response in seen.responses]
    of_value = np.sum(seen.lower[np.array(logs)[seen.response]])
    assert log_p.sum() - of_value == pytest.approx(case.llh, abs=1e-10)


def test_a_problem_runs_to_its_maximum() -> None:
    rng, times = np.random.default_rng(5), np.arange(0.0, 5.0)
    scope: dict[str, object] = {}
    exec(MODEL, scope)
    simulate = scope["simulate"]
    assert callable(simulate)
    lines, y = [], []
    for name, a0 in (("low", 1.0), ("high", 3.0)):
        for time, a in zip(times, simulate(times, a0)["obs_a"], strict=True):
            y.append(float(f"{a + 0.05 * rng.standard_normal():.4f}"))
            lines.append(f"obs_a {name} {time} {y[-1]}")
    case = Case(
        0.0, "\n".join(["observableId simulationConditionId time measurement", *lines]),
        OBSERVABLE.replace("0.5", "sigma"), "conditionId a0\nlow 1.0\nhigh 3.0",
        "parameterId parameterScale lowerBound upperBound nominalValue estimate\n"
        "k1 log10 1e-3 1e2 1.0 1\nk2 log10 1e-3 1e2 1.0 1\nsigma log10 1e-3 10 0.1 1",
    )  # fmt: skip
    write(case)
    shown = done("new", "problem.yaml").output
    assert "10 measurements of obs_a under 2 conditions, 2 parameters to be identified" in shown
    done("identify", "study.toml", "--output", "out", "--no-figures", "--quiet")
    found = read("out/identification.json")

    def residuals(k: np.ndarray) -> np.ndarray:
        own = [simulate(times, a0, 1.0, *10.0**k)["obs_a"] for a0 in (1.0, 3.0)]
        return np.concatenate(own) - y

    best = optimize.least_squares(residuals, [0.0, 0.0], xtol=1e-12)
    sigma = np.sqrt(np.mean(best.fun**2))
    alpha = {name: one["estimate"] for name, one in found["alpha"].items()}
    assert alpha["log10_k1.value"] == pytest.approx(best.x[0], abs=1e-3)
    assert alpha["log10_k2.value"] == pytest.approx(best.x[1], abs=1e-3)
    assert alpha["noise.sd"] == pytest.approx(sigma, rel=1e-3)
    at = np.sum(stats.norm.logpdf(best.fun, scale=sigma))
    assert found["log_likelihood"]["estimated"] == pytest.approx(at, abs=1e-4)


def test_a_function_is_written_where_there_is_none() -> None:
    write(SUITE["0003 numeric overrides"])
    Path("model.py").unlink()
    shown = done("new", "problem.yaml", "--schema").output
    assert "Fill in: the function simulate in model.py" in shown
    text = Path("model.py").read_text()
    assert "def simulate(time, observableParameter1_obs_a, observableParameter2_obs_a, k1" in text
    assert "obs_a = observableParameter1_obs_a*A+observableParameter2_obs_a" in text
    assert 'parent / "conversion.xml"' in text
    written = tomllib.loads(Path("study.toml").read_text())
    assert written["simulator"] == {"function": "model.py:simulate", "series": True}
    assert load_study("study.toml").inputs.names == ("k1", "k2", "a0", "b0")
    with pytest.raises(NotImplementedError, match="simulate MODEL here"):
        load_function("model.py:simulate")(0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0)
    assert "--force" in refused("new", "problem.yaml")
    done("new", "problem.yaml", "--function", "model.py:other", "--force")
    assert tomllib.loads(Path("study.toml").read_text())["simulator"]["function"].endswith("other")


def test_shares_and_scales_of_noise_are_read() -> None:
    relative = OBSERVABLE.replace("A 0.5", "scaling*A sigma*scaling*A")
    parameters = PARAMETERS + START + "scaling lin 0.1 10 2 1\nsigma lin 0 1 0.1 1"
    write(Case(0.0, observables=relative, parameters=parameters))
    done("new", "problem.yaml")
    noise = tomllib.loads(Path("study.toml").read_text())["noise"]
    assert noise == {"relative": {"lower": 0.001, "upper": 1.0, "start": 0.1}}
    known = TRANSFORMED.replace("lin 0.5", "log10 sigma")
    write(Case(0.0, observables=known, parameters=PARAMETERS + START + "sigma lin 0 1 0.1 1"))
    done("new", "problem.yaml", "--force")
    written = tomllib.loads(Path("study.toml").read_text())
    assert written["experiments"]["transform"] == "log"
    assert written["noise"]["sd"]["start"] == pytest.approx(0.1 * np.log(10.0))
    assert "sigma" not in written["parameters"]


ROW = PARAMETERS + START
REFUSED = {
    "preequilibration": (
        Case(0.0, OVERRIDDEN.format("preequilibrationConditionId", "c0", "c0")),
        "measurements.tsv: line 2, column 'preequilibrationConditionId' asks for a condition",
    ),
    "no end": (Case(0.0, TWO.replace(" 10 ", " inf ")), "line 3, column 'time': 'inf' is not"),
    "no condition": (Case(0.0, TWO.replace("c0 10", "c9 10")), "line 3, column 'simulationCond"),
    "no observable": (Case(0.0, TWO.replace("obs_a c0 10", "obs_z c0 10")), "is 'obs_z', which no"),
    "of one condition": (
        Case(0.0, TWO.replace("c0 10", "c1 10"), conditions="conditionId B\nc0 k1\nc1 k2"),
        "conditions.tsv: line 2, column 'B' is 'k1'",
    ),
    "laplace": (
        Case(0.0, observables="observableId observableFormula noiseFormula noiseDistribution\n"
             "obs_a A 1 laplace"),
        "observables.tsv: line 2, column 'noiseDistribution' is 'laplace'",
    ),
    "noise of two": (
        Case(0.0, observables=OBSERVABLE.replace("0.5", "k1+k2*A")),
        r"line 2, column 'noiseFormula' is 'k1\+k2\*A'",
    ),
    "overrides": (
        Case(0.0, OVERRIDDEN.format("observableParameters", "k1", "k2")),
        "line 3, column 'observableParameters' is not that of the other rows",
    ),
    "logarithm": (
        Case(0.0, parameters=ROW.replace("k1 lin", "k1 log10")),
        "parameters.tsv: line 2, column 'lowerBound' 0 has no logarithm",
    ),
    "limits": (Case(0.0, parameters=ROW.replace("k2 lin 0 10", "k2 lin 9 2")), "2 is not above 9"),
    "flag": (Case(0.0, parameters=ROW.replace("0.6 1", "0.6 yes")), "'estimate' is 'yes'"),
    "known": (Case(0.0, parameters=ROW.replace("0.6 1", "NaN 0")), "'' is not a finite number"),
    "column": (Case(0.0, observables="observableId noiseFormula\nobs_a 1"), "'observableFormula'"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_read_is_told_with_its_row(name: str) -> None:
    case, said = REFUSED[name]
    write(case)
    assert re.search(said, " ".join(refused("new", "problem.yaml").split()))
    assert not Path("study.toml").exists()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("format_version: 1", "format_version: 2.0.0", "'format_version' = 2.0.0: only 1"),
        ("[conditions.tsv]", "[a.tsv, b.tsv]", "'condition_files' names 2 files"),
        ("parameter_file: parameters.tsv", "", "'parameter_file' names 0 files"),
        ("problems:", "problem:", "it has no key 'problems'"),
        ("[conditions.tsv]", "[conditions.tsv", "cannot be read"),
        ("[conditions.tsv]", "[condition.tsv]", "did you mean 'conditions.tsv'"),
    ],
)
def test_a_file_that_is_no_such_problem_is_told(old: str, new: str, said: str) -> None:
    write(Case(0.0), PROBLEM.replace(old, new))
    assert said in " ".join(refused("new", "problem.yaml").split())


def test_options_that_the_tables_answer_are_refused() -> None:
    write(Case(0.0))
    assert "--id has no meaning" in refused("new", "problem.yaml", "--id", "time")
