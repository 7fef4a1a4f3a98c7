"""Levels through study.toml and from Python: published answers, predictions, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from studies import done, read, refused

import aleator
from aleator import Check, Constant, Free, Identification, Inputs, Noise, Normal, ResponseSurface
from aleator.core.types import Array
from aleator.errors import AleatorError, ExperimentsError, InputsError
from aleator.search import GradientMultistart
from aleator.views.page import page

DATA = Path(__file__).parents[1] / "data"
STUDY = f"""\
[experiments]
file = "{(DATA / "pastes.csv").as_posix()}"
outcome = "strength"
[simulator]
function = "model.py:paste"
vectorized = true
[parameters.mean]
law = "constant"
value = {{lower = 0, upper = 100}}
[parameters.shift]
law = "normal"
level = "batch"
mean = 0
sd = {{lower = 0, upper = 10}}
[parameters.cask]
law = "normal"
mean = 0
sd = {{lower = 0, upper = 10}}
[noise]
sd = {{lower = 0.001, upper = 100}}
"""


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the identified study of the pastes."""
    folder = tmp_path_factory.mktemp("pastes")
    (folder / "study.toml").write_text(STUDY)
    (folder / "model.py").write_text(
        "def paste(mean, shift, cask):\n    return mean + shift + cask\n"
    )
    (folder / "new.csv").write_text("id,batch\na,A\nz,Z\n")
    done(
        "identify", folder / "study.toml", "--output", folder / "out", "--no-figures", "--starts", 2
    )
    return folder


def estimates(document: dict) -> list[float]:  # type: ignore[type-arg]
    names = ("mean.value", "shift.sd", "cask.sd", "noise.sd")
    return [document["alpha"][name]["estimate"] for name in names]


def test_pastes_by_a_study(answered: Path) -> None:
    """Bates, Maechler, Bolker and Walker (2015): 247.9944658625, and the interval of lme4."""
    document = read(answered / "out" / "identification.json")
    assert -2.0 * document["log_likelihood"]["estimated"] == pytest.approx(247.9944658625, abs=1e-4)
    assert estimates(document) == pytest.approx([60.0533, 1.0951, 2.9041, 0.8234], abs=5e-3)
    assert (document["sound"], document["consistent"]) == (True, True)
    lower, upper = document["alpha"]["mean.value"]["interval"]
    assert (lower, upper) == pytest.approx((58.6637, 61.4430), abs=0.01)
    assert document["alpha"]["shift.sd"]["interval"][1] == pytest.approx(2.9466, abs=0.01)


def of_batch(document: dict, batch: str) -> tuple[float, float]:  # type: ignore[type-arg]
    """The mean and sd of a measurement of a new cask of a batch: normal laws, closed form."""
    mean, shift, cask, noise = estimates(document)
    table = pd.read_csv(DATA / "pastes.csv")
    means = table[table.batch == batch].groupby("id").strength.mean()
    precision = 1.0 / (cask**2 + noise**2 / 2.0)
    own = 1.0 / (shift**-2 + means.size * precision)
    center = mean + own * precision * float((means - mean).sum())
    return center, float(np.sqrt(own + cask**2 + noise**2))


def test_a_new_cask_of_a_known_and_of_a_new_batch(answered: Path) -> None:
    document = read(answered / "out" / "identification.json")
    done(
        "predict", answered / "out" / "identification.json", "--at", answered / "new.csv",
        "--no-uncertainty", "--output", answered / "predicted.csv",
    )  # fmt: skip
    found = pd.read_csv(answered / "predicted.csv").set_index("id")
    for row, batch in (("a", "A"), ("z", "Z")):
        center, sd = of_batch(document, batch)
        assert found.loc[row, "mean"] == pytest.approx(center, abs=0.01)
        assert found.loc[row, "standard_deviation"] == pytest.approx(sd, rel=5e-3)
        exact = stats.norm.ppf([0.025, 0.975], center, sd)
        assert found.loc[row, ["q0.025", "q0.975"]].to_numpy() == pytest.approx(exact, abs=0.05)


def test_a_level_that_varies_within_an_experiment_is_refused(answered: Path) -> None:
    table = pd.read_csv(DATA / "pastes.csv")
    table.loc[0, "batch"] = "B"
    table.to_csv(answered / "mixed.csv", index=False)
    study = answered / "mixed.toml"
    study.write_text(STUDY.replace((DATA / "pastes.csv").as_posix(), "mixed.csv"))
    assert "column 'batch' of experiment 'A:a' is B" in refused("identify", study)
    study.write_text(STUDY.replace('level = "batch"', 'level = "lot"'))
    assert "a law names 'lot', which is no column of the table" in refused("identify", study)


@pytest.fixture(scope="module")
def crossed() -> Identification:
    """Machines and days crossed, six specimens' measurements for each."""
    rng = np.random.default_rng(3)
    day, machine = np.repeat(np.arange(6), 4), np.tile(np.arange(4), 6)
    y = 5.0 + rng.normal(0.0, 1.0, 6)[day] + rng.normal(0.0, 2.0, 4)[machine]
    table = pd.DataFrame({"day": day, "machine": machine, "y": y + rng.normal(0.0, 0.3, 24)})
    return aleator.identify(
        total, table, laws({"a": "day", "b": "machine"}), outcome="y",
        noise=Noise(Free(0.01, 5.0)), vectorized=True, consistency=False,
        search=GradientMultistart(starts=2),
    )  # fmt: skip


