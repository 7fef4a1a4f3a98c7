"""Published examples of linear mixed models, with levels and by the restricted likelihood too."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from aleator import AR1, By, Constant, Free, Identification, Noise, Normal
from aleator.core.types import Array
from aleator.laws.law import Law
from website.published import (
    BOOK,
    Example,
    Published,
    answer,
    deviance,
    estimate,
    level,
    log_likelihood,
    log_restricted,
    restricted,
    table,
)


def reaction(days: Array, start: Array, slope: Array) -> Array:
    """A straight line in the days."""
    return np.asarray(start + slope * days)


def sleep(
    start: Law, slope: Law, *together: tuple[str, str], restricted: bool = False
) -> Identification:
    """Reaction times of 18 persons over ten days."""
    limits = dict.fromkeys(together, Free(-0.99, 0.99))
    return answer(
        reaction, table("sleepstudy.csv"), {"start": start, "slope": slope}, "reaction",
        Noise(Free(1.0, 200.0)), "unit", limits, restricted=restricted,
    )  # fmt: skip


START = Normal(Free(100.0, 400.0), Free(0.0, 200.0))
SLOPE = Normal(Free(-50.0, 50.0), Free(0.0, 50.0))


def dyestuff(*, restricted: bool = False) -> Identification:
    """The yields of six batches of dyestuff."""
    laws = {"level": Normal(Free(1000.0, 2000.0), Free(0.0, 500.0))}
    return answer(
        level, table("dyestuff.csv"), laws, "yield", Noise(Free(1.0, 500.0)), "unit",
        restricted=restricted,
    )  # fmt: skip


def rail(*, restricted: bool = False) -> Identification:
    """Travel times of ultrasonic waves in six rails, in ns above a common value."""
    laws = {"level": Normal(Free(0.0, 150.0), Free(0.0, 100.0))}
    return answer(
        level, table("rail.csv"), laws, "travel", Noise(Free(0.1, 50.0)), "rail",
        restricted=restricted,
    )  # fmt: skip


def silver() -> Identification:
    """The atomic weight of silver by two instruments, in 1e-7 above 107.868."""
    laws = {"level": Normal(Free(1000.0, 2000.0), Free(0.0, 1000.0))}
    return answer(
        level, table("silver.csv"), laws, "silver", Noise(Free(10.0, 1000.0)), "instrument",
        restricted=True,
    )  # fmt: skip


def rats() -> Identification:
    """Weights of 16 rats over 64 days: a line with random start and rate, means by diet."""
    laws = {
        "start": Normal(By("1 + C(Diet)", 100.0, 800.0), Free(5.0, 150.0)),
        "rate": Normal(By("1 + C(Diet)", -2.0, 4.0), Free(0.02, 2.0)),
    }
    frame = table("body_weight.csv")
    return answer(
        lambda Time, start, rate: start + rate * Time, frame[["Rat", "Diet", "Time", "weight"]],
        laws, "weight", Noise(Free(0.5, 30.0)), "Rat", {("start", "rate"): Free(-0.95, 0.95)},
    )  # fmt: skip


def ovary() -> Identification:
    """Follicles of eleven mares over a cycle, with errors of an autoregressive process."""
    laws: dict[str, Law] = {
        "a": Normal(Free(0.0, 30.0), Free(0.1, 10.0)),
        "b": Normal(Free(-10.0, 10.0), Free(0.1, 10.0)),
        "c": Constant(Free(-10.0, 10.0)),
    }

    def wave(Time: Array, a: Array, b: Array, c: Array) -> Array:
        return np.asarray(a + b * np.sin(2.0 * np.pi * Time) + c * np.cos(2.0 * np.pi * Time))

    return answer(
        wave, table("ovary.csv"), laws, "follicles", Noise(Free(0.5, 10.0), correlation=AR1()),
        "Mare", restricted=True,
    )  # fmt: skip


def total(mean: Array, a: Array, b: Array) -> Array:
    """A mean with two shifts."""
    return np.asarray(mean + a + b)


def shifted(
    name: str, outcome: str, limits: Free, widest: float, of: Mapping[str, str | None]
) -> Identification:
    """A mean with normal shifts `of` levels; the level None is that of the experiment."""
    laws: dict[str, Law] = {"mean": Constant(limits)}
    laws |= {shift: Normal(0.0, Free(0.0, widest)) for shift in of}
    levels = {shift: column for shift, column in of.items() if column is not None}
    frame = table(name)
    return answer(
        total, frame, laws, outcome, Noise(Free(0.01, widest)), "id" if "id" in frame else None,
        None, levels,
    )  # fmt: skip


SIMULATED = (
    (7.298, 3.846, 2.434, 9.566, 7.990), (5.220, 6.556, 0.608, 11.788, -0.892),
    (0.110, 10.386, 13.434, 5.510, 8.166), (2.212, 4.852, 7.092, 9.288, 4.980),
    (0.282, 9.014, 4.458, 9.446, 7.198), (1.722, 4.782, 8.106, 0.758, 3.758),
)  # fmt: skip
"""Six batches of five simulated yields, whose batches differ no more than samples do."""


def dyestuff2() -> Identification:
    """Simulated yields: the standard deviation of the batches is zero."""
    frame = pd.DataFrame(
        [(batch, y) for batch, row in enumerate(SIMULATED) for y in row], columns=["batch", "yield"]
    )
    laws = {"level": Normal(Free(0.0, 20.0), Free(0.0, 10.0))}
    return answer(level, frame, laws, "yield", Noise(Free(0.1, 20.0)), "batch")


LME4 = "lme4; MixedModels.jl"
LINEAR = (
    Example(
        "Sleep study, a random intercept", "R package lme4",
        "start + slope days; start normal by `unit`",
        lambda: sleep(START, Constant(Free(-50.0, 50.0))),
        (Published("AIC", "1802.1", lambda found: deviance(found) + 8.0),),
    ),
    Example(
        "Sleep study, intercept and slope", LME4,
        "start + slope days; both normal by `unit`",
        lambda: sleep(START, SLOPE),
        (
            Published("-2 log L", "1752.0033", deviance),
            Published("mean of slopes", "10.4673", estimate("slope.mean")),
            Published("sd of slopes", "5.7994", estimate("slope.sd")),
        ),
    ),
    Example(
        "Sleep study, correlated", LME4,
        "the same, correlated",
        lambda: sleep(START, SLOPE, ("start", "slope")),
        (
            Published("-2 log L", "1751.9393", deviance),
            Published("correlation", "0.0813", estimate("correlation.start.slope")),
        ),
    ),
    Example(
        "Dyestuff", LME4, "level normal by `batch`", dyestuff,
        (
            Published("-2 log L", "327.3271", deviance),
            Published("sd of batches", "37.260", estimate("level.sd")),
            Published("sd of samples", "49.5101", estimate("noise.sd")),
        ),
    ),
    Example(
        "Dyestuff, REML", LME4, "the same; `restricted`", lambda: dyestuff(restricted=True),
        (
            Published("-2 log L_R", "319.6543", restricted),
            Published("sd of batches", "42.00", estimate("level.sd")),
            Published("sd of samples", "49.51", estimate("noise.sd")),
        ),
    ),
    Example(
        "Sleep study, correlated, REML", LME4, "start + slope days; correlated; `restricted`",
        lambda: sleep(START, SLOPE, ("start", "slope"), restricted=True),
        (
            Published("-2 log L_R", "1743.628", restricted),
            Published("sd of intercepts", "24.74", estimate("start.sd")),
            Published("sd of slopes", "5.92", estimate("slope.sd")),
        ),
    ),
    Example(
        "Rails", BOOK, "level normal by `rail`", rail,
        (
            Published("log L", "-64.28", log_likelihood),
            Published("mean", "66.5", estimate("level.mean")),
            Published("sd of rails", "22.624", estimate("level.sd")),
            Published("sd of the noise", "4.0208", estimate("noise.sd")),
        ),
    ),
    Example(
        "Rails, REML", BOOK, "the same; `restricted`", lambda: rail(restricted=True),
        (
            Published("AIC", "128.18", lambda found: restricted(found) + 6.0),
            Published("sd of the noise", "4.0208", estimate("noise.sd")),
        ),
    ),
    Example(
        "Silver by two instruments, REML", "NIST StRD, AtmWtAg", "level normal; `restricted`",
        silver,
        (
            Published("residual sd, 1e-7", "151.05", estimate("noise.sd")),
            Published("sd of instruments, 1e-7", "119.2", estimate("level.sd")),
        ),
    ),
    Example(
        "Rats on three diets", BOOK, "start + rate Time; correlated, means by `Diet`", rats,
        (
            Published("rate, diet 1", "0.360", estimate("rate.mean[Intercept]")),
            Published("rate, diet 2 more", "0.606", estimate("rate.mean[Diet=2]")),
            Published("rate, diet 3 more", "0.298", estimate("rate.mean[Diet=3]")),
            Published("start, diet 1", "251.652", estimate("start.mean[Intercept]")),
            Published("sd of the noise", "4.444", estimate("noise.sd")),
        ),
    ),
    Example(
        "Follicles of mares, AR(1), REML", BOOK,
        "a + b sin(2 pi Time) + c cos(2 pi Time); a, b normal by `Mare`; `correlation` AR(1); "
        "`restricted`", ovary,
        (
            Published("log L_R", "-774.72", log_restricted),
            Published("correlation", "0.572", estimate("noise.rho")),
        ),
        slow=True,
    ),
    Example(
        "Pastes, casks within batches", LME4, "mean + a + b; a of the level `batch`",
        lambda: shifted(
            "pastes.csv", "strength", Free(0.0, 100.0), 20.0, {"a": "batch", "b": None}
        ),
        (Published("-2 log L", "247.9945", deviance),),
    ),
    Example(
        "Oxide, wafers within lots", "R package nlme",
        "mean + a + b; a of the level `lot`",
        lambda: shifted(
            "oxide.csv", "thickness", Free(1000.0, 3000.0), 100.0, {"a": "lot", "b": None}
        ),
        (Published("-2 log L", "458.6769", deviance),),
    ),
    Example(
        "Penicillin, plates and samples crossed", LME4,
        "mean + a + b; a of the level `plate`, b of the level `sample`",
        lambda: shifted(
            "penicillin.csv", "diameter", Free(0.0, 100.0), 20.0, {"a": "plate", "b": "sample"}
        ),
        (Published("-2 log L", "332.1883", deviance),),
    ),
    Example(
        "Dyestuff2, an sd of zero", LME4, "level normal by `batch`", dyestuff2,
        (
            Published("-2 log L", "162.8730", deviance),
            Published("sd of batches", "0.0000", estimate("level.sd")),
        ),
    ),
)  # fmt: skip
