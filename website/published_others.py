"""Published examples of curves, mixtures, limits of measurement, known errors and lives."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import stats

from aleator import (
    By,
    Censoring,
    Constant,
    Free,
    Identification,
    Mixture,
    Noise,
    Normal,
    PowerVariance,
    ScipyLaw,
)
from aleator.core.types import Array
from aleator.laws.law import Law
from benchmarks import small
from website.published import (
    BOOK,
    Example,
    Published,
    answer,
    deviance,
    estimate,
    level,
    log_likelihood,
    table,
    variance,
)

# -------------------------------------------------------------------------------------- curves


def orange() -> Identification:
    """Logistic growth of five trees with a random final girth."""
    data = small.orange()
    return answer(data.simulator, data.frame, data.inputs.laws, "y", data.noise, "id")


def pines(log_rate: Law) -> Identification:
    """Heights of loblolly pines of 14 seeds, with a random final height."""
    laws: dict[str, Law] = {
        "top": Normal(Free(50.0, 200.0), Free(0.1, 50.0)),
        "start": Constant(Free(-30.0, 30.0)),
        "log_rate": log_rate,
    }

    def height(age: Array, top: Array, start: Array, log_rate: Array) -> Array:
        return np.asarray(top + (start - top) * np.exp(-np.exp(log_rate) * age))

    return answer(height, table("loblolly.csv"), laws, "height", Noise(Free(0.05, 10.0)), "Seed")


def soybeans() -> Identification:
    """Logistic growth of soybeans in 48 plots, with a noise that is a power of the weight."""
    laws: dict[str, Law] = {
        "top": Normal(By("1 + C(Year)*C(Variety)", 5.0, 35.0), Free(0.05, 6.0)),
        "half": Constant(By("1 + C(Year) + C(Variety)", 35.0, 70.0)),
        "scale": Constant(By("1 + C(Year)", 4.0, 14.0)),
    }

    def grown(Time: Array, top: Array, half: Array, scale: Array) -> Array:
        return np.asarray(top / (1.0 + np.exp(-(Time - half) / scale)))

    noise = Noise(Free(0.02, 2.0), variance=PowerVariance())
    return answer(grown, table("soybean.csv"), laws, "weight", noise, "Plot")


def theophylline() -> Identification:
    """Theophylline in twelve subjects after a dose at time zero, by one compartment."""
    records = table("theophylline.csv")
    doses = records[records["AMT"] != "."].set_index("ID")[["AMT", "WT"]].astype(float)
    seen = records[(records["EVID"] == 0) & (records["TIME"] > 0.0)]
    frame = pd.DataFrame({
        "id": seen["ID"], "time": seen["TIME"], "y": seen["DV"].astype(float),
        "weight": seen["ID"].map(doses["WT"]),
        "dose": seen["ID"].map(doses["AMT"] * doses["WT"]),
    })  # fmt: skip
    laws: dict[str, Law] = {
        "log_ka": Normal(Free(-1.0, 2.0), Free(0.05, 2.0)),
        "log_v": Normal(Free(2.5, 4.5), Free(0.02, 1.0)),
        "log_cl": Normal(Free(-2.0, 2.0), Free(0.02, 1.0)),
        "slope": Constant(Free(-0.05, 0.05)),
    }

    def concentration(
        time: Array, dose: Array, weight: Array, log_ka: Array, log_v: Array, log_cl: Array,
        slope: Array,
    ) -> Array:  # fmt: skip
        ka, v, k = np.exp(log_ka), np.exp(log_v), np.exp(log_cl + slope * weight - log_v)
        return np.asarray(dose * ka / (v * (ka - k)) * (np.exp(-k * time) - np.exp(-ka * time)))

    return answer(concentration, frame, laws, "y", Noise(Free(0.1, 3.0)), "id")


def decays() -> Identification:
    """Ten decays 10 exp(-k t) at two times, with a noise relative to the value."""
    laws = {"log_k": Normal(Free(-3.0, 2.0), Free(0.01, 2.0))}
    return answer(
        lambda time, log_k: 10.0 * np.exp(-np.exp(log_k) * time), table("wang.csv"), laws, "y",
        Noise(relative=Free(0.02, 2.0)), "id",
    )  # fmt: skip


def of_decays(found: Identification) -> float:
    """Minus two times the log-likelihood at the stated values, without the constant log 2 pi."""
    alpha = {"log_k.mean": np.log(0.5), "log_k.sd": 0.2, "noise.relative": np.sqrt(0.1)}
    return -2.0 * found.log_likelihood_at(alpha) - 20.0 * float(np.log(2.0 * np.pi))


POPULATION = (
    3.9, 5.3, 7.2, 9.6, 13.0, 17.0, 23.0, 31.0, 39.0, 50.0, 62.0, 76.0, 92.0, 106.0, 123.0, 132.0,
    151.0, 179.0, 203.0, 221.0, 250.0, 281.0,
)  # fmt: skip
"""The population of the USA in millions, every ten years from 1790 to 2000."""


def population() -> Identification:
    """Logistic growth from 3.9 millions, by the rate a and the logarithm c of the crowding."""
    frame = pd.DataFrame({"year": np.arange(1790.0, 2001.0, 10.0), "y": POPULATION})

    def grown(year: Array, a: Array, c: Array) -> Array:
        top = 1e-6 * a / np.exp(c)
        return np.asarray(3.9 * top / (3.9 + (top - 3.9) * np.exp(-a * (year - 1790.0))))

    laws = {"a": Constant(Free(0.01, 0.06)), "c": Constant(Free(-26.0, -20.0))}
    return answer(grown, frame, laws, "y", Noise(Free(0.1, 50.0)))


MISRA = (
    (77.6, 10.07), (114.9, 14.73), (141.1, 17.94), (190.8, 23.93), (239.9, 29.61), (289.0, 35.18),
    (332.8, 40.02), (378.4, 44.82), (434.8, 50.76), (477.3, 55.05), (536.8, 61.01), (593.1, 66.40),
    (689.1, 75.47), (760.0, 81.78),
)  # fmt: skip
"""Pressures, and volumes of a gas that is adsorbed."""


def misra() -> Identification:
    """Adsorption b1 (1 - exp(-b2 x)), without scatter."""
    frame = pd.DataFrame(MISRA, columns=["x", "y"])
    laws = {"b1": Constant(Free(100.0, 500.0)), "b2": Constant(Free(1e-4, 2e-3))}
    return answer(
        lambda x, b1, b2: b1 * (1.0 - np.exp(-b2 * x)), frame, laws, "y", Noise(Free(0.01, 5.0))
    )


# ------------------------------------------------------------------------------------ mixtures


def points(frame: pd.DataFrame, outcome: str, count: int, limits: Free, sd: Free) -> Identification:
    """Normal components of the same standard deviation: points with normal noise."""
    law = Mixture(tuple(Constant(limits) for _ in range(count)))
    return answer(level, frame, {"level": law}, outcome, Noise(sd))


def faithful() -> Identification:
    """Minutes between eruptions of a geyser."""
    return points(table("faithful.csv"), "waiting", 2, Free(30.0, 100.0), Free(0.5, 30.0))


def galaxies(count: int) -> Identification:
    """Velocities of 82 galaxies in 1000 km/s."""
    frame = table("galaxies.csv") / 1000.0
    return points(frame, "velocity", count, Free(5.0, 40.0), Free(0.01, 10.0))


# ---------------------------------------------------------------------------- limits of measurement


def fluazinam() -> Identification:
    """Toxic concentrations for 14 species, of which three are only known to be above a limit."""
    frame = table("fluazinam.csv")
    frame["log10"] = np.log10(frame.pop("ec50"))
    return answer(
        level, frame, {"level": Constant(Free(-2.0, 6.0))}, "log10", Noise(Free(0.05, 5.0)),
        censored=Censoring("status", right="above"),
    )  # fmt: skip


def species() -> Identification:
    """The same concentrations, without noise: the level differs between species."""
    frame = table("fluazinam.csv")
    frame["log10"] = np.log10(frame.pop("ec50"))
    return answer(
        level, frame, {"level": Normal(Free(-2.0, 6.0), Free(0.05, 5.0))}, "log10", None,
        censored=Censoring("status", right="above"),
    )  # fmt: skip


def hours() -> pd.DataFrame:
    """Lives of motor insulation above 150 degrees: some motors are still running."""
    frame = table("motors.csv")
    frame = frame[frame["temperature"] > 150].reset_index(drop=True)
    frame["inverse"] = 1000.0 / (273.2 + frame.pop("temperature"))
    frame["log_hours"] = np.log(frame.pop("hours"))
    return frame


LINE = {"a": Constant(Free(-40.0, 40.0)), "b": Constant(Free(-20.0, 30.0))}


def motors() -> Identification:
    """Lognormal lives, whose scatter is taken as an error of measurement."""
    return answer(
        lambda inverse, a, b: a + b * inverse, hours(), LINE, "log_hours", Noise(Free(0.05, 5.0)),
        censored=Censoring("status", right="running"),
    )  # fmt: skip


def motors_that_differ() -> Identification:
    """The same without noise: the logarithm of a motor's life is its own by a normal law."""
    return answer(
        lambda inverse, a, b, own: a + b * inverse + own, hours(),
        {**LINE, "own": Normal(0.0, Free(0.05, 5.0))}, "log_hours", None,
        censored=Censoring("status", right="running"),
    )  # fmt: skip


