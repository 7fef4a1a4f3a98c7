"""report.html: one file, nothing from elsewhere, all that is to be seen in it."""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from collections.abc import Mapping
from html.parser import HTMLParser
from importlib.resources import files
from typing import Any

import numpy as np
import pandas as pd
import pytest
from bokeh.document import Document
from bokeh.models import TapTool

from aleator import (
    AleatorError,
    Censoring,
    Check,
    Experiments,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
)
from aleator.cli.running import can_report
from aleator.tasks.identification import pictured
from aleator.tasks.identify import identify
from aleator.views.chart import BLUE, GRAY, PICKED, Axis, Chart, GuideLine, Mark, Series
from aleator.views.interactive import TEX, bokeh_script, drawable
from aleator.views.page import report_of, safe

VOID = {"meta", "input", "br", "link", "img"}
SECTIONS = [
    "warnings", "law", "estimates", "likelihoods", "predicted", "calibration", "individuals",
    "surfaces", "effort", "experiments", "origin",
]  # fmt: skip
LARGEST = 3_000_000
COUNT = 30


class Reader(HTMLParser):
    """A page whose elements are closed in order, with their attributes and tables."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.cells: dict[str, list[list[str]]] = {}
        self.table = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        own = dict(attrs)
        self.found.append((tag, own))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.table = own["id"] or ""
            self.cells[self.table] = []
        if tag == "tr":
            self.cells[self.table].append([])
        if tag in ("td", "th"):
            self.cells[self.table][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[self.table][-1][-1] += data

    def all(self, name: str) -> list[str]:
        """The values of an attribute."""
        return [own[name] or "" for _, own in self.found if name in own]


def facts(text: str) -> dict[str, Any]:
    """What the page's script draws from."""
    found = re.search(r'<script id="facts" type="application/json">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    return dict(json.loads(found[1]))


def models(value: Any) -> list[Mapping[str, Any]]:
    """All models of Bokeh's document."""
    if isinstance(value, dict):
        own = [value] if value.get("type") == "object" and "id" in value else []
        return own + [one for part in value.values() for one in models(part)]
    return [one for part in value for one in models(part)] if isinstance(value, list) else []


def sources(text: str) -> dict[str, dict[str, Any]]:
    """The columns of the named data sources."""
    found = {}
    for model in models(facts(text)["documents"]):
        if model["name"] == "ColumnDataSource" and "name" in model["attributes"]:
            found[model["attributes"]["name"]] = dict(model["attributes"]["data"]["entries"])
    return found


def springs(count: int = COUNT, **more: Any) -> Identification:
    rng = np.random.default_rng(3)
    load = rng.uniform(1.0, 5.0, count)
    frame = pd.DataFrame({"load": load, "maker": rng.choice(["A", "B"], count)})
    frame["way"] = load * rng.normal(1.0, 0.2, count) + rng.normal(0.0, 0.1, count)
    return identify(
        lambda load, x: load * x,
        frame,
        Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.5))}),
        outcome="way",
        noise=Noise(0.1),
        vectorized=True,
        verification=Check(0),
        best_law=False,
        **more,
    )


@pytest.fixture(scope="module")
def found() -> Identification:
    return pictured(springs())


@pytest.fixture(scope="module")
def text(found: Identification) -> str:
    return report_of(found.to_dict() | {"title": "Springs <&>"}).text


def test_it_is_one_well_formed_file_with_every_section_and_nothing_from_elsewhere(
    text: str,
) -> None:
    reader = Reader(text)
    assert len(text.encode()) < LARGEST
    assert [own["id"] for tag, own in reader.found if tag == "section"] == SECTIONS
    assert text.index("Computed soundly") < text.index("<main>")  # the verdicts come first
    assert len(set(reader.all("id"))) == len(reader.all("id"))
    assert reader.all("src") == []
    assert all(link.startswith("#") and link[1:] in reader.all("id") for link in reader.all("href"))
    assert "@import" not in text
    assert "aleator ceiling" in text  # experiments with noise and one law have a best possible law
    assert not re.search(r"url\(\s*['\"]?https?:", text)
    assert "<title>Springs &lt;&amp;&gt;</title>" in text


