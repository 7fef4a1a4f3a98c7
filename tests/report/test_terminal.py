import numpy as np
import pytest
from reports import experiment, printed, result

from aleator.report import recovery, terminal
from aleator.results.printed import with_error
from aleator.tasks.recover import Recovery


def test_the_report_says_what_was_found() -> None:
    text = printed(terminal.render(result(), ["out/identification.json"]))
    for words in (
        "Wet clutch",
        "2 hyperparameters identified from 5 experiments by maximum likelihood",
        "best of 10 starts, seed 4",
        "at its lower bound",
        "fixed",
        "sandwich error 0.03",
        "a and b: -0.950",
        "262.512",
        "+- 0.13, a few runs of the simulator",
        "2 distinct optima: 262.512 (7 starts), 245.900 (3 starts)",
        "107 of 108 converged",
        "worst error 2.3 %",
        "118,642: response surface 10,642, verification 108,000",
        "seconds 10.2 ",
        "Warning, bound: c2_scale.sd is on its bound",
        "Remedy: lower it",
        "Computed soundly",
        "Written: out/identification.json",
    ):
        assert words in " ".join(text.split()), words
    row = next(line.split() for line in text.splitlines() if "c2_scale.mean" in line)
    assert row[:6] == ["c2_scale.mean", "0.912", "0.012", "0.888", "..", "0.937"]


def test_details_are_told_to_who_asks() -> None:
    rows = [
        {"density": "maximum_entropy", "log_likelihood": -0.81, "mean": 0.021, "failed": 0},
        {"density": "gaussian", "log_likelihood": -20.6, "mean": 0.2, "failed": 3},
    ]
    surface = {"converged": 5, "experiments": 5, "worst_error": 0.023}
    found = result(density_distances=rows, surface=surface)
    short, long = (" ".join(printed(terminal.render(found, (), d)).split()) for d in (False, True))
    for words in ("-20.6", "no solution for 3", "5 of 5 converged", "response surface 8.1, search"):
        assert words in long
        assert words not in short
    assert "262.512" in short


def test_both_verdicts_are_told_and_all_tests_to_who_asks() -> None:
    test = {
        "kind": "contrast", "of": "outcomes", "column": "hot", "where": None, "z": -6.2,
        "p": 3e-9, "corrected": 4e-8,
    }  # fmt: skip
    against = {"test": test, "message": "outcomes under high `hot` are smaller", "remedy": "mend"}
    outlier = {"id": "7", "row": 8, "response": "y", "p": 1e-5, "corrected": 0.001}
    found = {
        "p": 4e-8, "replicates": 40, "discrepancies": [against], "outliers": [outlier],
        "tests": [test], "reason": "",
    }  # fmt: skip
    whole = result(consistent=False, consistency=found)
    short, long = (" ".join(printed(terminal.render(whole, (), d)).split()) for d in (False, True))
    assert "Computed soundly" in short
    told = "NOT consistent with the experiments: outcomes under high `hot` are smaller (p = 4e-08)."
    assert told in short
    assert "Remedy: mend." in short
    assert "Outliers: 7 (p = 1e-05)" in short
    assert "contrast" not in short
    assert "contrast outcomes -6.2 3e-09 4e-08 hot" in long


def test_the_three_experiments_explained_worst_are_named_worst_first() -> None:
    text = printed(terminal.render(result()))
    rows = [line.split()[1] for line in text.splitlines() if line.startswith("experiment ")]
    assert rows == ["5", "2", "4"]


@pytest.mark.parametrize("width", [40, 80, 200])
def test_no_line_is_wider_than_the_terminal(width: int) -> None:
    text = printed(terminal.render(result(), ["out/identification.json"]), width)
    assert max(map(len, text.splitlines())) <= width


def test_it_is_plain_text_without_a_terminal() -> None:
    assert "\x1b" not in printed(terminal.render(result()))