# --------------------------------------------------------------- known errors, and lives to failure


TRIALS = (
    (4, 119, 11, 128), (6, 300, 29, 274), (3, 228, 11, 209), (62, 13536, 248, 12619),
    (33, 5036, 47, 5761), (180, 1361, 372, 1079), (8, 2537, 10, 619), (505, 87886, 499, 87892),
    (29, 7470, 45, 7232), (17, 1699, 65, 1600), (186, 50448, 141, 27197), (5, 2493, 3, 2338),
    (27, 16886, 29, 17825),
)  # fmt: skip
"""Thirteen trials of a vaccine: ill and well among the vaccinated, ill and well among others."""


LATITUDES = (44.0, 55.0, 42.0, 52.0, 13.0, 44.0, 19.0, 13.0, 27.0, 42.0, 18.0, 33.0, 33.0)
"""The absolute latitudes of the trials, in degrees."""
NORMAL_LEVEL = Normal(Free(-3.0, 3.0), Free(0.0, 3.0))


def vaccine() -> Identification:
    """Log odds ratios of thirteen trials, whose standard errors are known."""
    counts = np.array(TRIALS, dtype=float)
    y = np.log(counts[:, 0] * counts[:, 3] / (counts[:, 1] * counts[:, 2]))
    frame = pd.DataFrame({"y": y, "sd": np.sqrt((1.0 / counts).sum(axis=1))})
    return answer(level, frame, {"level": NORMAL_LEVEL}, "y", Noise("sd"))


