"""The report of the best possible law says what its document holds."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Console

from aleator.report.ceiling import render, verdict


def document(points: int = 3, p_value: float | None = 0.01, **more: Any) -> dict[str, Any]:
    test = {"p_value": p_value, "replicates": 99, "exceeded": 0, "failed": 0}
    return {
        "log_likelihood": {
            "ceiling": 12.5, "error": 2e-5, "verified": None, "estimated": 3.25, "gap": 9.25,
        },
        "bootstrap": None if p_value is None else test,
        "points": [{"probability": (k + 1) / 10, "x": 1000.0 + k} for k in range(points)],
        "gains": [{"id": f"e{k}", "gain": float(k)} for k in range(8)],
        "region": {"x": [900.0, 1100.0]},
        "held": {},
        "covered": True,
        "edges": [],
    } | more  # fmt: skip


def shown(found: dict[str, Any]) -> str:
    text = io.StringIO()
    Console(width=100, file=text).print(render(found))
    return " ".join(text.getvalue().split())


def test_a_gap_that_is_rare_names_the_experiments_that_gain_most() -> None:
    text = shown(document())
    assert "p = 0.01" in text
    assert "e7 (+7.0), e6 (+6.0)" in text
    assert "e1" not in text
    assert "p = 0.01" in verdict(document())


def test_a_gap_by_chance_names_none_and_one_that_is_not_judged_says_so() -> None:
    assert "e7" not in shown(document(p_value=0.4))
    assert "replicates" in shown(document(p_value=None))
    assert "p =" not in verdict(document(p_value=None))


def test_of_many_points_the_likeliest_are_shown_and_the_others_counted() -> None:
    text = shown(document(points=20))
    assert "1019" in text
    assert "1000" not in text
    assert "8 more" in text
    assert "more in" not in shown(document(points=12))


def test_what_the_value_stands_on_is_told() -> None:
    plain = shown(document())
    for more, words in (
        ({"held": {"b.value": 2.0}}, "b.value 2"),
        ({"held": {"noise.sd": 0.5}}, "no limit"),
        ({"edges": ["x"]}, "900 to 1100"),
        ({"covered": False}, "at least"),
    ):
        assert words in shown(document(**more))
        assert words not in plain
