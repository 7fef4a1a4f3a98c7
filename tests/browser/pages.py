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


SEARCHED = "[...document.querySelectorAll('ul.search li a')].map((a) => a.href)"


@pytest.mark.parametrize(
    ("word", "wanted"),
    [
        ("censored", "docs/howto/censored.html"),
        ("PyBaMM", "examples/discharge/README.html"),
        ("next_experiments", "docs/api/questions.html#aleator.next_experiments"),
        ("ferx", "docs/coming_from.html"),
    ],
)
def test_the_search_finds_a_page_without_a_network(page: Page, word: str, wanted: str) -> None:
    visit(page, SITE / "docs" / "index.html", 1300, "light")
    form = page.ask("document.querySelector('form.sidebar-search-container').action")
    assert form == (SITE / "search.html").resolve().as_uri()
    visit(page, SITE / "search.html", 1300, "light", f"?q={word}")
    page.wait("(document.querySelector('p.search-summary')?.textContent ?? '').includes('found')")
    assert (SITE / wanted.partition("#")[0]).exists()
    assert any(link.endswith(wanted) for link in page.ask(SEARCHED))
    assert [url for url in page.requests if not url.startswith(("file:", "data:"))] == []
    assert page.console == []


@pytest.mark.parametrize("width", [1200, 420])
def test_the_questions_of_the_first_page_lead_to_those_of_the_gallery(
    page: Page, width: int
) -> None:
    visit(page, SITE / "docs" / "index.html", width, "light")
    links = page.ask(
        "[...document.querySelectorAll('a[href*=\"gallery.html#\"]')].map((a) => a.hash)"
    )
    visit(page, SITE / "docs" / "gallery.html", width, "light")
    asked = page.ask("[...document.querySelectorAll('#gallery > section')].map((s) => '#' + s.id)")
    assert sorted(links) == sorted(asked)
    shown = page.ask("[...document.querySelectorAll('#gallery section img')].map((i) => i.src)")
    assert (
        len(shown)
        == len(set(shown))
        == len(page.ask("[...document.querySelectorAll('h3')].map(() => 0)"))
    )
