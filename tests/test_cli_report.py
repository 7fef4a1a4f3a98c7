"""`aleator report`: the page of a folder of results, anew and without runs."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from aleator import Check, Free, Inputs, Noise, Normal, cli, identify
from aleator.tasks.identification import pictured

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an identification of eight experiments."""
    import pandas as pd

    table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0, 4.0]})
    table["way"] = table["load"] * [1.1, 0.9, 1.2, 1.0, 0.8, 1.3, 0.7, 1.0]
    found = identify(
        lambda load, x: load * x, table, Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.5))}),
        outcome="way", noise=Noise(0.1), vectorized=True, verification=Check(0),
        consistency=False, best_law=False,
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("results")
    pictured(found).save(folder / "identification.json")
    return folder


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(one) for one in arguments])


def test_it_writes_the_page_that_python_writes(written: Path) -> None:
    result = run("report", written)
    assert result.exit_code == 0, result.output
    text = (written / "report.html").read_text(encoding="utf-8")
    assert str(Path("report.html")) in result.output
    from aleator import load

    assert load(written / "identification.json").report().text == text


def test_a_ceiling_of_the_same_study_is_shown_and_of_another_not(
    written: Path, tmp_path: Path
) -> None:
    document = json.loads((written / "identification.json").read_text(encoding="utf-8"))
    document["study"] = {"file": "gone.toml", "sha256": "one", "outcome": "way"}
    (tmp_path / "identification.json").write_text(json.dumps(document), encoding="utf-8")
    for sha256, shown in (("one", True), ("another", False)):
        ceiling = {"study": {"sha256": sha256}, "points": [{"x": 1.0, "probability": 1.0}]}
        (tmp_path / "ceiling.json").write_text(json.dumps(ceiling), encoding="utf-8")
        assert run("report", tmp_path).exit_code == 0
        text = (tmp_path / "report.html").read_text(encoding="utf-8")
        assert ("mass-x" in text) == shown
        assert "gone.toml" in text


def test_two_stand_side_by_side(written: Path, tmp_path: Path) -> None:
    document = json.loads((written / "identification.json").read_text(encoding="utf-8"))
    document["alpha"]["x.mean"]["estimate"] = 77.5
    (tmp_path / "identification.json").write_text(json.dumps(document), encoding="utf-8")
    assert run("report", written, "--compare", tmp_path).exit_code == 0
    text = (written / "compared.html").read_text(encoding="utf-8")
    assert text.count("Computed soundly") == 2
    row = text[text.index("<td>x.mean</td>") :].partition("</tr>")[0]
    assert "77.5" in row
    assert "Both saw the same outcomes." in text
    document["observations"][0]["lower"] += 1.0
    (tmp_path / "identification.json").write_text(json.dumps(document), encoding="utf-8")
    assert run("report", written, "--compare", tmp_path).exit_code == 0
    text = (written / "compared.html").read_text(encoding="utf-8")
    assert "cannot be compared" in text
    assert run("report", written, "--compare", written).exit_code == 2


def test_a_folder_without_an_identification_is_told(tmp_path: Path) -> None:
    result = run("report", tmp_path)
    assert result.exit_code == 2
    assert "identification.json" in result.output
    (tmp_path / "identification.json").write_text(
        '{"alpha": 3, "log_likelihood": {}, "experiments": []}', encoding="utf-8"
    )
    result = run("report", tmp_path)
    assert result.exit_code == 2
    assert "alpha" in result.output


def test_pictures_that_are_none_are_told(written: Path, tmp_path: Path) -> None:
    document = json.loads((written / "identification.json").read_text(encoding="utf-8"))
    document["pictures"]["laws"] = {"x": [1.0]}
    (tmp_path / "identification.json").write_text(json.dumps(document), encoding="utf-8")
    result = run("report", tmp_path)
    assert result.exit_code == 2
    assert "'pictures'" in result.output


def test_without_bokeh_it_says_what_it_needs(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from aleator import AleatorError, load
    from aleator.cli.running import can_report

    monkeypatch.delitem(sys.modules, "aleator.views.interactive", raising=False)
    for name in [name for name in sys.modules if name.partition(".")[0] == "bokeh"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Without("bokeh"), *sys.meta_path])
    result = run("report", written)
    assert result.exit_code == 2
    assert "bokeh>=" in result.output
    assert not can_report(quiet=True)
    with pytest.raises(AleatorError, match="bokeh"):
        load(written / "identification.json").report()


class Without:
    """An import system in which a package is not installed."""

    def __init__(self, package: str) -> None:
        self.package = package

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:  # noqa: ARG002
        if name.partition(".")[0] == self.package:
            raise ModuleNotFoundError(f"No module named '{name}'", name=self.package)


@pytest.mark.parametrize(
    ("damage", "key"),
    [
        (lambda d: d["pictures"]["predicted"].pop("0.025"), "pictures.predicted"),
        (lambda d: next(iter(d["pictures"]["profiles"].values()))["at"].pop(), "profiles"),
        (lambda d: next(iter(d["pictures"]["laws"].values()))["density"].pop(), "laws"),
        (lambda d: d["pictures"]["surface"]["below"].pop(), "pictures.surface"),
        (lambda d: d["experiments"][0].update(log_density=10**400), "log_density"),
        (lambda d: d.pop("sound"), "sound"),
    ],
)
def test_a_damaged_result_is_one_message_for_all_its_readers(
    written: Path, tmp_path: Path, damage: Any, key: str
) -> None:
    from aleator import AleatorError, load

    document = json.loads((written / "identification.json").read_text(encoding="utf-8"))
    damage(document)
    (tmp_path / "identification.json").write_text(json.dumps(document), encoding="utf-8")
    result = run("report", tmp_path)
    assert result.exit_code == 2
    assert key in result.output
    assert "Remedy" in result.output
    assert run("report", written, "--compare", tmp_path).exit_code == 2
    with pytest.raises(AleatorError, match=key):
        load(tmp_path / "identification.json")