def risks(law: Law) -> Identification:
    """Log risk ratios of the same trials, by the restricted likelihood."""
    ill, well, ill_of_others, well_of_others = np.array(TRIALS, dtype=float).T
    vaccinated, others = ill + well, ill_of_others + well_of_others
    variance = 1.0 / ill - 1.0 / vaccinated + 1.0 / ill_of_others - 1.0 / others
    frame = pd.DataFrame({
        "y": np.log(ill / vaccinated) - np.log(ill_of_others / others),
        "sd": np.sqrt(variance), "latitude": LATITUDES,
    })  # fmt: skip
    return answer(level, frame, {"level": law}, "y", Noise("sd"), restricted=True)


def schools() -> Identification:
    """Effects of coaching in eight schools, whose standard errors are known."""
    effects, errors = (28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0), (15, 10, 16, 11, 9, 11, 10, 18)
    frame = pd.DataFrame({"y": effects, "sd": errors})
    laws = {"level": Normal(Free(-50.0, 50.0), Free(0.0, 50.0))}
    return answer(level, frame, laws, "y", Noise("sd"))


BEARINGS = (
    17.88, 28.92, 33.00, 41.52, 42.12, 45.60, 48.40, 51.84, 51.96, 54.12, 55.56, 67.80,
    68.64, 68.64, 68.88, 84.12, 93.12, 98.64, 105.12, 105.84, 127.92, 128.04, 173.40,
)  # fmt: skip
"""Millions of revolutions to failure of 23 ball bearings."""


def life(x: Array) -> Array:
    """A life, by its logarithm."""
    return np.asarray(np.exp(x))


def bearings() -> Identification:
    """A Weibull law of lives: the logarithm of a life has a Gumbel law of the least."""
    law = ScipyLaw(stats.gumbel_l(), mean=Free(2.0, 6.0), sd=Free(0.05, 2.0))
    return answer(life, pd.DataFrame({"revolutions": BEARINGS}), {"x": law}, "revolutions", None)


def shape(found: Identification) -> float:
    """The shape of the Weibull law: pi / sqrt(6) over the standard deviation of the logarithm."""
    return float(np.pi / np.sqrt(6.0) / found.alpha["x.sd"].estimate)


