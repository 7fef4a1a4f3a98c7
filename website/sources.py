"""What links of a checkout become on the site.

A source file that a page links to has a page, in place of a download. A link that is called as its
file is, `method.md`, is called as that page is.
"""

import posixpath
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils.nodes import document, emphasis, reference
from pygments.lexers import get_lexer_for_filename
from sphinx.addnodes import download_reference
from sphinx.application import Sphinx

SHOWN = {".py", ".toml", ".csv", ".sh", ".tpl", ".lock"}
LARGEST = 200_000  # bytes; a larger one stays a download


def page_of(path: str) -> str:
    """The page that shows a file, by its path in the repository."""
    return f"source/{path}"


def link_pages(app: Sphinx, doctree: document, docname: str) -> None:
    """Links to source files lead to their pages."""
    if app.builder.format != "html":
        return
    for node in list(doctree.findall(download_reference)):
        path = app.env.relfn2path(node["reftarget"], docname)[0]
        file = Path(app.srcdir) / path
        if file.suffix not in SHOWN or not file.is_file() or file.stat().st_size > LARGEST:
            continue
        linked(app).add(path)
        uri = app.builder.get_relative_uri(docname, page_of(path))
        node.replace_self(reference("", "", *node.children, internal=True, refuri=uri))


def name_pages(app: Sphinx, doctree: document, docname: str) -> None:
    """A link whose text is the name of a file gets the title of the page."""
    for node in doctree.findall(reference):
        text = node.astext()
        if not text.endswith(".md") or "refuri" not in node:
            continue
        file = node["refuri"].partition("#")[0].removesuffix(".html")
        page = posixpath.normpath(posixpath.join(posixpath.dirname(docname), file))
        if page in app.env.titles:
            title = app.env.titles[page].astext()
            node.children = [emphasis(title, title)]


def linked(app: Sphinx) -> set[str]:
    """The files that are linked to, kept from one build to the next."""
    if not hasattr(app.env, "aleator_sources"):
        app.env.aleator_sources = set()
    found: set[str] = app.env.aleator_sources
    return found


def pages(app: Sphinx) -> Iterator[tuple[str, dict[str, str], str]]:
    """Every file that is linked to, colored."""
    for path in sorted(linked(app)):
        text = (Path(app.srcdir) / path).read_text(encoding="utf-8")
        lexer = (
            get_lexer_for_filename(path) if not path.endswith((".tpl", ".csv", ".lock")) else None
        )
        shown = app.builder.highlighter.highlight_block(
            text, lexer.aliases[0] if lexer else "text", linenos="inline", force=True
        )
        yield (
            page_of(path),
            {"title": path, "body": f"<h1><code>{path}</code></h1>{shown}"},
            "page.html",
        )


def setup(app: Sphinx) -> dict[str, Any]:
    """Join Sphinx."""
    app.connect("doctree-resolved", link_pages)
    app.connect("doctree-resolved", name_pages)
    app.connect("html-collect-pages", pages)
    return {"parallel_read_safe": False, "parallel_write_safe": False}