def test_each_experiment_stands_once_in_the_table_and_in_every_source(text: str) -> None:
    rows = Reader(text).cells["table-experiments"]
    ids = [row[0] for row in rows[1:]]
    assert sorted(ids) == sorted(map(str, range(1, COUNT + 1)))
    assert {len(row) for row in rows} == {len(rows[0])}
    for name, columns in sources(text).items():
        if name.startswith("over-"):  # of some experiments
            assert {*columns["id"]} < {*ids}
            assert len({*columns["id"]}) == len(columns["id"])
        elif "id" in columns:
            assert Counter(columns["id"]) == Counter(ids), name


def test_every_table_can_be_copied_and_every_chart_saved(text: str) -> None:
    reader = Reader(text)
    assert sorted(reader.all("data-copy")) == sorted(reader.cells.keys())
    charts = facts(text)["charts"]
    assert reader.all("data-svg") == reader.all("data-csv") == list(charts)
    assert {f"plot-{name}" for name in charts} == set(facts(text)["places"].values())
    known = sources(text)
    for chart in charts.values():
        assert set(chart["columns"]) <= set(known[chart["source"]]), chart


def test_every_color_of_a_chart_has_a_dark_one(text: str) -> None:
    pairs = facts(text)["colors"]
    assert len({color for pair in pairs for color in pair}) == 2 * len(pairs)
    used = set(re.findall(r'"(#[0-9a-f]{6})"', json.dumps(facts(text)["documents"])))
    assert used <= {light for light, _ in pairs}


def test_x_can_be_any_condition_and_texts_have_their_names(text: str) -> None:
    axes = {axis["title"]: axis["of"]["measured-0"] for axis in facts(text)["axes"]
            if "measured-0" in axis["of"]}  # fmt: skip
    assert len(axes) == 4
    assert {"predicted median of way", "load", "maker"} < set(axes)
    assert axes["maker"]["labels"] == ["A", "B"]
    columns = sources(text)["measured-0"]
    codes, shown = columns[axes["maker"]["key"]], columns[axes["maker"]["key"] + "_shown"]
    assert [axes["maker"]["labels"][code] for code in codes] == shown


def test_numbers_of_the_page_are_those_of_the_document(found: Identification, text: str) -> None:
    columns = sources(text)["measured-0"]
    own = {o.id: o for o in found.observations}
    for id, value, pit in zip(columns["id"], columns["value"], columns["pit"], strict=True):
        assert value == own[id].lower
        assert pit == own[id].pit


def test_bounds_are_drawn_as_bounds() -> None:
    rng = np.random.default_rng(1)
    strength = rng.normal(1.0, 0.3, 25)
    beyond = strength > 1.2
    frame = pd.DataFrame({"y": np.minimum(strength, 1.2), "end": np.where(beyond, "out", "")})
    censoring = Censoring(column="end", right="out")
    table = Experiments.from_frame(frame, outcome="y", censored={"y": censoring})
    found = identify(
        lambda x: x, table, Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.8))}),
        noise=Noise(0.05), vectorized=True, verification=Check(0), best_law=False,
        consistency=False,
    )  # fmt: skip
    columns = sources(report_of(pictured(found).to_dict()).text)["measured-0"]
    for kind, marker, out in zip(columns["kind"], columns["marker"], beyond, strict=True):
        assert kind == ("at least" if out else "measured")
        assert (marker == "triangle") == out


def test_the_script_of_a_page_takes_no_text_for_tex_and_fetches_nothing() -> None:
    bokeh = (files("bokeh") / "server/static/js/bokeh.min.js").read_text(encoding="utf-8")
    assert len(TEX.findall(bokeh)) == 1
    assert not TEX.search(bokeh_script())
    assert "mathjax@" in bokeh
    assert "mathjax@" not in bokeh_script()