def scale(found: Identification) -> float:
    """The scale of the Weibull law, by the mean of the logarithm."""
    return float(np.exp(found.alpha["x.mean"].estimate + np.euler_gamma / shape(found)))


STOPPED = (
    "their iterations ended before the maximum. The final girth enters linearly, so that the "
    "likelihood has a closed form, whose maximum is ours to all digits (`benchmarks small`)."
)
STEP = (
    "their linear least squares are one step from the starting values. The least squares of the "
    "model itself, by another program, are ours: a = 0.027368, c = -23.2389."
)
FOUR = (
    "their iterations ended before the maximum. Those of the EM algorithm, carried to their end, "
    "have 416.494."
)
FLAT = (
    "their search ended before the maximum, which is flat. The likelihood of the normal law with "
    "limits, maximized by SciPy, has 2.16162 and 1.16735."
)
PINES = (
    "their iterations ended before the maximum. Their number is the closed form's at their "
    "estimates, -114.7428; its maximum is -114.6968."
)
LINEARIZED = (
    "they linearize the model in the random effects. By a quadrature of our own the log-likelihood "
    "is"
)
OTHERS = (
    Example(
        "Orange trees", "SAS, PROC NLMIXED, getting started",
        "final / (1 + exp(-(age - half) / scale)); final normal by `tree`", orange,
        (
            Published("-2 log L", "263.1", deviance),
            Published("mean of final girths", "192.05", estimate("final.mean")),
            Published("half", "727.90", estimate("half.value"), 0.01, STOPPED),
            Published("scale", "348.07", estimate("scale.value")),
            Published("variance of final girths", "999.88", variance("final.sd"), 2.0, STOPPED),
            Published("variance of the noise", "61.514", variance("noise.sd"), 2e-3, STOPPED),
        ),
    ),
    Example(
        "Loblolly pines", "R package nlme, example of `nlme`",
        "top + (start - top) exp(-exp(log_rate) age); top normal by `Seed`",
        lambda: pines(Constant(Free(-6.0, -1.0))),
        (
            Published("log L", "-114.7428", log_likelihood, 0.05, PINES),
            Published("sd of the noise", "0.71886", estimate("noise.sd"), 5e-4, PINES),
        ),
    ),
    Example(
        "Loblolly pines, two random effects", "R package nlme, example of `nlme`",
        "the same; log_rate normal too",
        lambda: pines(Normal(Free(-6.0, -1.0), Free(0.001, 1.0))),
        (
            Published(
                "log L", "-113.4831", log_likelihood, 0.02,
                f"{LINEARIZED} -113.4870 at their estimates, and its maximum is -113.4676.",
            ),
        ),
    ),
    Example(
        "Soybeans, a power variance", BOOK,
        "top / (1 + exp(-(Time - half) / scale)); top normal by `Plot`, means by `Year` and "
        "`Variety`; `variance` a power", soybeans,
        (
            Published(
                "log L", "-292", log_likelihood, 2.0,
                f"{LINEARIZED} -290.2538 at its maximum.",
            ),
        ),
    ),
    Example(
        "Theophylline", "R package saemix, user guide",
        "one compartment; log ka, log V, log CL normal by subject, log CL by `weight`",
        theophylline,
        (
            Published(
                "-2 log L", "344.8896", deviance, 0.2,
                "SAEM ends near the maximum, which makes theirs larger, and importance sampling of "
                "5000 draws has a random error. By a quadrature of our own ours is 344.747.",
            ),
        ),
    ),
    Example(
        "Decays with a relative error", "Wang 2007",
        "10 exp(-exp(log_k) time); log_k normal; `noise.relative`", decays,
        (
            Published(
                "-2 log L, without 20 log(2 pi)", "39.354803", of_decays, 2e-5,
                "the nodes are those of the maximum, and the value is one at other estimates.",
            ),
        ),
    ),
    Example(
        "Population of the USA", "OpenTURNS, calibration of a logistic model",
        "logistic growth from 3.9 millions; a and c constant", population,
        (
            Published("a", "0.02660", estimate("a.value"), 1e-3, STEP),
            Published("c", "-23.171", estimate("c.value"), 0.1, STEP),
        ),
    ),
    Example(
        "Adsorption", "NIST StRD, Misra1a", "b1 (1 - exp(-b2 x)); constants", misra,
        (
            Published("b1", "238.942", estimate("b1.value")),
            Published("b2", "0.000550156", estimate("b2.value")),
            Published(
                "residual sd", "0.101879", estimate("noise.sd", lambda sd: sd * (14 / 12) ** 0.5)
            ),
        ),
    ),
    Example(
        "Old Faithful, two components", "R package mixtools, vignette",
        "two points; normal noise", faithful,
        (
            Published("log L", "-1034.002", log_likelihood),
            Published("share of the first", "0.36085", estimate("level.1.share")),
            Published("first mean", "54.6136", estimate("level.1.value")),
            Published("second mean", "80.0903", estimate("level.2.value")),
            Published("sd", "5.86909", estimate("noise.sd")),
        ),
    ),
    Example(
        "Galaxies, three components", "Aitkin 2001", "three points; normal noise",
        lambda: galaxies(3),
        (Published("-2 log L", "425.36", deviance),),
    ),
    Example(
        "Galaxies, four components", "Aitkin 2001", "four points; normal noise",
        lambda: galaxies(4),
        (Published("-2 log L", "416.50", deviance, 0.01, FOUR),),
    ),
    Example(
        "Fluazinam, values above a limit", "R package fitdistrplus",
        "level constant; normal noise, `censored`", fluazinam,
        (
            Published("log L", "-20.41212", log_likelihood),
            Published("mean", "2.16145", estimate("level.value"), 2e-4, FLAT),
            Published("sd", "1.16729", estimate("noise.sd"), 1e-4, FLAT),
        ),
    ),
    Example(
        "Motor insulation, motors still running", "R package survival; SAS, PROC LIFEREG",
        "a + b inverse; normal noise of log hours, `censored`", motors,
        (
            Published("a", "-10.471", estimate("a.value")),
            Published("b", "8.322", estimate("b.value")),
            Published("sd", "0.604", estimate("noise.sd")),
        ),
    ),
    Example(
        "The same concentrations, as species that differ", "R package fitdistrplus",
        "level normal; `censored`, no noise", species,
        (
            Published("log L", "-20.41212", log_likelihood),
            Published("mean", "2.16145", estimate("level.mean"), 2e-4, FLAT),
            Published("sd", "1.16729", estimate("level.sd"), 1e-4, FLAT),
        ),
    ),
    Example(
        "The same lives, of motors that differ", "R package survival; SAS, PROC LIFEREG",
        "a + b inverse + own, own normal; `censored`, no noise", motors_that_differ,
        (
            Published("a", "-10.471", estimate("a.value")),
            Published("b", "8.322", estimate("b.value")),
            Published("sd", "0.604", estimate("own.sd")),
        ),
        slow=True,
    ),
    Example(
        "BCG vaccine, 13 trials", "van Houwelingen et al. 2002; R package metafor",
        "level normal; `noise.sd` a column of known sds", vaccine,
        (
            Published("mean log odds ratio", "-0.7420", estimate("level.mean")),
            Published("variance between trials", "0.3025", variance("level.sd")),
        ),
    ),
    Example(
        "BCG vaccine, risk ratios, REML", "R package metafor", "the same; `restricted`",
        lambda: risks(NORMAL_LEVEL),
        (
            Published("mean log risk ratio", "-0.7145", estimate("level.mean")),
            Published("variance between trials", "0.3132", variance("level.sd")),
        ),
    ),
    Example(
        "BCG vaccine by latitude, REML", "R package metafor",
        "level normal, its mean by `latitude`; `restricted`",
        lambda: risks(Normal(By("1 + latitude", -3.0, 3.0), Free(0.0, 3.0))),
        (
            Published("intercept", "0.2515", estimate("level.mean[Intercept]")),
            Published("slope by latitude", "-0.0291", estimate("level.mean[latitude]")),
            Published("sd between trials", "0.2763", estimate("level.sd")),
        ),
    ),
    Example(
        "Eight schools", "Gelman et al. 2013, 5.5", "level normal; `noise.sd` a column", schools,
        (
            Published("mean", "7.7", estimate("level.mean")),
            Published("sd between schools", "0.0", estimate("level.sd")),
        ),
    ),
    Example(
        "Ball bearings, Weibull law", "Lawless 1982",
        "exp(x); x Gumbel (`scipy.stats.gumbel_l`), no noise", bearings,
        (
            Published("shape", "2.10", shape),
            Published(
                "scale", "81.88", scale, 0.006,
                "the likelihood equations, solved for their root, give 81.8746.",
            ),
        ),
    ),
)  # fmt: skip