def test_it_can_be_printed_where_only_ascii_can() -> None:
    assert "Wet clutch" in printed(terminal.render(result()), encoding="ascii")


def test_text_in_brackets_is_not_taken_for_markup() -> None:
    odd = result(title="[red]x[/nonsense]", experiments=[experiment("[b]1", 0.5)])
    text = printed(terminal.render(odd))
    assert "[red]x[/nonsense]" in text
    assert "[b]1" in text


def test_an_answer_that_is_not_sound_says_so() -> None:
    text = printed(terminal.render(result(sound=False)))
    assert "NOT computed soundly" in text


def test_what_was_not_done_is_not_told() -> None:
    likelihood = {"estimated": 1.0, "verified": None, "verified_standard_error": None}
    text = printed(
        terminal.render(
            result(log_likelihood=likelihood, surface=None, baselines={}, warnings=[], search={})
        )
    )
    assert "not verified" in text
    for words in ("a few runs of", "scatter", "least squares", "Warning", "starts"):
        assert words not in text


def test_the_least_document_can_be_rendered() -> None:
    least = {
        "alpha": {"x.mean": {"estimate": 1.0}},
        "log_likelihood": {"estimated": None},
        "experiments": [],
    }
    text = printed(terminal.render(least))
    assert "1 hyperparameter identified from 0 experiments" in text


def test_a_bias_of_nothing_has_no_sign() -> None:
    assert with_error(-0.00001, 0.0034) == ("0.0000", "0.0034")


def test_predictions_are_a_table() -> None:
    columns = {
        "id": ["new"], "mean": [1.23456], "standard_deviation": [0.0123], "q0.025": [1.0],
        "q0.25": [1.1], "q0.5": [1.2], "q0.75": [1.3], "q0.975": [1.4], "status": ["solved"],
    }  # fmt: skip
    text = printed(terminal.render_predictions(columns, "log(time)"))
    assert "Predicted distribution of log(time)" in text
    assert text.splitlines()[-1].split() == [
        "new", "1.235", "0.0123", "1.2", "1.1", "..", "1.3", "1", "..", "1.4", "solved",
    ]  # fmt: skip


def test_a_recovery_tells_bias_and_coverage() -> None:
    alpha = np.array([[0.9, 0.10], [1.0, 0.12], [1.1, 0.14]])
    found = Recovery(
        ("x.mean", "x.sd"),
        np.array([1.0, 0.02]),
        alpha,
        np.stack([alpha - 0.05, alpha + 0.05], axis=-1),
        np.zeros(3),
        np.array([True, True, False]),
    )
    document = recovery.document(found)
    assert document["hyperparameters"]["x.mean"]["coverage"] == pytest.approx(1 / 3)
    assert document["replicates"][2]["converged"] is False
    text = printed(recovery.render({"title": "Springs", **document}, ["out/recovery.json"]))
    assert "3 virtual data sets" in text
    rows = {line.split()[0]: line for line in text.splitlines() if line.startswith("x.")}
    assert "33 %" in rows["x.mean"]
    assert "biased" not in rows["x.mean"]
    assert "biased" in rows["x.sd"]
    assert "Written: out/recovery.json" in text


def test_a_recovery_tells_what_its_errors_hold_where_there_is_one() -> None:
    alpha, nothing = np.array([[0.9], [1.0], [1.1]]), np.full((3, 1, 2), np.nan)
    errors = np.array([[[0.01, 0.06]], [[0.01, np.nan]], [[np.nan, 0.06]]])
    found = Recovery(
        ("x.mean",), np.array([1.0]), alpha, nothing, np.zeros(3), np.ones(3, dtype=bool), errors
    )
    row = found.table().loc["x.mean"]
    assert np.isnan(row["coverage"])
    assert row["by_error"] == pytest.approx(0.5)
    assert row["by_sandwich"] == 1.0
    text = printed(recovery.render(recovery.document(found)))
    assert "50 %" in text
    assert "100 %" in text
