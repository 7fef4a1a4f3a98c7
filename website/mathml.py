"""Equations as MathML, which browsers draw without a script, a font or a network.

LaTeX is translated by docutils, which Sphinx brings along.
"""

import re
from typing import Any

from docutils.nodes import SkipNode, math, math_block
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

# Browsers give a function's name no distance to what it is applied to without parentheses.
APPLIED = re.compile(r"<mo>&ApplyFunction;</mo>(?!\s*<mo[^>]*>\()")
log = logging.getLogger(__name__)


def written(translator: HTML5Translator, node: math | math_block, block: bool) -> None:
    """One equation; one that docutils cannot read is a warning that names the page."""
    try:
        found = tex2mathml(node.astext(), as_block=block)
        translator.body.append(APPLIED.sub('<mspace width="0.1667em"></mspace>', found))
    except MathError as error:
        log.warning("no equation: %s", error, location=node)
    raise SkipNode


def inline(translator: HTML5Translator, node: math) -> None:
    """An equation within a sentence."""
    written(translator, node, block=False)


def display(translator: HTML5Translator, node: math_block) -> None:
    """An equation on a line of its own."""
    written(translator, node, block=True)


def setup(app: Sphinx) -> dict[str, Any]:
    """Join Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
