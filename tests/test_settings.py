"""The page of settings is the one that the package would write today."""

from website.settings import PAGE, page


def test_the_page_of_settings_is_that_of_the_package() -> None:
    assert PAGE.read_text(encoding="utf-8") == page()
