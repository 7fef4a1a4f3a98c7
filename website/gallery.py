"""Draw the figures of docs/gallery.md: each example is identified, unless its answer is there.

`make gallery` writes answers into out/gallery and figures into docs/images/gallery.
"""

import json
import subprocess
import sys
from pathlib import Path

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
}


def answer(name: str, study: str) -> dict[str, object]:
    """The content of identification.json, computed if it is not there."""
    folder = ANSWERS / name
    file = folder / "identification.json"
    if not file.exists():
        wanted = ["identify", f"examples/{study}", "--output", str(folder)]
        subprocess.run([sys.executable, "-m", "aleator", *wanted], cwd=ROOT, check=True)
    found: dict[str, object] = json.loads(file.read_text(encoding="utf-8"))
    return found


def draw(name: str, study: str, parameter: str, response: str | None) -> Path:
    """Measured and predicted values on the left, the law of a parameter on the right."""
    found = answer(name, study)
    figure = Figure(figsize=(9.0, 2.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2, 1))
    plot.experiments(found, ax=left, response=response)
    plot.law(found, parameter, ax=right)
    FIGURES.mkdir(parents=True, exist_ok=True)
    figure.savefig(FIGURES / f"{name}.png", dpi=80)
    return FIGURES / f"{name}.png"


def main() -> None:
    """Draw every figure, or those that are named."""
    for name in sys.argv[1:] or SHOWN:
        print(draw(name, *SHOWN[name]).relative_to(ROOT))


if __name__ == "__main__":
    main()