def total(m: Array, a: Array, b: Array) -> Array:
    return m + a + b


def laws(levels: dict[str, str]) -> Inputs:
    return Inputs(
        {
            "m": Constant(Free(-20.0, 20.0)),
            "a": Normal(0.0, Free(0.0, 10.0)),
            "b": Normal(0.0, Free(0.0, 10.0)),
        },
        levels=levels,
    )


def test_crossed_levels_from_python(crossed: Identification) -> None:
    """The maximum is that of the multivariate normal law; one cluster has no sandwich error."""
    table = crossed.fit.table.table
    same = [np.equal.outer(table[n].to_numpy(), table[n].to_numpy()) for n in ("day", "machine")]

    def exact(m: float, a: float, b: float, noise: float) -> float:
        covariance = a**2 * same[0] + b**2 * same[1] + noise**2 * np.eye(24)
        return float(
            stats.multivariate_normal(np.full(24, m), covariance).logpdf(
                crossed.fit.table.observations.lower
            )
        )

    at = [crossed.alpha[n].estimate for n in ("m.value", "a.sd", "b.sd", "noise.sd")]
    assert crossed.log_likelihood.estimated == pytest.approx(exact(*at), abs=1e-8)
    for k in range(4):
        for step in (-0.01, 0.01):
            moved = [value * (1.0 + step * (k == j)) for j, value in enumerate(at)]
            assert exact(*moved) < crossed.log_likelihood.estimated + 1e-5
    assert crossed.sound
    assert np.isnan(crossed.fit.inference.sandwich_error).all()


def test_a_new_measurement_of_a_known_machine_on_a_new_day(crossed: Identification) -> None:
    m, a, b, noise = (crossed.alpha[n].estimate for n in ("m.value", "a.sd", "b.sd", "noise.sd"))
    found = crossed.predict(pd.DataFrame({"machine": [1]}), uncertainty=False)
    table = crossed.fit.table.table
    own = (table.machine == 1).to_numpy()
    same = [np.equal.outer(table[n].to_numpy(), table[n].to_numpy()) for n in ("day", "machine")]
    covariance = a**2 * same[0] + b**2 * same[1] + noise**2 * np.eye(24)
    left = crossed.fit.table.observations.lower - m
    gain = np.linalg.solve(covariance, np.stack([left, b**2 * own], axis=1))
    center = m + b**2 * own @ gain[:, 0]
    sd = np.sqrt(b**2 - b**2 * own @ gain[:, 1] + a**2 + noise**2)
    assert found["mean"].iloc[0] == pytest.approx(center, abs=0.02 * sd)
    assert found["standard_deviation"].iloc[0] == pytest.approx(sd, rel=0.02)


def test_the_table_says_which_groups_are_new(crossed: Identification) -> None:
    known, new = (crossed.predict({"machine": k}, uncertainty=False).iloc[0] for k in (1, 9))
    assert (known["machine"], known["day"]) == (1, "new")
    assert (new["machine"], new["day"]) == ("9 (new)", "new")
    assert known["standard_deviation"] < new["standard_deviation"]
    whole = crossed.predict(uncertainty=False)
    assert whole[["day", "machine"]].to_numpy().tolist() == (
        crossed.fit.table.table[["day", "machine"]].to_numpy().tolist()
    )


def test_what_levels_do_not_have_is_refused(crossed: Identification) -> None:
    table = pd.DataFrame({"day": [1, 1, 2, 2], "y": [1.0, 2.0, 3.0, 4.0]})
    day = Inputs({"m": Normal(Free(0.0, 5.0), 1.0), "a": Normal(0.0, 1.0)}, levels={"a": "day"})

    def simple(m: float, a: float) -> float:
        return m + a

    with pytest.raises(InputsError, match="levels need measurement noise"):
        aleator.identify(simple, table, day, outcome="y")
    with pytest.raises(InputsError, match="are for independent experiments"):
        aleator.identify(
            simple, table, day, outcome="y", noise=Noise(0.1),
            propagation=ResponseSurface(surfaces="own"),
        )  # fmt: skip
    with pytest.raises(InputsError, match="best possible law is one for independent"):
        aleator.ceiling(crossed)
    with pytest.raises(InputsError, match="none can be drawn"):
        aleator.bootstrap(crossed, replicates=2, kind="nonparametric")
    with pytest.raises(InputsError, match="none can be left out"):
        aleator.compare(one=crossed, other=crossed)
    candidate = pd.DataFrame({"day": ["new"], "machine": [1]})
    with pytest.raises(InputsError, match="is of the machine '1', which was measured"):
        aleator.next_experiments(crossed, candidate, count=1)
    with pytest.raises(ExperimentsError, match="is blank"):
        aleator.identify(
            simple, table.assign(day=["a", None, "b", "b"]), day, outcome="y", noise=Noise(0.1),
            verification=Check(0),
        )  # fmt: skip
    component = Normal(0.0, 1.0)
    mixture = aleator.Mixture((component, Normal(3.0, 1.0)))
    with pytest.raises(AleatorError, match="is a mixture"):
        Inputs({"m": mixture, "a": component}, levels={"a": "day"})


def test_a_report_offers_no_ceiling_and_says_that_rows_do_not_add_up(
    crossed: Identification,
) -> None:
    document = crossed.to_dict()
    text = page(document)
    assert "aleator ceiling" not in text
    assert "share day, machine with it" in text
    each = sum(entry["log_density"] for entry in document["experiments"])
    assert abs(each - crossed.log_likelihood.estimated) > 1.0
