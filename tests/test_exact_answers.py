"""Published examples are solved to the digits that were printed, and their page says so."""

import pytest

from website.exact_answers import EXAMPLES, PAGE, Example, page


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda one: one.title)
def test_published_numbers_are_met(example: Example) -> None:
    found = example.answer
    assert found.sound
    for one in example.numbers:
        off = one.of(found) - float(one.theirs)
        assert abs(off) <= one.tolerance, one.quantity


def test_the_page_is_that_of_the_script() -> None:
    assert PAGE.read_text(encoding="utf-8") == page()
