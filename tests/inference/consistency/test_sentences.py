from aleator.inference.consistency.columns import ORDER
from aleator.inference.consistency.sentences import told
from aleator.results.values import Statistic


def test_neighbours_in_an_experiment_are_no_order_of_rows() -> None:
    test = Statistic("groups", "outcomes", ORDER, None, 4.0, 1e-4, 1e-3)
    found = told(test, several=True, within=())
    assert "same experiment" in found.message
    assert ORDER not in found.message


def test_each_tail_has_its_remedy() -> None:
    heavy, light = (
        told(Statistic(f"{kind} tails", "outcomes", None, None, 4.0, 1e-4, 1e-3), False, ())
        for kind in ("heavy", "light")
    )
    assert "student_t" in heavy.remedy
    assert "mixture" in light.remedy


def test_a_column_that_may_be_a_result_has_the_remedy_to_take_it_out() -> None:
    test = Statistic("contrast", "outcomes", "peak", None, 4.0, 1e-4, 1e-3)
    assert "take it out of the table" in told(test, False, (), {"peak"}).remedy
    assert "take it out" not in told(test, False, ()).remedy
