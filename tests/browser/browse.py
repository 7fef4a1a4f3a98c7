"""report.html in a real browser: `make browser`. Pictures of it are left in out/browser."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from browser.chromium import Page, chromium

from aleator import Check, Experiments, Free, Inputs, Noise, Normal, OutcomeQuestion, identify
from aleator.tasks.identification import pictured

OUT = Path(__file__).parents[2] / "out" / "browser"
COUNT, TIMES = 12, 6
CHART = "measured-0"
OF = "JSON.parse(document.getElementById('facts').textContent)"
PLOT = f"""((name) => {{ const places = {OF}.places;
  return Bokeh.index[Object.keys(places).find((id) => places[id] === 'plot-' + name)]; }})"""
SOURCES = (
    "[...Bokeh.documents[0]._all_models.values()].filter((m) => m.type === 'ColumnDataSource')"
)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of series of two makers' springs, synthetic."""
    rng = np.random.default_rng(5)
    start, slope = rng.normal(2.0, 0.3, COUNT), rng.normal(1.0, 0.2, COUNT)
    id, time = np.repeat(np.arange(COUNT), TIMES), np.tile(np.arange(TIMES) / 2.0, COUNT)
    way = start[id] + slope[id] * time + rng.normal(0.0, 0.1, id.size)
    frame = pd.DataFrame(
        {"id": [f"s{k:02d}" for k in id], "time": time, "way": way,
         "maker": np.where(id % 3 == 0, "A & B", "<C>"), "load": 1.0 + id}
    )  # fmt: skip
    found = identify(
        lambda time, start, slope: start + slope * time,
        Experiments.from_frame(frame, outcome="way", beside=["maker", "load"]),
        Inputs({"start": Normal(Free(1.0, 3.0), Free(0.0, 1.0)),
                "slope": Normal(Free(0.0, 2.0), Free(0.0, 1.0))}),
        noise=Noise(Free(0.01, 1.0)), vectorized=True, verification=Check(0), best_law=False,
        units={"way": r"$$mm^2$$ \(a\) \[b\]", "start": "$$mm$$"},
        questions=[OutcomeQuestion(probability="way > 5", at={"time": 2.0}, noise=False),
                   OutcomeQuestion(tolerance=(0.95, 0.9), at={"time": 2.0})],
    )  # fmt: skip
    path = tmp_path_factory.mktemp("report") / "report.html"
    pictured(found).report().save(path)
    OUT.mkdir(parents=True, exist_ok=True)
    return path


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with chromium() as found:
        yield found


def place(page: Page, chart: str, k: int) -> tuple[float, float]:
    """Where the mark of a row is on the screen, scrolled to."""
    found = page.ask(
        f"""(() => {{ const view = {PLOT}({chart!r});
        view.el.scrollIntoView({{block: 'center'}});
        const source = {SOURCES}.find((m) => m.name === {chart!r});
        const box = view.el.getBoundingClientRect();
        return [box.left + view.frame.x_scale.compute(source.data.x[{k}]),
                box.top + view.frame.y_scale.compute(source.data.value[{k}])]; }})()"""
    )
    return float(found[0]), float(found[1])


def marked(page: Page) -> dict[str, list[str]]:
    """The distinct ids that are selected, by source; some have a few experiments only."""
    return dict(
        page.ask(
            f"""Object.fromEntries({SOURCES}.filter((m) => m.name !== null
            && !m.name.startsWith('over-') && m.data.id !== undefined && m.tags.length === 0)
            .map((m) => [m.name, [...new Set(m.selected.indices.map((k) => m.data.id[k]))]]))"""
        )
    )


def taken(page: Page, button: str) -> str:
    """The text that a button saves."""
    return str(
        page.ask(
            f"""(async () => {{ let blob = null; const make = URL.createObjectURL;
            URL.createObjectURL = (one) => {{ blob = one; return make.call(URL, one); }};
            HTMLAnchorElement.prototype.click = () => {{}};
            document.querySelector({button!r}).click();
            URL.createObjectURL = make; return await blob.text(); }})()"""
        )
    )


def test_every_chart_is_drawn_without_an_error_and_without_the_network(
    page: Page, file: Path
) -> None:
    page.open(file)
    empty = page.ask(
        f"Object.keys({OF}.charts).filter((name) => {PLOT}(name).el.getBoundingClientRect().height"
        " < 100)"
    )
    assert empty == []
    assert page.console == []
    assert {url for url in page.requests if not url.startswith("data:")} == {file.as_uri()}


