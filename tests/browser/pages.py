"""Every page of the built site in a headless Chromium: `make browser-docs`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser.chromium import Page, chromium

SITE = Path(__file__).parents[2] / "out" / "docs"
BROKEN = "[...document.images].filter((i) => i.src && !i.naturalWidth).map((i) => i.src)"


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with chromium() as found:
        yield found


def visit(page: Page, path: Path, width: int, scheme: str, query: str = "") -> None:
    page.console.clear()
    page.requests.clear()
    page.size(width, 900)
    page.send("Emulation.setEmulatedMedia",
              features=[{"name": "prefers-color-scheme", "value": scheme}])  # fmt: skip
    page.send("Page.navigate", url=path.resolve().as_uri() + query)
    page.wait("document.readyState === 'complete'")


@pytest.mark.parametrize(("width", "scheme"), [(1300, "light"), (390, "dark")])
def test_no_page_complains_asks_the_network_or_is_wider_than_the_window(
    page: Page, width: int, scheme: str
) -> None:
    pages = sorted(SITE.rglob("*.html"))
    assert len(pages) > 50
    for path in pages:
        if path == SITE / "index.html":  # it leads to the first page, at once
            continue
        visit(page, path, width, scheme)
        assert page.console == [], path
        assert [url for url in page.requests if not url.startswith(("file:", "data:"))] == [], path
        assert page.ask("document.documentElement.scrollWidth - innerWidth") <= 0, path
        assert page.ask(BROKEN) == [], path


def test_the_search_finds_pages_without_a_network(page: Page) -> None:
    visit(page, SITE / "search.html", 1300, "light", "?q=censored")
    page.wait("document.querySelectorAll('ul.search li').length > 2")
