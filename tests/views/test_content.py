"""What a report says: the numbers of its document, whole and within the width, by every writer."""

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reports import experiment, printed, result
from rich.console import RenderableType
from scipy import stats

from aleator.results.answer import answer, brief
from aleator.results.printed import (
    Column,
    Content,
    Sentence,
    fragment,
    laid_out,
    text,
    verdict_head,
)
from aleator.simulators import Identity
from aleator.simulators.records import SimulatorRuns, StoredRun
from aleator.tasks.box import FeasibleBox, Side
from aleator.tasks.documents import box_document, recovery_document
from aleator.tasks.recover import Recovery
from aleator.views import models, planning, predictions, runs, uncertainty
from aleator.views.identification import render
from aleator.views.measured import measured
from aleator.views.notebook import first_screen
from aleator.views.outcome_charts import predicted_chart
from aleator.views.page import page
from aleator.views.terminal import terminal

LONG = "correlation.friction_coefficient.stiffness"
BENCH = "engagement_2021-03-14_bench_B"


def words(of: str) -> str:
    return " ".join(of.split())


# ------------------------------------------------------------------------------------ numbers


def test_numbers_of_the_report_are_those_of_the_document() -> None:
    shown = words(printed(render(result(), ["out/identification.json"])))
    for number in ("262.512", "262.400 +- 0.13", "201.000", "230.500", "0.03", "118,642", "-0.950",
                   "10.2", "107 of 108", "2.3 %", "out/identification.json"):  # fmt: skip
        assert number in shown, number
    lines = printed(render(result())).splitlines()
    row = next(line.split() for line in lines if "c2_scale.mean" in line)
    assert row[:6] == ["c2_scale.mean", "0.912", "0.012", "0.888", "..", "0.937"]


def test_every_writer_has_the_same_estimates_warnings_and_verdicts() -> None:
    content = answer(result())
    writers = (text(content), fragment(content), printed(render(result())))
    for part in ("c2_scale.mean", "0.888 .. 0.937", "c2_scale.sd is on its bound", "lower it",
                 "262.512", "Computed soundly"):  # fmt: skip
        assert all(part in words(written) for written in writers), part


def test_a_model_that_is_not_consistent_is_told_with_remedies_and_outliers() -> None:
    test = {"kind": "contrast", "of": "outcomes", "column": "hot", "where": None, "z": -6.2,
            "p": 3e-9, "corrected": 4e-8}  # fmt: skip
    against = {"test": test, "message": "outcomes under high `hot` are smaller", "remedy": "mend"}
    second = {
        "p": 4e-8, "replicates": 40, "discrepancies": [against], "tests": [test], "reason": "",
        "outliers": [{"id": "7", "row": 8, "response": "y", "p": 1e-5, "corrected": 0.001}],
    }  # fmt: skip
    content = answer(result(consistent=False, consistency=second))
    assert [verdict.kind for verdict in content.verdicts] == ["open", "bad"]
    for part in ("outcomes under high 'hot' are smaller (p = 4e-08)", "mend", "7 (p = 1e-05)"):
        assert part in words(text(content))


def test_a_covariate_that_may_be_missing_is_told_beside_the_verdict_by_every_writer() -> None:
    test = {"kind": "relation", "of": "fast", "column": "moisture", "where": None, "z": 2.6,
            "p": 0.012, "corrected": 0.56}  # fmt: skip
    hint = {"test": test | {"corrected": 0.024}, "message": "fast is larger", "remedy": "let it"}
    second = {"p": 0.15, "replicates": 200, "discrepancies": [], "tests": [test], "reason": "",
              "outliers": [], "covariate": hint}  # fmt: skip
    content = answer(told := result(consistent=True, consistency=second))
    assert [verdict.kind for verdict in content.verdicts] == ["open", "good", "open"]
    for number in ("0.012", "0.024", "0.56"):
        assert number in content.verdicts[2].text
    head = verdict_head(content.verdicts[2]).rstrip(".")
    assert "fast" in head
    assert "moisture" in head
    for written in (text(content), first_screen(told), page(told), text(brief(told))):
        assert head in words(written)


def test_laws_that_are_left_open_are_in_the_first_words_of_every_writer() -> None:
    open_ = result(undetermined=("c2_scale.mean",))
    content = answer(open_)
    assert content.verdicts[0].kind == "open"
    head = verdict_head(content.verdicts[0]).rstrip(".")
    assert "c2_scale" in head
    for written in (text(content), first_screen(open_), page(open_), text(brief(open_))):
        assert head in words(written)


def test_estimates_on_a_limit_are_in_the_first_words() -> None:
    sd = {"estimate": 0.02, "standard_error": 0.004, "interval": [0.01, 0.03]}
    inside = result(alpha={"k.sd": sd})
    assert answer(inside).verdicts[0].kind == "good"
    for side, changed in (("lower", {"at_bound": "lower"}), ("upper", {"at_bound": "upper"})):
        first = answer(result(alpha={"k.sd": sd | changed, "k.mean": sd})).verdicts[0]
        assert first.kind == "open"
        assert f"k.sd ends on its {side} limit" in verdict_head(first)
    # Of a scale whose interval, but not its estimate, reaches its lower limit, no law is left open.
    assert answer(result(alpha={"k.sd": sd | {"cut": "lower"}})).verdicts[0].kind == "good"


