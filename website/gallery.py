"""`make gallery`: draw the figures of docs/gallery.md and hold the numbers of its examples.

Each example is identified, unless its answer is in out/gallery; figures go to docs/images/gallery.
A table of estimates in an example's README.md has to be that of the answer. Some examples need a
simulator of their own, which their README.md names: where it is not installed, and where a number
differs, a line says so, and the command ends with 1.
"""

import json
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

import aleator.plot as plot

ROOT = Path(__file__).parents[1]
ANSWERS = ROOT / "out" / "gallery"
FIGURES = ROOT / "docs" / "images" / "gallery"

# A study, the parameter whose law is drawn beside measured and predicted values, and the response
# of which these are, if there are several.
SHOWN: dict[str, tuple[str, str, str | None]] = {
    "wet_clutch": ("wet_clutch/study.toml", "c2_scale", None),
    "fatigue_limit": ("fatigue_limit/study.toml", "v", None),
    "run_outs": ("run_outs/study.toml", "v", None),
    "crack_growth": ("crack_growth/study.toml", "rate", None),
    "fission_gas": ("fission_gas/study.toml", "crack", None),
    "sleep_study": ("sleep_study/correlated.toml", "slope", None),
    "springs": ("command_springs/study.toml", "stiffness", None),
    "wear": ("repeated/wear/study.toml", "rate", None),
    "coasting": ("repeated/coasting/study.toml", "drag", "way"),
    "braking": ("braking/road.toml", "friction", None),
    "battery": ("../src/aleator/cli/battery/study.toml", "fade", None),
    "servo_drive": ("servo_drive/study.toml", "backlash", None),
    "discharge": ("discharge/study.toml", "contact", None),
    "ignition": ("ignition/study.toml", "off", None),
    "hydrants": ("hydrants/study.toml", "demand", "at_hydrant"),
    "portal_frame": ("portal_frame/study.toml", "base", None),
    "ring_down": ("ring_down/study.toml", "damping", None),
    "filter": ("filter/study.toml", "capacitor", None),
}
NUMBER = r"(-?\d+(?:\.\d+)?)"
ROW = re.compile(
    rf"^\| `([^`]+)`[^|]*\|[^|]*\| {NUMBER} \| {NUMBER} \| \[{NUMBER}, {NUMBER}\] \|$", re.MULTILINE
)
"""A row of a table: name and unit, truth, estimate, standard error, and interval."""
ERROR = 0.2
"""Standard errors that an emulator may move estimates by; it does where stored runs serve it."""


def answer(name: str, study: str) -> dict[str, Any]:
    """The content of identification.json, computed if it is not there."""
    folder = ANSWERS / name
    file = folder / "identification.json"
    if not file.exists():
        wanted = ["identify", f"examples/{study}", "--output", str(folder)]
        subprocess.run([sys.executable, "-m", "aleator", *wanted], cwd=ROOT, check=True)
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return found


def draw(name: str, found: Mapping[str, Any], parameter: str, response: str | None) -> Path:
    """Measured and predicted values on the left, the law of a parameter on the right."""
    figure = Figure(figsize=(9.0, 2.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2, 1))
    plot.experiments(found, ax=left, response=response)
    plot.law(found, parameter, ax=right)
    FIGURES.mkdir(parents=True, exist_ok=True)
    figure.savefig(FIGURES / f"{name}.png", dpi=80)
    return FIGURES / f"{name}.png"


def differences(page: str, alpha: Mapping[str, Any]) -> Iterator[str]:
    """What a page's table says otherwise than the answer.

    Admitted are a unit of its last digit, and `ERROR` standard errors.
    """
    for name, *written in ROW.findall(page):
        row = alpha[name]
        admitted = ERROR * row["standard_error"]
        for text, value in zip(
            written, (row["estimate"], row["standard_error"], *row["interval"]), strict=True
        ):
            if abs(float(text) - value) > max(10.0 ** -len(text.partition(".")[2]), admitted):
                yield f"{name}: {text} in the table, {value:.6g} in the answer"


def main() -> None:
    """Draw every figure, or those that are named."""
    failures = []
    for name in sys.argv[1:] or SHOWN:
        study, parameter, response = SHOWN[name]
        try:
            found = answer(name, study)
        except subprocess.CalledProcessError as error:
            failures.append(f"{name}: not identified (exit code {error.returncode})")
            continue
        print(draw(name, found, parameter, response).relative_to(ROOT))
        page = ROOT / "examples" / name / "README.md"
        if page.exists():
            text = page.read_text(encoding="utf-8")
            failures += [
                f"{page.relative_to(ROOT)}: {line}" for line in differences(text, found["alpha"])
            ]
    sys.exit("\n".join(failures) or None)


if __name__ == "__main__":
    main()