SYNTHETIC = Series(
    "springs",
    {
        "x": [1.0, 2.0, 3.0], "y": [1.0, np.nan, 4.0], "high": [2.0, 3.0, 5.0],
        "color": [BLUE, GRAY, BLUE], "sign": ["circle", "triangle", "circle"],
        "along": [[1.0, 2.0], [2.0, 3.0], [1.0, 1.5]], "width": [1.0, 2.0, 3.0],
        "group": ["old", "new", "old"], "id": ["1", "2", "3"],
    },
    {"2": {"y": [1.0, 2.0, 3.0]}},
)  # fmt: skip
MARKS = [
    Mark("line", SYNTHETIC, dash="dashed", legend="median", alpha=0.5),
    Mark("band", SYNTHETIC, high="high", legend="95 %"),
    Mark("spans", SYNTHETIC, high="high", right=True),
    Mark("bars", SYNTHETIC, width=0.4),
    Mark("points", SYNTHETIC, color="color", marker="sign", pick=True, hover=[("id", "{id}")]),
    Mark("points", SYNTHETIC, marker="tick", legend="median"),
]
LINES = Mark("lines", SYNTHETIC, x="along", y="along", width="width", legend_by="group", pick=True)
PLANE = (np.arange(4.0), np.arange(3.0), np.add.outer(np.arange(3.0) ** 2, np.arange(4.0)))
DRAWN = [
    Chart("all", "All", "", Axis("load", log=True), Axis("way", log=True), MARKS, {},
          [GuideLine(1.0)], marked="2", right=Axis("share")),
    Chart("lines", "Lines", "", Axis("load"), Axis("way", share=True), [LINES], {}, foot=True),
    Chart("plane", "Plane", "", Axis("a"), Axis("b"),
          [Mark("contour", SYNTHETIC, grid=PLANE, levels=(0.5, 1.0, 2.0)),
           Mark("cells", Series("map", {"x": [0.0], "y": [0.0], "value": [1.0]}))], {}),
]  # fmt: skip


def test_bokeh_reads_the_models_as_its_own() -> None:
    """Its classes refuse an attribute or a value that they do not know."""
    data = drawable(DRAWN)
    document = Document.from_json(json.loads(safe(data))["documents"]["report"])
    every, lines, plane = document.roots
    assert {root.id: f"plot-{c.name}" for root, c in zip(document.roots, DRAWN, strict=True)} == (
        data["places"]
    )
    assert [type(axis).__name__ for axis in every.axis] == ["LogAxis", "LogAxis", "LinearAxis"]
    assert [item.label.value for item in every.legend.items] == [
        "median", "95 %", "measured", "at least",
    ]  # fmt: skip
    assert [item.label.value for item in lines.legend.items] == ["old", "new"]
    assert lines.yaxis.formatter.format == "0.[0000] %"
    shared = [one.data_source for one in every.renderers[:6]] + [lines.renderers[0].data_source]
    assert {source.name for source in shared} == {"springs"}
    assert len(set(shared)) == 1
    fill = plane.renderers[0].fill_renderer.data_source
    heights = fill.data["fill_color"]
    assert len(fill.data["xs"]) == len(heights) == len(plane.renderers[0].levels) - 1
    assert every.select_one(TapTool).renderers == [every.renderers[4]]
    assert every.renderers[4].selection_glyph.fill_color.value == PICKED
    assert every.renderers[0].nonselection_glyph is None


class WithoutBokeh:
    """An import system in which the package is not installed."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:  # noqa: ARG002
        if name.partition(".")[0] == "bokeh":
            raise ModuleNotFoundError(f"No module named '{name}'", name="bokeh")


def test_without_bokeh_the_message_says_what_to_install(
    found: Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "aleator.views.interactive", raising=False)
    for name in [name for name in sys.modules if name.partition(".")[0] == "bokeh"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [WithoutBokeh(), *sys.meta_path])
    with pytest.raises(AleatorError, match="bokeh>="):
        found.report()
    assert not can_report(quiet=True)
