"""Published examples are solved to the digits that were printed, and their page says so."""

import pytest

from website.exact_answers import EXAMPLES, HEAD, PAGE, notes, rows
from website.published import Example

TEXT = PAGE.read_text(encoding="utf-8")
MARGIN = 1e-9
"""The change, relative to a number of ours, that moves none of its printed digits. Another kernel
of the BLAS changed maxima by up to 1e-10. It changed those of the restricted likelihood by up to
2e-6: fewer of their digits are printed."""


@pytest.mark.parametrize(
    "example",
    [pytest.param(one, marks=[pytest.mark.long] if one.slow else []) for one in EXAMPLES],
    ids=lambda one: one.title,
)
def test_published_numbers_are_met(example: Example) -> None:
    found = example.answer
    assert found.sound
    for one in example.numbers:
        ours = one.of(found)
        assert abs(ours - float(one.theirs)) <= one.tolerance, one.quantity
        moved = {one.cells(ours + by * MARGIN * abs(ours)) for by in (-1.0, 0.0, 1.0)}
        assert len(moved) == 1, f"{one.quantity}: print fewer digits of {ours}"
    assert rows(example) in TEXT


def test_the_page_has_the_rows_of_all_examples() -> None:
    assert TEXT.startswith(HEAD)
    assert TEXT.endswith("\n" + "".join(notes()))
    numbers = sum(len(one.numbers) for one in EXAMPLES)
    assert len(TEXT.splitlines()) == len(HEAD.splitlines()) + numbers + 1 + len([*notes()])
