"""What a reproduction writes, also where it is interrupted or cannot draw."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner

from reproduction.__main__ import main
from reproduction.context import Context
from reproduction.figure import Claim, Figure, Reproduction, Verdict
from reproduction.figures import FIGURES
from reproduction.output import reproduce

CLAIM = Claim("Two is more than one.", "1", "2 | exactly", Verdict.HOLDS, "by counting")


def line(_: Context) -> Reproduction:
    table = pd.DataFrame({"x": [0.0, 1.0], "y": [0.0, 2.0]})

    def draw(canvas) -> None:
        canvas.subplots().plot(table["x"], table["y"])

    return Reproduction({"": table, "more": table}, draw, (CLAIM,))


def stopped(_: Context) -> Reproduction:
    raise KeyboardInterrupt


LINE = Figure("line", "A line", "Fig. 0", line)


def test_each_figure_has_its_tables_its_drawings_and_its_claims(tmp_path: Path) -> None:
    (made,) = reproduce([LINE], Context(), tmp_path)
    expected = {"line.csv", "line-more.csv", "line.png", "line.svg", "claims.csv", "index.md"}
    assert {path.name for path in tmp_path.iterdir()} == expected
    assert set(made.files) == expected - {"claims.csv", "index.md"}
    assert (tmp_path / "line.csv").read_text() == "x,y\n0,0\n1,2\n"
    claims = pd.read_csv(tmp_path / "claims.csv", keep_default_na=False, dtype=str)
    assert claims.loc[0, ["figure", "paper", "ours", "verdict"]].tolist() == [
        "line", "1", "2 | exactly", "holds",
    ]  # fmt: skip


def test_what_is_done_is_kept_when_ctrl_c_comes(tmp_path: Path) -> None:
    figures = [LINE, Figure("stopped", "Stopped", "Fig. 1", stopped)]
    with pytest.raises(KeyboardInterrupt):
        reproduce(figures, Context(), tmp_path)
    assert (tmp_path / "line.csv").exists()
    assert len(pd.read_csv(tmp_path / "claims.csv")) == 1


def test_without_matplotlib_there_are_tables_and_claims(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "matplotlib" else found(name)
    )
    reproduce([LINE], Context(), tmp_path)
    assert (tmp_path / "line.csv").exists()
    assert not (tmp_path / "line.png").exists()


def test_the_command_writes_and_prints_the_claims(tmp_path: Path) -> None:
    command = ["clutch-feedforward", "--output", str(tmp_path / "out")]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 0, done.output
    assert "2 claims: 2 hold" in done.stdout
    assert (tmp_path / "out" / "clutch-feedforward.svg").exists()
    quiet = CliRunner().invoke(main, [*command, "--quiet"])
    assert (quiet.exit_code, quiet.output) == (0, "")


def test_every_figure_is_in_the_help_and_in_the_documents() -> None:
    shown = CliRunner().invoke(main, ["--help"]).output
    document = (Path(__file__).parents[2] / "docs" / "paper.md").read_text(encoding="utf-8")
    for figure in FIGURES:
        assert f"  {figure.name} " in shown
        assert figure.name in document
