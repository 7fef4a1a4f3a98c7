"""The course of one engagement: current, pressures, piston, torques and speeds over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aleator.views.axes import BLACK, BLUE, GRAY, GREEN, VERMILION
from examples.wet_clutch.model import CLUTCH
from reproduction.canvas import DASHES, DOTS, explain
from reproduction.clutch.study import SHOWN
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

UNMEASURED = Claim(
    "Simulated and measured signals agree in their course.",
    "a measured signal beside it",
    "the virtual test bench measures shifting times only",
    Verdict.NOT_COMPARABLE,
)
SIZE = (9.0, 3.8)
STEP = 5  # every fifth experiment is run for the claim on the torque


def feedforward(context: Context) -> Reproduction:
    """Fig. 8: the current with its three control parameters."""
    study = context.clutch
    course = study.course(until=2.2)
    table = course[["time", "current"]]
    row = study.table.iloc[SHOWN - 1]
    signals = study.table[["pulse_duration", "hold_current", "pulse_current"]]
    arrival = _contact_speed(course)
    unbroken = _contact_speed(study.course(hold_current=CLUTCH.current.high, pulse_current=0.0))

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.plot(table["time"], table["current"], color=BLUE, lw=1.6)
        _name_parameters(axes, row)
        axes.set(xlabel="time [s]", ylabel="current u [A]", xlim=(-0.03, 2.2), ylim=(0.0, 0.75))

    claims = (
        Claim(
            "Three parameters set the current; 18 different signals were tested.",
            "18",
            f"{len(signals.drop_duplicates())} different signals in the design",
            Verdict.of(len(signals.drop_duplicates()) == 18),
        ),
        Claim(
            "Lowering the current after the filling pulse avoids a hard collision.",
            "no number",
            f"the piston meets the plates at {1e3 * arrival:.1f} mm/s, and at "
            f"{1e3 * unbroken:.1f} mm/s if the current stays high",
            Verdict.of(arrival < unbroken),
            "the parameters of the hydraulics are invented",
        ),
    )
    return Reproduction({"": table}, draw, claims, SIZE)


def pressure(context: Context) -> Reproduction:
    """Fig. 10a: overpressure in the chamber, and the part of it that presses on the plates."""
    course = context.clutch.course()
    touch = _time_of_contact(course)
    table = pd.DataFrame(
        {
            "time": course["time"],
            "pressure_bar": 1e-5 * course["pressure"],
            "plate_pressure_bar": 1e-5 * course["plate_pressure"],
        }
    )

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.plot(table["time"], table["pressure_bar"], color=BLUE, label="chamber p_hc")
        axes.plot(
            table["time"], table["plate_pressure_bar"], color=VERMILION, ls=DASHES, label="plates p"
        )
        axes.axvline(touch, color=GRAY, lw=1.0, ls=DOTS, label="first contact")
        axes.set(xlabel="time [s]", ylabel="overpressure [bar]", xlim=(0.0, 2.0))
        axes.set_ylim(bottom=0.0)
        explain(canvas, axes)

    before = float(course.loc[course["time"] < touch, "plate_pressure"].max())
    claims = (
        UNMEASURED,
        Claim(
            "Pressure on the plates begins when the piston reaches a threshold.",
            "no number",
            f"at {touch:.3f} s; before, at most {before:.0f} Pa",
            Verdict.of(before == 0.0),
            "by the paper's equation for p",
        ),
    )
    return Reproduction({"": table}, draw, claims, SIZE)


def position(context: Context) -> Reproduction:
    """Fig. 10b: the position of the piston, and the share of friction in the torque."""
    course, plates = context.clutch.course(), CLUTCH.plates
    sigma = (course["piston"] - plates.z_contact) / (plates.z_max - plates.z_contact)
    closed = sigma.clip(0.0, 1.0)
    table = pd.DataFrame(
        {
            "time": course["time"],
            "piston_mm": 1e3 * course["piston"],
            "transition": 3.0 * closed**2 - 2.0 * closed**3,
        }
    )

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        share = axes.twinx()
        axes.plot(table["time"], table["piston_mm"], color=BLUE, label="piston z [mm]")
        ends = ((plates.z_contact, DOTS, "contact z_p"), (plates.z_max, DASHES, "full z_M"))
        for height, style, label in ends:
            axes.axhline(1e3 * height, color=GRAY, lw=1.0, ls=style, label=label)
        axes.plot([], [], color=VERMILION, label="transition δ [-] (right)")
        share.plot(table["time"], table["transition"], color=VERMILION)
        share.spines["right"].set_visible(True)
        share.set(ylabel="transition δ [-]", ylim=(0.0, 1.1))
        axes.set(xlabel="time [s]", ylabel="piston z [mm]", xlim=(0.0, 2.0), ylim=(0.0, 2.2))
        explain(canvas, axes)

    jump = float(table["transition"].diff().abs().max())
    claims = (
        UNMEASURED,
        Claim(
            "The transition from oil shear to friction is smooth.",
            "no number",
            f"largest step of the transition between rows 2 ms apart: {jump:.3f}",
            Verdict.of(jump < 0.1),
            "3 s^2 - 2 s^3 of the way from contact to full contact is ours: the paper gives none",
        ),
    )
    return Reproduction({"": table}, draw, claims, SIZE)


def torque(context: Context) -> Reproduction:
    """Fig. 11a: torques of the input shaft, the clutch and the output shaft."""
    study = context.clutch
    course = study.course()
    columns = ["time", "input_torque", "clutch_torque", "output_torque"]
    table = course[[*columns, "synchronous"]]
    sync = _time_of_sync(course)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        names = ("input shaft T₁", "clutch T_c", "output shaft T₂ = R T_c")
        styles = zip(columns[1:], names, (BLUE, VERMILION, GREEN), ("-", "-", DASHES), strict=True)
        for column, name, hue, style in styles:
            axes.plot(table["time"], table[column], color=hue, ls=style, label=name)
        axes.axvline(sync, color=BLACK, lw=1.0, ls=DOTS, label="equal speeds")
        axes.set(xlabel="time [s]", ylabel="torque [N m]", xlim=(0.0, 2.0))
        axes.set_ylim(bottom=0.0)
        explain(canvas, axes)

    early = float(course.loc[course["time"] < _time_of_contact(course), "clutch_torque"].max())
    before, after = np.array([_torques_at_sync(c) for c in study.courses(STEP)]).T
    fall, shown = before - after, float(np.subtract(*_torques_at_sync(course)))
    claims = (
        UNMEASURED,
        Claim(
            "Shear of the oil transmits a first torque before the plates touch.",
            "no number",
            f"up to {early:.1f} N m before contact",
            Verdict.of(early > 0.0),
        ),
        Claim(
            "At synchronous speed the torque of the clutch by slip drops away.",
            "no number",
            f"falls by {np.median(fall):.0f} N m from {np.median(before):.0f} N m in the median of "
            f"{fall.size} experiments, by more than 1 N m in {np.mean(fall > 1.0):.0%}; experiment "
            f"{SHOWN}: {shown:.1f} N m",
            Verdict.of(bool(np.mean(fall > 1.0) > 0.9)),
            f"judged at nine of ten, x = (1, 1), every {STEP}th experiment",
        ),
    )
    return Reproduction({"": table}, draw, claims, SIZE)


def speed(context: Context) -> Reproduction:
    """Fig. 11b: the speeds of both shafts, and the shifting time."""
    study = context.clutch
    course, measured = study.course(), float(study.outcomes[SHOWN - 1])
    ratio = CLUTCH.shafts.ratio
    table = pd.DataFrame(
        {
            "time": course["time"],
            "input_speed": course["input_speed"],
            "ratio_times_output_speed": ratio * course["output_speed"],
            "output_speed": course["output_speed"],
            "synchronous": course["synchronous"],
        }
    )
    sync = _time_of_sync(course)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.plot(table["time"], table["input_speed"], color=BLUE, label="input ω₁")
        name = "R times output, R ω₂"
        axes.plot(table["time"], table["ratio_times_output_speed"], color=VERMILION, label=name)
        axes.plot(table["time"], table["output_speed"], color=GREEN, ls=DASHES, label="output ω₂")
        axes.axvline(sync, color=BLACK, lw=1.0, ls=DOTS, label="simulated shifting time")
        axes.axvline(measured, color=BLACK, lw=1.0, label="measured (synthetic)")
        axes.set(xlabel="time [s]", ylabel="speed [rad/s]", xlim=(0.0, 2.0))
        axes.set_ylim(bottom=0.0)
        explain(canvas, axes)

    start = float(course["input_speed"].iloc[0])
    end = float(course.loc[course["synchronous"], "input_speed"].iloc[0])
    claims = (
        Claim(
            "Simulated and measured shifting time differ distinctly.",
            "shown, no number",
            f"experiment {SHOWN} at x = (1, 1): simulated {sync:.3f} s, measured {measured:.3f} s",
            Verdict.of(abs(sync - measured) > 0.01),
            "the measurement is synthetic; told apart at 10 ms",
        ),
        Claim(
            "The common speed need not be the initial input speed.",
            "no number",
            f"{end:.0f} rad/s at equal speeds, {start:.0f} rad/s at the start",
            Verdict.of(abs(end - start) > 1.0),
        ),
    )
    return Reproduction({"": table}, draw, claims, SIZE)


def _name_parameters(axes: Axes, row: pd.Series[float]) -> None:
    """Arrows for the three control parameters."""
    high, hold = CLUTCH.current.high, float(row["hold_current"])
    end, peak = float(row["pulse_duration"]), hold + float(row["pulse_current"])
    second = end + CLUTCH.current.hold_end
    arrow = {"arrowstyle": "<->", "color": BLACK, "lw": 0.9, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate("", (0.0, high + 0.03), (end, high + 0.03), arrowprops=arrow)
    axes.annotate("Δt", (0.5 * end, high + 0.045), ha="center")
    axes.annotate("", (end + 0.14, 0.0), (end + 0.14, hold), arrowprops=arrow)
    axes.annotate("u₀", (end + 0.155, 0.5 * hold), va="center")
    axes.annotate("", (second + 0.05, hold), (second + 0.05, peak), arrowprops=arrow)
    axes.plot([second, second + 0.16], [hold, hold], color=GRAY, lw=0.8, ls=DOTS)
    axes.annotate("Δu", (second + 0.062, 0.5 * (hold + peak)), va="center")


def _time_of_contact(course: pd.DataFrame) -> float:
    """First time [s] at which the piston is at the plates."""
    z = course["piston"].to_numpy()
    k = int(np.argmax(z >= CLUTCH.plates.z_contact))
    t = course["time"].to_numpy()
    return float(np.interp(CLUTCH.plates.z_contact, z[k - 1 : k + 1], t[k - 1 : k + 1]))


def _contact_speed(course: pd.DataFrame) -> float:
    """Speed [m/s] of the piston as it first reaches the plates."""
    z, t = course["piston"].to_numpy(), course["time"].to_numpy()
    k = int(np.argmax(z >= CLUTCH.plates.z_contact))
    return float((z[k] - z[k - 1]) / (t[k] - t[k - 1]))


def _time_of_sync(course: pd.DataFrame) -> float:
    return float(course.loc[course["synchronous"], "time"].iloc[0])


def _torques_at_sync(course: pd.DataFrame) -> tuple[float, float]:
    """Clutch torque [N m] just before and just after equal speeds."""
    torque, late = course["clutch_torque"], course["synchronous"]
    return float(torque[~late].iloc[-1]), float(torque[late].iloc[0])
