from aleator.inference.consistency.columns import ORDER
from aleator.inference.consistency.sentences import told
from aleator.inference.consistency.value import Statistic


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