def test_hovering_tells_the_experiment(page: Page, file: Path) -> None:
    page.open(file)
    x, y = place(page, CHART, 7)
    page.move(x - 30.0, y)
    page.move(x, y)
    page.wait(TOLD)
    id = page.ask(f"{SOURCES}.find((m) => m.name === {CHART!r}).data.id[7]")
    assert id in page.ask(f"({DEEP})().join(' ')")


def test_a_click_marks_the_experiment_in_every_chart(page: Page, file: Path) -> None:
    page.open(file)
    x, y = place(page, CHART, 20)
    page.click(x, y)
    page.wait("document.getElementById('marked').value !== ''")
    id = page.ask("document.getElementById('marked').value")
    assert id == page.ask(f"{SOURCES}.find((m) => m.name === {CHART!r}).data.id[20]")
    found = marked(page)
    assert {"measured-0", "series-0", "individuals", "pit-cumulative"} <= set(found)
    assert all(ids == [id] for ids in found.values()), found
    alone = f"{SOURCES}.find((m) => m.name === 'marked-0').data.id"
    assert set(page.ask(f"[...{alone}]")) == {id}
    page.picture(OUT / "marked.png")
    assert page.console == []


def test_the_keyboard_does_the_same(page: Page, file: Path) -> None:
    page.open(file)
    page.ask("document.getElementById('marked').focus()")
    page.send("Input.insertText", text="s03")
    page.press("Enter", text="\r")
    assert all(ids == ["s03"] for ids in marked(page).values())
    page.ask("document.getElementById('next').click()")
    assert all(ids == ["s04"] for ids in marked(page).values())
    page.press("Escape")
    assert all(ids == [] for ids in marked(page).values())


def test_the_x_axis_can_be_any_condition(page: Page, file: Path) -> None:
    page.open(file)
    axes = [axis["title"] for axis in page.ask(f"{OF}.axes")]
    assert {"time", "maker", "load"} <= set(axes)
    page.ask(
        f"""(() => {{ const select = document.querySelector("#predicted select");
        select.value = "{axes.index("maker")}"; select.dispatchEvent(new Event("change")); }})()"""
    )
    labels = page.ask(f"[...{PLOT}({CHART!r}).model.below[0].major_label_overrides.values()]")
    assert labels == ["<C>", "A & B"] or labels == ["A & B", "<C>"]
    drawn = page.ask(f"[...{SOURCES}.find((m) => m.name === {CHART!r}).data.x]")
    assert sorted(set(drawn)) == [0, 1]
    assert page.console == []


def test_charts_are_saved_as_drawings_and_as_numbers(page: Page, file: Path) -> None:
    page.open(file)
    for name in page.ask(f"Object.keys({OF}.charts)"):
        drawing = ElementTree.fromstring(taken(page, f'[data-svg="{name}"]'))
        assert drawing.tag.endswith("svg")
        rows = list(csv.reader(io.StringIO(taken(page, f'[data-csv="{name}"]'))))
        assert len(rows) > 1, name
        assert {len(row) for row in rows} == {len(rows[0])}, name
    rows = list(csv.reader(io.StringIO(taken(page, f'[data-csv="{CHART}"]'))))
    assert len(rows) == 1 + COUNT * TIMES
    assert page.console == []


def test_dark_is_dark_everywhere(page: Page, file: Path) -> None:
    page.open(file, width=700, scheme="dark")
    light = page.ask(f"{OF}.colors.map(([one]) => one)")
    models = page.ask(
        "JSON.stringify([...Bokeh.documents[0]._all_models.values()].flatMap((m) => [...m]"
        ".filter((p) => p.attr.endsWith('_color')).map((p) => m[p.attr]?.value ?? m[p.attr]))"
        ".filter((v) => !v?.field))"
    )
    data = page.ask(f"{SOURCES}.flatMap((m) => [...(m.data.color ?? [])])")
    assert not set(light) & {one for one in flat(json.loads(models)) if isinstance(one, str)}
    assert data
    assert not set(light) & set(data)
    page.picture(OUT / "dark-700.png")
    assert page.console == []


