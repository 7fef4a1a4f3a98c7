"""The charts of a page as the JSON that Bokeh draws from, and Bokeh's own JavaScript."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from importlib.resources import files
from typing import Any

from bokeh.document import Document

from aleator.report.html.chart import Chart

TEX = re.compile(r'\[(?:\{start:"[^"]+",end:"[^"]+",inline:![01]\},?)+\]')
"""The delimiters of TeX that Bokeh looks for in each title and label."""
RENDERER = re.compile(r"https://cdn\.jsdelivr\.net/npm/mathjax[^\"]*")
"""Where Bokeh would fetch what renders TeX."""
ID = re.compile(r'"id":"(p[0-9]+)"')


def drawable(charts: Iterable[Chart]) -> dict[str, Any]:
    """What Bokeh's `embed_items` takes: one document of all charts, and where each goes.

    Models are numbered from 1, so that the same charts give the same text.
    """
    charts = list(charts)
    document = Document()
    with document.models.freeze():  # else all models are walked again at each chart
        for chart in charts:
            document.add_root(chart.plot)
    text = json.dumps(document.to_json(deferred=False), separators=(",", ":"))
    numbers = {name: f"m{k}" for k, name in enumerate(dict.fromkeys(ID.findall(text)), start=1)}
    text = ID.sub(lambda found: f'"id":"{numbers[found[1]]}"', text)
    places = {numbers[chart.plot.id]: f"plot-{chart.name}" for chart in charts}
    return {"documents": {"report": json.loads(text)}, "places": places}


def bokeh_script() -> str:
    """Bokeh's JavaScript, which its wheel carries: all that the charts need, without network.

    It takes no text for TeX, for which it would fetch another script from a public address.
    """
    script = (files("bokeh") / "server/static/js/bokeh.min.js").read_text(encoding="utf-8")
    return RENDERER.sub("data:,", TEX.sub("[]", script))


def safe(value: Any) -> str:
    """JSON that can stand in a script element.

    >>> safe({"a": "</script>"})
    '{"a":"\\\\u003c/script>"}'
    """
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")