def test_the_least_document_can_be_rendered() -> None:
    least = {
        "alpha": {"x.mean": {"estimate": 1.0}},
        "log_likelihood": {"estimated": None},
        "experiments": [],
    }
    assert "1 hyperparameter identified from 0 experiments" in printed(render(least))


# ------------------------------------------------------------------------------------ other answers


def ceiling(points: int = 3, p_value: float | None = 0.01) -> dict[str, Any]:
    test = {"p_value": p_value, "replicates": 99, "exceeded": 0, "failed": 0}
    return {
        "log_likelihood": {
            "ceiling": 12.5, "error": 2e-5, "verified": None, "estimated": 3.25, "gap": 9.25,
        },
        "bootstrap": None if p_value is None else test,
        "points": [{"probability": (k + 1) / 10, "x": 1000.0 + k} for k in range(points)],
        "gains": [{"id": f"e{k}", "gain": float(k)} for k in range(8)],
        "region": {"x": [900.0, 1100.0]},
        "held": {}, "covered": True, "edges": [],
    }  # fmt: skip


def test_the_gap_to_the_best_law_is_judged_by_its_p_value() -> None:
    rare, chance, open_ = (text(models.ceiling(ceiling(p_value=p))) for p in (0.01, 0.4, None))
    assert "e7 (+7.0), e6 (+6.0)" in words(rare)
    assert "e7" not in chance
    assert "p =" not in open_


# ------------------------------------------------------------------------------------ beyond 95 %


def test_the_range_of_the_count_holds_though_observations_of_one_experiment_depend() -> None:
    rng, inside = np.random.default_rng(4), 0
    for _ in range(200):
        a, e = rng.standard_normal((30, 1)), 0.2 * rng.standard_normal((30, 10))
        y, mean, variance = a + e, np.zeros(30), np.ones(30)
        w = np.empty_like(y)
        for k in range(10):
            total = variance + 0.04
            w[:, k] = (y[:, k] - mean) / np.sqrt(total)
            gain = variance / total
            mean, variance = mean + gain * (y[:, k] - mean), variance * (1.0 - gain)
        end = 1.96 * np.sqrt(1.04)
        quantiles = {"0.025": -end, "0.25": -0.7, "0.5": 0.0, "0.75": 0.7, "0.975": end}
        rows = [
            experiment(str(k), p, outcome=v, quantiles=quantiles)
            for k, (v, p) in enumerate(zip(y.ravel(), stats.norm.cdf(w.ravel()), strict=True))
        ]
        (seen,) = measured({"experiments": rows})
        caption = predicted_chart(seen, seen.series()).caption.split("(diamonds)")[1]
        beyond, _, low, high = map(int, re.findall(r"\d+", caption)[:4])
        inside += low <= beyond <= high
    assert inside >= 180


def test_the_report_counts_values_given_the_earlier_ones_of_their_experiment() -> None:
    pit = [0.01, 0.5, 0.99, 0.6, 0.3, 0.7] * 20
    rows = [
        {
            "id": "1", "row": k + 1, "response": "y", "lower": 1.0, "upper": 1.0, "predicted": 1.0,
            "scale": 0.1, "residual": 0.0, "conditions": {}, "pit": p,
        }
        for k, p in enumerate(pit)
    ]  # fmt: skip
    one = {"id": "1", "mean": {}, "sd": {}}
    document = result(
        observations=rows, responses={"y": "none"}, experiments=[one], shrinkage={},
        propagation="direct",
    )  # fmt: skip
    found = re.findall(r"(\d+) of (\d+) are, and (\d+) to (\d+)", words(printed(render(document))))
    low, high = stats.binom.ppf([0.025, 0.975], 120, 0.05).astype(int)
    assert [tuple(map(int, row)) for row in found] == [(40, 120, low, high)]


def test_without_earlier_values_the_report_does_not_speak_of_them() -> None:
    rows = [
        {
            "id": str(k), "row": k + 1, "response": "y", "lower": 1.0, "upper": 1.0,
            "predicted": 1.0, "scale": 0.1, "residual": 0.0, "conditions": {}, "pit": 0.5,
        }
        for k in range(40)
    ]  # fmt: skip
    own = [{"id": row["id"], "mean": {}, "sd": {}} for row in rows]
    document = result(
        observations=rows, responses={"y": "none"}, experiments=own, shrinkage={},
        propagation="direct",
    )  # fmt: skip
    shown = words(printed(render(document)))
    assert "0 of 40 are" in shown
    assert "earlier" not in shown


# ------------------------------------------------------------------------------------ width


