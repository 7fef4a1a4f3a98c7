"""A little of `python -m hardening`, and that it would notice what it looks for."""

import tomllib
from pathlib import Path

import pytest

from hardening import judging
from hardening.damaged import KINDS, damaged
from hardening.failing import failing
from hardening.formulas import READERS, WRITTEN, formulas
from hardening.judging import DONE, REFUSED, TRACEBACK
from hardening.kills import Way, kills
from hardening.sound import STUDIES, as_toml, prepared


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hardening") / "sound"
    prepared(folder)
    return folder


@pytest.mark.long
def test_damaged_files_are_told_or_do_not_matter(sound: Path, tmp_path: Path) -> None:
    found = [judging.one(k, 1, sound, tmp_path / "study") for k in range(len(KINDS))]
    broken = [(one.number, one.words) for one in found if one.outcome in judging.BROKEN]
    assert broken == []
    assert {one.kind for one in found} == set(KINDS)
    assert {one.outcome for one in found} == {judging.DONE, judging.REFUSED}


@pytest.mark.long
def test_the_same_number_is_the_same_damage(sound: Path, tmp_path: Path) -> None:
    for number in range(2 * len(KINDS)):
        same = [damaged(number, 0, sound, tmp_path / f"{number}{k}") for k in "ab"]
        assert same[0] == same[1]
        if same[0][0] == "store":
            continue
        first, second = (tmp_path / f"{number}{k}" for k in "ab")
        for file in first.rglob("*.toml"):
            assert file.read_bytes() == (second / file.relative_to(first)).read_bytes()


def test_a_traceback_is_noticed(
    sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise KeyError("a defect")

    monkeypatch.setattr("aleator.cli.predict.read_answer", broken)
    verdict = judging.one(KINDS.index("result, predict"), 0, sound, tmp_path / "study")
    assert verdict.outcome == judging.TRACEBACK
    assert "a defect" in verdict.words


@pytest.mark.parametrize("name", STUDIES)
def test_a_tree_is_written_as_it_is(name: str) -> None:
    assert tomllib.loads(as_toml(STUDIES[name].study)) == STUDIES[name].study


def test_hostile_formulas_are_read_or_told() -> None:
    found = formulas(range(60), 5)
    assert found.broken == ()
    assert sum(found.counts[name, DONE] for name in READERS) > 5
    assert sum(found.counts[name, REFUSED] for name in READERS) > 50


def test_a_formula_that_runs_raises_or_lasts_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(text: str) -> None:
        if len(text) % 2:
            Path("X").touch()
        elif len(text) > 4:
            raise KeyError("a defect")

    monkeypatch.setitem(READERS, "formulas of covariates", broken)
    told = " ".join(formulas(range(30), 5).broken)
    assert WRITTEN in told
    assert TRACEBACK in told


@pytest.mark.slow
@pytest.mark.long
def test_kills_lose_nothing_and_leave_nothing() -> None:
    options = ("--workers", "2")
    way = Way("box", options, program=True, command=("box", "study.toml"), result="box.json")
    found = kills(1, 3, ways=[way])
    assert found.broken == ()
    assert found.counts == {"box": 1}
    assert found.runs > 0


def test_failures_move_alpha_by_less_than_a_hundredth_of_its_error() -> None:
    found = failing(1, 0)
    assert found.error == ""
    assert found.failed > 0
    assert found.sound
