"""Each kind of extension, made outside the package: in Python, and named in a study.toml."""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from identifications import unjudged
from scipy import stats

from aleator import Check, Collocation, Constant, Free, Inputs, Noise, Normal
from aleator.cli import main
from aleator.errors import SimulatorError, StudyError
from aleator.study import load_study

pytestmark = pytest.mark.usefixtures("unreported", "unjudged_commands")
UNCHECKED = Check(0)
Install = Callable[[str, str, str], None]
Write = Callable[..., Path]
NORMAL = """
[parameters.x]
law = "normal"
mean = {lower = -2.0, upper = 4.0}
sd = {lower = 0.05, upper = 3.0}
"""
FUNCTION = '[simulator]\nfunction = "model.py:y"\nvectorized = true\n'
COLLOCATION = '[propagation]\nmethod = "collocation"\nnodes = 6\n'
ITSELF = "def y(x): return x\n"


def itself(x: float) -> float:
    return x


def identified(study: Path) -> dict[str, Any]:
    """What `aleator identify` writes."""
    out = study.parent / "out"
    options = ["--no-verify", "--no-figures", "--quiet", "--output", str(out)]
    done = CliRunner().invoke(main, ["identify", str(study), *options], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    document: dict[str, Any] = json.loads((out / "identification.json").read_text())
    return document


def estimates(document: dict[str, Any]) -> list[float]:
    return [found["estimate"] for found in document["alpha"].values()]


def table(y: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame({"id": [str(k) for k in range(y.size)], "y": y})


def plugin(name: str) -> Any:
    return importlib.import_module(name)


def test_a_law(install: Install, study: Write) -> None:
    """Of a Weibull law of known shape k, scale^k is the mean of y^k."""
    install("aleator.laws", "weibull", "weibull:Weibull")
    y = stats.weibull_min(2.0, scale=1.5).rvs(40, random_state=1)
    scale = math.sqrt(np.mean(y**2))
    value = stats.weibull_min(2.0, scale=scale).logpdf(y).sum()
    law = plugin("weibull").Weibull(shape=2.0, scale=Free(0.5, 3.0))
    found = unjudged(
        itself, table(y), Inputs({"x": law}), outcome="y", vectorized=True, verification=UNCHECKED
    )
    assert estimates(found.to_dict()) == pytest.approx([2.0, scale], rel=2e-3)
    assert found.to_dict()["log_likelihood"]["estimated"] == pytest.approx(value, abs=1e-3)
    section = '[parameters.x]\nlaw = "weibull"\nshape = 2\nscale = {lower = 0.5, upper = 3}\n'
    document = identified(study(y.tolist(), FUNCTION + section, ITSELF))
    assert estimates(document) == pytest.approx([2.0, scale], rel=2e-3)


def test_a_density(install: Install, study: Write) -> None:
    """An outcome with the mean and sd of alpha: the best logistic law of the outcomes, by SciPy."""
    install("aleator.densities", "logistic", "logistic:Logistic")
    y = stats.logistic(1.0, 0.4).rvs(50, random_state=2)
    mean, scale = stats.logistic.fit(y)
    alpha = [mean, scale * math.pi / math.sqrt(3.0)]
    inputs = Inputs({"x": Normal(Free(-2.0, 4.0), Free(0.05, 3.0))})
    found = unjudged(
        itself, table(y), inputs, outcome="y", vectorized=True, verification=UNCHECKED,
        density=plugin("logistic").Logistic(), propagation=Collocation(nodes=6),
    )  # fmt: skip
    assert estimates(found.to_dict()) == pytest.approx(alpha, abs=1e-3)
    assert found.to_dict()["log_likelihood"]["estimated"] == pytest.approx(
        stats.logistic(mean, scale).logpdf(y).sum(), abs=1e-6
    )
    text = FUNCTION + NORMAL + COLLOCATION + '[density]\nkind = "logistic"\n'
    document = identified(study(y.tolist(), text, ITSELF))
    assert estimates(document) == pytest.approx(alpha, abs=1e-3)


def test_an_observation_model(install: Install, study: Write) -> None:
    """A constant with the noise of Student's t: its location and scale, by SciPy."""
    install("aleator.observations", "student", "student:StudentError")
    y = stats.t(4.0, 1.0, 0.3).rvs(60, random_state=5)
    _, center, scale = stats.t.fit(y, fdf=4.0)
    value = stats.t(4.0, center, scale).logpdf(y).sum()
    noise = Noise(Free(0.01, 2.0), plugin("student").StudentError(4.0))
    inputs = Inputs({"x": Constant(Free(-2.0, 4.0))})
    found = unjudged(
        itself, table(y), inputs, outcome="y", vectorized=True, verification=UNCHECKED, noise=noise
    )
    assert estimates(found.to_dict()) == pytest.approx([center, scale], abs=1e-3)
    assert found.to_dict()["log_likelihood"]["estimated"] == pytest.approx(value, abs=1e-3)
    section = '[parameters.x]\nlaw = "constant"\nvalue = {lower = -2, upper = 4}\n'
    section += '[noise]\nkind = "student"\ndf = 4\nsd = {lower = 0.01, upper = 2}\n'
    document = identified(study(y.tolist(), FUNCTION + section, ITSELF))
    assert estimates(document) == pytest.approx([center, scale], abs=1e-3)


def test_a_simulator(install: Install, study: Write, tmp_path: Path) -> None:
    """y = 1 + 2 x is normal: mean and sd of the outcomes, shifted and halved."""
    install("aleator.simulators", "lookup", "lookup:Lookup")
    curve = tmp_path / "curve.csv"
    curve.write_text("-40,-79\n0,1\n40,81\n")
    y = stats.norm(3.0, 0.8).rvs(40, random_state=3)
    alpha = [0.5 * (y.mean() - 1.0), 0.5 * y.std()]
    inputs = Inputs({"x": Normal(Free(-2.0, 4.0), Free(0.05, 3.0))})
    found = unjudged(
        plugin("lookup").Lookup(curve), table(y)[["y"]], inputs, outcome="y", verification=UNCHECKED
    )
    assert estimates(found.to_dict()) == pytest.approx(alpha, abs=2e-3)
    path = study(y.tolist(), '[simulator]\nlookup = "curve.csv"\n' + NORMAL)
    assert estimates(identified(path)) == pytest.approx(alpha, abs=2e-3)
    assert load_study(path).simulator == plugin("lookup").Lookup(curve)
    curve.write_text("1,2,3\n")
    with pytest.raises(SimulatorError, match=r"'simulator\.lookup'"):
        load_study(path)


def test_a_search(install: Install, study: Write) -> None:
    """The mean and sd of the outcomes are the maximum of a normal law."""
    install("aleator.searches", "nelder_mead", "simplex:nelder_mead")
    y = stats.norm(1.0, 0.6).rvs(30, random_state=4)
    inputs = Inputs({"x": Normal(Free(-2.0, 4.0), Free(0.05, 3.0))})
    found = unjudged(
        itself, table(y), inputs, outcome="y", vectorized=True, verification=UNCHECKED,
        search=plugin("simplex").nelder_mead(), propagation=Collocation(nodes=6),
    )  # fmt: skip
    assert estimates(found.to_dict()) == pytest.approx([y.mean(), y.std()], abs=2e-3)
    text = FUNCTION + NORMAL + COLLOCATION + '[search]\nmethod = "nelder_mead"\ntolerance = 1e-9\n'
    document = identified(study(y.tolist(), text, ITSELF))
    assert estimates(document) == pytest.approx([y.mean(), y.std()], abs=2e-3)


# ------------------------------------------------------------------------------ what is told


def test_a_key_of_a_plugin_is_told_as_one_of_the_house(install: Install, study: Write) -> None:
    install("aleator.laws", "weibull", "weibull:Weibull")

    def refused(section: str) -> StudyError:
        with pytest.raises(StudyError) as error:
            load_study(study([1.0, 2.0], FUNCTION + "[parameters.x]\n" + section, ITSELF))
        assert error.value.remedy
        return error.value

    told = str(refused('law = "weibull"\nshpe = 2\nscale = 1'))
    assert "study.toml: key 'parameters.x.shpe'" in told
    assert "did you mean 'shape'" in told
    assert "'parameters.x.scale' is missing" in str(refused('law = "weibull"\nshape = 2'))
    assert "'parameters.x.shape': \"2\"" in str(refused('law = "weibull"\nshape = "2"\nscale = 1'))
    told = str(refused('law = "weibull"\nshape = 0\nscale = 1'))
    assert "'parameters.x'" in told
    assert "shape" in told
    told = str(refused('law = "weibul"'))
    assert "did you mean 'weibull'" in told
    assert "aleator.laws" in told
    assert all(name in told for name in ("truncated_normal", "scipy"))


@pytest.mark.parametrize(
    ("value", "cause"),
    [
        ("no_such_module:Law", "ModuleNotFoundError"),
        ("weibull:NoSuchLaw", "AttributeError"),
        ("weibull:__doc__", "no class or function"),
    ],
)
def test_a_plugin_that_is_broken_is_named(
    install: Install, study: Write, value: str, cause: str
) -> None:
    install("aleator.laws", "broken", value)
    with pytest.raises(StudyError) as error:
        load_study(study([1.0, 2.0], FUNCTION + '[parameters.x]\nlaw = "broken"\n', ITSELF))
    told = str(error.value)
    assert "'parameters.x.law'" in told
    assert all(part in told for part in ("'broken'", value, "a-broken 1.0", cause))


def test_two_plugins_of_one_name_are_both_named(install: Install, study: Write) -> None:
    install("aleator.laws", "weibull", "weibull:Weibull")
    install("aleator.laws", "weibull", "other:Weibull", distribution="another")
    with pytest.raises(StudyError) as error:
        load_study(study([1.0, 2.0], FUNCTION + '[parameters.x]\nlaw = "weibull"\n', ITSELF))
    assert all(name in str(error.value) for name in ("a-weibull", "another"))


def test_what_comes_along_cannot_be_replaced(install: Install, study: Write) -> None:
    install("aleator.laws", "normal", "no_such_module:Law")
    path = study([1.0, 2.0], FUNCTION + NORMAL, ITSELF)
    assert load_study(path).inputs.laws["x"] == Normal(Free(-2.0, 4.0), Free(0.05, 3.0))
