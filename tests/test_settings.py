"""The page of settings is the one that the package would write today."""

import re

from website.settings import PAGE, instances, meanings, page


def test_the_page_of_settings_is_that_of_the_package() -> None:
    assert PAGE.read_text(encoding="utf-8") == page()


def test_every_settings_object_says_what_its_fields_are() -> None:
    silent = []
    for module, name, value in instances():
        written, below = type(value).__doc__ or "", meanings(type(value))
        silent += [
            f"{module}.{name}.{field}" for field in vars(value)
            if field not in below and not re.search(rf"`{field}(?![A-Za-z0-9_])", written)
        ]  # fmt: skip
    assert silent == []