def identified() -> RenderableType:
    document = result()
    some = document["alpha"]["c2_scale.mean"]
    large = {"estimate": 123456.7, "standard_error": 1234.5, "interval": [121000.12, 125000.7]}
    document["alpha"] |= {LONG: some, "modulus.mean": {**some, **large}}
    lost = {"status": "not_realizable", "outcome": -123456.7, "log_density": None}
    document["experiments"].append(experiment(BENCH, None, **lost))
    return render(document)


def predicted() -> RenderableType:
    columns = {
        "bench": [BENCH, "2"], "load": [1.0, 2.5], "outcome": ["time", "time"],
        "mean": [123456.7, 1.2], "standard_deviation": [1234.5, 0.1],
        "q0.025": [1.0, -1.2345e-7], "q0.5": [-123456.2, 1.2],
        "q0.975": [123456.4, 1.4], "status": ["solved", "not_realizable"],
    }  # fmt: skip
    return terminal(predictions.distributions(columns, "time"))


def recovered() -> RenderableType:
    truth = np.array([0.5, 123456.7])
    alpha = truth * (1.3 + 0.01 * np.random.default_rng(0).standard_normal((40, 2)))
    ends = np.stack([alpha - 0.05, alpha + 0.05], axis=-1)
    found = Recovery((LONG, "x.sd"), truth, alpha, ends, np.zeros(40), np.ones(40, dtype=bool))
    return terminal(uncertainty.recovery(recovery_document(found)))


def boxed() -> RenderableType:
    names, limits = ("friction_coefficient", "stiffness"), np.array([[0.1, 0.2], [1.0, 2.0]])
    sides = (
        Side(names[0], False, 0.123456, BENCH, np.array([0.1234, 1.5])),
        Side(names[0], True, 0.2, None, None),
    )
    found = FeasibleBox(names, limits, limits, sides, 0.03, 12345, 2345, False, {BENCH: 0.8})
    return terminal(planning.box(box_document(found)))


SIMULATOR = Identity("3f2a91c0" * 8, "shifting_time_of_the_engagement", "model:f", "version 12")
RUN = StoredRun(
    123456, SIMULATOR, {"load": 1.0, "bench": BENCH}, {"friction_coefficient": 0.123456}, None,
    "ValueError: the spring broke at its second coil", None, 0.1, "host", 1.7e9, 1,
)  # fmt: skip
TABLES = {
    "identify": identified(),
    "predict": predicted(),
    "recover": recovered(),
    "box": boxed(),
    "ceiling": terminal(models.ceiling(ceiling())),
    "runs list": runs.holdings(
        [SimulatorRuns(SIMULATOR, 123456, 12, 9.9, 1.7e9, 1.7e9)], "", "a.sqlite"
    ),
    "runs show": runs.runs([RUN], 12),
    "one run": runs.one(RUN),
}


@pytest.mark.parametrize("name", TABLES)
def test_nothing_is_cut_at_80_columns_nor_wider_than_40(name: str) -> None:
    narrow, wide = printed(TABLES[name], 80), printed(TABLES[name], 1000)
    rules = "─"
    assert {w for w in wide.split() if w.strip(rules)} <= {*narrow.split()}
    assert max(map(len, narrow.splitlines())) <= 80
    assert max(map(len, printed(TABLES[name], 40).splitlines())) <= 40


SIDES = st.sampled_from(["left", "right"])
CELLS = st.text("abc ", max_size=30).map(str.strip)


@given(st.lists(SIDES, min_size=1, max_size=4), st.booleans(), st.integers(30, 100), st.data())
def test_whatever_a_table_holds_is_whole_and_fits(
    sides: list[Any], folds: bool, width: int, data: st.DataObject
) -> None:
    columns: list[Column] = [("head", side) for side in sides]
    columns += [("note", "fold")] if folds else []
    rows = data.draw(st.lists(st.tuples(*[CELLS] * len(columns)), min_size=1, max_size=5))
    head, body = laid_out(columns, rows, width)
    assert all(len(line) <= width for line in head + body)
    shown = sorted(word for line in body for word in line.split() if word not in ("head:", "note:"))
    assert shown == sorted(word for row in rows for cell in row for word in cell.split())


# ------------------------------------------------------------------------------------ as it is


def test_it_is_plain_text_without_a_terminal_and_in_ascii_where_only_that_can() -> None:
    assert "\x1b" not in printed(render(result()))
    assert "Wet clutch" in printed(render(result()), encoding="ascii")


def test_text_is_taken_for_no_markup() -> None:
    odd = result(title="[red]x[/nonsense]", experiments=[experiment("[b]1", 0.5)])
    shown = printed(render(odd))
    assert "[red]x[/nonsense]" in shown
    assert "[b]1" in shown
    html = fragment(Content("a < b", warnings=[Sentence("`c` & <d>", "warning", "<e>", "f > g")]))
    assert "<b>a &lt; b</b>" in html
    for part in ("<code>c</code> &amp; &lt;d&gt;", "&lt;e&gt;", "f &gt; g"):
        assert part in html
