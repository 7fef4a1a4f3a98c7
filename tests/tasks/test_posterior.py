"""Posteriors of identifications: against closed forms, as tables, netCDF and by command."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray
from identifications import unjudged
from scipy import stats
from studies import done

import aleator
from aleator import Check, Free, Identification, Inputs, Noise, Normal, Posterior, posterior
from aleator.core.progress import Silent
from aleator.core.types import Array
from aleator.errors import AleatorError, InputsError, installing
from aleator.inference.posterior import Convergence
from aleator.laws import Constant, Law
from aleator.results.documents import write_json
from aleator.tasks.posterior import REPORTED

SD, NOISE, COUNT = 0.4, 0.3, 12
MEASURED = np.random.default_rng(3).normal(2.0, np.hypot(SD, NOISE), COUNT)
PRIOR = Normal(1.5, 0.1)


def direct(z: Array, x: Array) -> Array:
    return x + 0.0 * z


def identified(law: Law, noise: Noise | None = None, **more: bool) -> Identification:
    ids = [f"specimen {k}" for k in range(COUNT)]
    table = pd.DataFrame({"id": ids, "z": np.linspace(0.0, 1.0, COUNT), "y": MEASURED})
    return unjudged(
        direct, table, Inputs({"x": law}), outcome="y", vectorized=True, noise=noise,
        verification=Check(0), **more,
    )  # fmt: skip


def conjugate(variance: float) -> stats.rv_continuous:
    precision = 100.0 + COUNT / variance
    return stats.norm((150.0 + MEASURED.sum() / variance) / precision, precision**-0.5)


@pytest.fixture(scope="module")
def found() -> Identification:
    law = Normal(Free(-10.0, 10.0, prior=PRIOR), SD)
    return identified(law, Noise(NOISE), consistency=True)


@pytest.fixture(scope="module")
def drawn(found: Identification) -> Posterior:
    return posterior(found, draws=120, chains=2, seed=5)


@pytest.fixture(scope="module")
def few(found: Identification) -> Posterior:
    return posterior(found, draws=10, chains=2, seed=5)


def require_normal(made: Posterior, truth: stats.rv_continuous) -> None:
    flat = made.draws[:, :, 0].ravel()
    distance = stats.kstest(flat, truth.cdf).statistic
    assert made.convergence.least > 40
    assert distance * np.sqrt(min(made.convergence.least, flat.size)) < 1.95


def test_a_noisy_normal_mean_has_its_conjugate_posterior(drawn: Posterior) -> None:
    require_normal(drawn, conjugate(SD**2 + NOISE**2))


def test_the_same_seed_gives_the_same_draws_however_many(drawn: Posterior, few: Posterior) -> None:
    np.testing.assert_array_equal(few.draws, drawn.draws[:2, :10])
    np.testing.assert_array_equal(few.chains.likelihood, drawn.chains.likelihood[:2, :10])


def test_after_an_interruption_the_same_draws_are_made(
    found: Identification, drawn: Posterior, tmp_path: Path
) -> None:
    """Finished pieces of the chains are kept, and only the others are made."""
    steps, stop = list[str](), 380  # in the second piece of the second chain

    class Stopped(Silent):
        def update(self, text: str, *_: float | None) -> None:
            steps.append(text)
            if len(steps) == stop:
                raise KeyboardInterrupt

    often = replace(REPORTED, shown=0.0)
    asked = {"draws": 120, "chains": 2, "seed": 5, "settings": often, "folder": tmp_path}
    with pytest.raises(KeyboardInterrupt):
        posterior(found, progress=Stopped(), **asked)
    kept = (tmp_path / "posterior.jsonl").read_text().splitlines()
    assert len(kept) == 1 + 3 + 1
    steps.clear()
    again = posterior(found, progress=Stopped(), **asked)
    assert len(steps) < 120
    np.testing.assert_array_equal(again.draws, drawn.draws)
    np.testing.assert_array_equal(again.chains.each, drawn.chains.each)
    assert again.chains.evaluations == drawn.chains.evaluations
    with pytest.raises(AleatorError, match="another"):
        posterior(found, draws=10, chains=2, seed=6, folder=tmp_path)
    (tmp_path / "posterior.jsonl").write_text(f'{kept[0]}\n{{"chain": 0}}\n')
    with pytest.raises(AleatorError, match="line 2"):
        posterior(found, draws=10, chains=2, seed=5, folder=tmp_path)


def test_every_draw_has_its_likelihood_and_its_prior(
    found: Identification, drawn: Posterior
) -> None:
    frame = drawn.frame()
    assert frame.shape == (240, 5)
    row = frame.iloc[177]
    assert row["log_likelihood"] == pytest.approx(
        found.log_likelihood_at({"x.mean": row["x.mean"]}), abs=1e-6
    )
    assert row["log_prior"] == pytest.approx(stats.norm.logpdf(row["x.mean"], 1.5, 0.1))
    assert (row["chain"], row["draw"]) == (1, 57)
    np.testing.assert_allclose(drawn.chains.each.sum(axis=2), drawn.chains.likelihood)


def test_the_table_tells_moments_quantiles_and_convergence(drawn: Posterior) -> None:
    row, flat = drawn.table().loc["x.mean"], drawn.draws.ravel()
    assert row["mean"] == pytest.approx(flat.mean())
    assert row["sd"] == pytest.approx(flat.std(ddof=1))
    assert np.mean((flat > row["lower"]) & (flat < row["upper"])) == pytest.approx(0.95, abs=8e-3)
    assert drawn.converged == ("NOT" not in drawn.verdict)
    assert drawn.nodes_error < 0.01
    assert drawn.outside == 0.0
    assert drawn.sound
    # the prior of these tests lies far from the data: the two contradict each other
    assert drawn.consistent is False
    (told,) = drawn.warnings
    assert "not consistent" in told


def test_a_stored_posterior_is_shown_again(drawn: Posterior, tmp_path: Path) -> None:
    write_json(drawn.to_dict(), tmp_path / "posterior.json")
    printed = " ".join(done("show", tmp_path / "posterior.json").stdout.split())
    assert printed.endswith(drawn.verdict)
    assert "x.mean" in printed
    assert done("show", tmp_path / "posterior.json", "--quiet").stdout.strip() == drawn.verdict


def test_netcdf_gives_back_what_arviz_expects(drawn: Posterior, tmp_path: Path) -> None:
    drawn.save(tmp_path / "posterior.nc")
    with xarray.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf") as read:
        np.testing.assert_array_equal(read["posterior"]["x.mean"].to_numpy(), drawn.draws[:, :, 0])
        assert read["posterior"]["x.mean"].dims == ("chain", "draw")
        lp = read["sample_stats"]["lp"].to_numpy()
        np.testing.assert_allclose(lp, drawn.chains.likelihood + drawn.chains.prior)
        assert {"diverging", "n_steps", "acceptance_rate"} <= {*read["sample_stats"].data_vars}
        each = read["log_likelihood"]["y"]
        assert each.dims == ("chain", "draw", "experiment")
        assert each["experiment"].to_numpy().tolist() == [f"specimen {k}" for k in range(COUNT)]
        assert float(read["constant_data"]["noise.sd"]) == NOISE


def test_arviz_itself_tells_the_same_of_the_data(drawn: Posterior) -> None:
    import arviz_stats

    told = arviz_stats.rhat(drawn.data())
    assert float(told["x.mean"]) == pytest.approx(drawn.convergence.r_hat[0])
    # leave-one-out needs the log-likelihood of each experiment
    assert arviz_stats.loo(drawn.data(), var_name="y").elpd < 0.0


def test_few_draws_are_not_called_converged(few: Posterior) -> None:
    assert not few.converged
    assert "--draws" in few.verdict


@pytest.mark.parametrize(
    ("r_hat", "size", "failed"),
    [(1.002, 250.0, "effective sample size is not"), (1.05, 900.0, "R-hat is not")],
)
def test_the_verdict_names_only_what_failed(
    few: Posterior, r_hat: float, size: float, failed: str
) -> None:
    found = Convergence(np.array([r_hat]), np.array([size]), np.array([size]))
    verdict = " ".join(replace(few, convergence=found).verdict.split())
    both = ("effective sample size is not", "R-hat is not")
    assert [one for one in both if one in verdict] == [failed]


def test_misuse_is_told(found: Identification, tmp_path: Path) -> None:
    with pytest.raises(InputsError, match="too few"):
        posterior(found, draws=5)
    with pytest.raises(InputsError, match="compares chains"):
        posterior(found, chains=1)
    found.save(tmp_path / "found.json")
    with pytest.raises(AleatorError, match="read from a file"):
        posterior(aleator.load(tmp_path / "found.json"))
    with pytest.raises(InputsError, match="nothing is identified"):
        posterior(identified(Constant(2.0), Noise(NOISE)))


@pytest.mark.parametrize("package", ["mici", "arviz_stats"])
def test_without_the_extra_it_says_how_to_install(
    package: str, found: Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(AleatorError, match=package) as told:
        posterior(found, draws=10, chains=2)
    assert told.value.remedy == installing("bayes")
    assert {"mici", "arviz-base", "arviz-stats"} <= set(re.findall(r"[\w-]+", told.value.remedy))