def test_print_is_light_and_has_every_chart_as_a_drawing(page: Page, file: Path) -> None:
    page.open(file, scheme="dark")
    page.ask("dispatchEvent(new Event('beforeprint'))")
    charts = page.ask(f"Object.keys({OF}.charts).length")
    assert page.ask("document.querySelectorAll('.print > svg').length") == charts
    drawn = page.ask("[...document.querySelectorAll('.print')].map((e) => e.innerHTML).join()")
    pairs = page.ask(f"{OF}.colors")
    shades = [dark for _, dark in pairs]
    shades += [f"rgb({','.join(str(v) for v in bytes.fromhex(dark[1:]))})" for dark in shades]
    assert not [dark for dark in shades if dark in drawn]
    assert drawn.count("viewBox") == charts
    widths = page.ask(
        "[...document.querySelectorAll('.print > svg')].map((e) => e.viewBox.baseVal.width)"
    )
    assert max(widths) <= 720  # px between the margins of A4: letters are as large as on screen
    assert pairs[0][0] in drawn
    page.ask("dispatchEvent(new Event('afterprint'))")
    assert page.ask("document.querySelectorAll('.print > svg').length") == 0
    page.pdf(OUT / "report.pdf")
    assert (OUT / "report.pdf").read_bytes().startswith(b"%PDF")
    assert page.console == []


def test_the_map_of_the_simulator_is_that_of_the_marked_experiment(page: Page, file: Path) -> None:
    page.open(file)
    of = f"((name) => {SOURCES}.find((m) => m.name === name))"
    rows = ("first", "middle", "last")
    known = page.ask(f"Object.keys({of}('map-way-last').tags[0])")
    assert len(known) > 2
    for id in (known[0], known[-1]):
        page.ask("document.getElementById('clear').click()")
        page.ask(
            f"(() => {{ const input = document.getElementById('marked'); input.value = {id!r};"
            " input.dispatchEvent(new Event('change')); })()"
        )
        for name in [f"{kind}-way-{row}" for kind in ("map", "level") for row in rows]:
            assert set(page.ask(f"[...{of}({name!r}).data.id]")) <= {id}, name
        for row in rows:
            assert page.ask(f"{PLOT}('map-way-{row}').model.title.text") == id
        over = f"{of}('over-0-slope')"
        told = f"{over}.selected.indices.map((k) => [{over}.data.id[k], {over}.data.row[k]])"
        assert page.ask(told) == [[id, f"{row} row"] for row in rows]
        for row in rows:  # what was measured lies there
            assert len(page.ask(f"[...{of}('level-way-{row}').data.x]")) > 0
    assert page.console == []


def test_at_two_widths_nothing_is_wider_than_the_window(page: Page, file: Path) -> None:
    for width in (1300, 390):
        page.open(file, width=width)
        assert page.ask("document.documentElement.scrollWidth") <= width
        page.picture(OUT / f"light-{width}.png")


def test_the_answer_is_on_the_first_screen(page: Page, file: Path) -> None:
    page.open(file)
    ends = page.ask(
        "['.findings', '.verdicts', '#plot-outcomes', '#plot-law-start', '#plot-law-slope']"
        ".map((one) => document.querySelector(one).getBoundingClientRect().bottom)"
    )
    assert ends[0] < ends[1] < ends[2] <= 900
    assert max(ends[3:]) <= 900
    told = page.ask("document.querySelector('.findings').textContent")
    assert told.count("95 %") >= 3
    assert "the true way exceeds 5" in told
    assert "(90 % confidence)" in told


BARRIERS = """axe.run(document, {resultTypes: ['violations']}).then((found) =>
  found.violations.flatMap((one) => one.nodes.map((node) => `${one.id}: ${node.html}`)))"""


def test_axe_finds_no_barrier(page: Page, file: Path) -> None:
    axe = (files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8")
    for width, scheme in ((1300, "light"), (390, "dark")):
        page.open(file, width=width, scheme=scheme)
        page.ask("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        page.ask(f"{axe};0")
        assert page.ask(BARRIERS) == []
    page.ask("document.querySelector('main').prepend(document.createElement('button'))")
    assert [one.partition(":")[0] for one in page.ask(BARRIERS)] == ["button-name"]


DEEP = """() => { const told = []; const walk = (node) => {
  if (node.shadowRoot) node.shadowRoot.childNodes.forEach(walk);
  if (node.nodeType === 1 && [...node.classList].some((c) => c.startsWith('bk-tooltip-row'))) {
    told.push(node.textContent); }
  node.childNodes.forEach(walk); }; walk(document.body); return told; }"""
TOLD = f"({DEEP})().length > 0"


def flat(value: Any) -> list[Any]:
    """All that lists hold."""
    return [one for part in value for one in flat(part)] if isinstance(value, list) else [value]
