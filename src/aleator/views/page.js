"use strict";
(() => {
  const facts = JSON.parse(document.getElementById("facts").textContent);
  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const byId = (id) => document.getElementById(id);
  const PAPER = 700;  // px between the margins of A4
  const LOW = 300;  // px of a chart at most there: two rows of them and their text share a page
  let models = [];
  let views = new Map();
  let marking = false;

  const sources = () => models.filter((m) => m.type === "ColumnDataSource");
  const named = (name) => models.find((m) => m.name === name && m.type === "ColumnDataSource");

  // ------------------------------------------------------------------ colors

  const colored = /_color$/;
  function repaint(to) {
    const swap = new Map(facts.colors.map(([l, d]) => (to === "dark" ? [l, d] : [d, l])));
    const other = (value) => {
      if (typeof value === "string") return swap.get(value) ?? value;
      if (Array.isArray(value)) return value.map(other);
      return value;
    };
    for (const model of models) {
      for (const property of model) {
        const name = property.attr;
        if (!colored.test(name)) continue;
        const value = model[name];
        if (value !== null && typeof value === "object" && !Array.isArray(value) && "value" in value) {
          const changed = other(value.value);
          if (changed !== value.value) model[name] = { ...value, value: changed };
        } else {
          const changed = other(value);
          if (changed !== value) model[name] = changed;
        }
      }
      if (model.type === "ColumnDataSource" && model.data.color !== undefined) {
        model.data = { ...model.data, color: Array.from(model.data.color, other) };
      }
      if (model.type === "ColumnDataSource" && model.data.fill_color !== undefined) {
        model.data = { ...model.data, fill_color: Array.from(model.data.fill_color, other) };
      }
    }
  }
  let scheme = "light";
  function paint(to) {
    if (to === scheme) return;
    scheme = to;
    root.classList.toggle("dark", to === "dark");
    repaint(to);
  }

  // ------------------------------------------------------------------ the marked experiment

  function mark(id) {
    if (marking) return;
    marking = true;
    for (const source of sources()) {
      const ids = source.data.id;
      if (ids === undefined) continue;
      const series = source.tags.length > 0 ? source.tags[0] : null;
      if (series !== null) {
        if (id !== null && id in series) show(source, id, series[id]);
        continue;
      }
      const found = [];
      if (id !== null) Array.from(ids).forEach((one, k) => { if (one === id) found.push(k); });
      source.selected.indices = found;
    }
    byId("marked").value = id ?? "";
    byId("status").textContent = id === null ? "" : `${id} is marked in every chart`;
    marking = false;
  }
  function show(source, id, line) {
    const [first] = Object.values(line);
    source.data = { ...source.data, id: first.map(() => id), ...line };
    const chart = Object.keys(facts.charts).find((name) => facts.charts[name].source === source.name);
    if (chart !== undefined) views.get(chart).model.title.text = id;
  }
  const listed = () => Array.from(byId("ids").options, (option) => option.value);
  function step(by) {
    const ids = listed();
    const here = ids.indexOf(byId("marked").value);
    mark(ids[(here + by + ids.length + (here < 0 && by < 0 ? 1 : 0)) % ids.length]);
  }

  // ------------------------------------------------------------------ the axis

  function turn(select) {
    const axis = facts.axes[Number(select.value)];
    for (const name of select.dataset.axis.split(" ")) {
      const source = named(name), own = axis.of[name];
      if (own === undefined) continue;
      source.data = { ...source.data, x: Array.from(source.data[own.key]) };
      for (const [chart, entry] of Object.entries(facts.charts)) {
        if (entry.source === name && entry.switched) label(views.get(chart).model, axis.title, own.labels);
      }
    }
  }
  function label(plot, title, labels) {
    const axis = plot.below.find((one) => "axis_label" in one);
    axis.axis_label = title;
    const { ticker } = axis;
    if (!("usual" in plot)) Object.defineProperty(plot, "usual", { value: ticker });
    if (labels === null) {
      axis.ticker = plot.usual;
      axis.major_label_overrides = new Map();
    } else {
      axis.ticker = new Bokeh.Models.FixedTicker({ ticks: labels.map((_, k) => k), minor_ticks: [] });
      axis.major_label_overrides = new Map(labels.map((text, k) => [k, text]));
    }
  }

  // ------------------------------------------------------------------ taking things away

  function save(text, kind, name) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: kind }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
  // A color of marks as Bokeh writes it into a drawing: rgb(86,180,233).
  function channels(color) {
    return `rgb(${[1, 3, 5].map((k) => parseInt(color.slice(k, k + 2), 16)).join(",")})`;
  }
  // A drawing is light on any screen, and as wide as it is given room.
  function svg(name) {
    let text = views.get(name).export("svg", false).ctx.get_serialized_svg(true);
    for (const [light, other] of facts.colors) {
      text = text.replaceAll(other, light).replaceAll(channels(other), light);
    }
    return text.replace(/<svg([^>]*?) width="([0-9.]+)" height="([0-9.]+)"/,
      '<svg$1 width="$2" height="$3" viewBox="0 0 $2 $3"');
  }
  function csv(name) {
    const { source, columns } = facts.charts[name];
    const { data } = named(source);
    const keys = Object.keys(columns).filter((key) => key in data);
    const cell = (value) => {
      if (typeof value === "number") return Number.isFinite(value) ? String(value) : "";
      const text = value === null || value === undefined ? "" : String(value);
      return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
    };
    const rows = [keys.map((key) => cell(columns[key])).join(",")];
    const length = data[keys[0]].length;
    const nested = (key, k) => typeof data[key][k] === "object" && data[key][k] !== null;
    for (let k = 0; k < length; k += 1) {
      const deep = keys.filter((key) => nested(key, k));
      const times = deep.length > 0 ? data[deep[0]][k].length : 1;
      for (let j = 0; j < times; j += 1) {
        rows.push(keys.map((key) => cell(nested(key, k) ? data[key][k][j] : data[key][k])).join(","));
      }
    }
    return `${rows.join("\n")}\n`;
  }
  async function copy(button) {
    const rows = Array.from(byId(button.dataset.copy).rows, (row) =>
      Array.from(row.cells, (one) => one.textContent).join("\t"));
    const text = rows.join("\n");
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      const area = document.createElement("textarea");
      area.value = text;
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  }

  // ------------------------------------------------------------------ print: charts as drawings

  // As wide as it is on paper: its letters are then as large as the text.
  function printed(name) {
    const { model } = views.get(name);
    const row = byId(`figure-${name}`).closest(".row");
    const share = row === null ? 1 : row.children.length > 1 ? 0.48 : 0.8;
    const { sizing_mode, width, height } = model;
    model.setv({ sizing_mode: "fixed", width: Math.round(share * PAPER), height: Math.min(height, LOW) });
    const drawn = svg(name);
    model.setv({ sizing_mode, width, height });
    return drawn;
  }
  function toPrint() {
    for (const name of Object.keys(facts.charts)) byId(`print-${name}`).innerHTML = printed(name);
  }
  function fromPrint() {
    for (const name of Object.keys(facts.charts)) byId(`print-${name}`).replaceChildren();
  }

  // ------------------------------------------------------------------ the beginning

  function listen() {
    document.addEventListener("click", (event) => {
      const button = event.target.closest("button");
      if (button === null) return;
      const { svg: drawing, csv: values, copy: table, pick } = button.dataset;
      if (drawing !== undefined) save(svg(drawing), "image/svg+xml", `${drawing}.svg`);
      if (values !== undefined) save(csv(values), "text/csv", `${values}.csv`);
      if (table !== undefined) copy(button);
      if (pick !== undefined) mark(pick);
    });
    byId("previous").addEventListener("click", () => step(-1));
    byId("next").addEventListener("click", () => step(1));
    byId("clear").addEventListener("click", () => mark(null));
    byId("scheme").addEventListener("click", () => paint(scheme === "dark" ? "light" : "dark"));
    byId("marked").addEventListener("change", (event) => {
      const { value } = event.target;
      if (value === "" || listed().includes(value)) mark(value === "" ? null : value);
      else byId("status").textContent = `there is no experiment ${value}`;
    });
    document.addEventListener("keydown", (event) => { if (event.key === "Escape") mark(null); });
    for (const source of sources()) {
      source.selected.properties.indices.change.connect(() => {
        if (marking || source.data.id === undefined) return;
        const [first] = source.selected.indices;
        mark(first === undefined ? null : source.data.id[first]);
      });
    }
    for (const select of document.querySelectorAll("select[data-axis]")) {
      const names = select.dataset.axis.split(" ");
      facts.axes.forEach((axis, k) => {
        if (names.some((name) => name in axis.of)) select.add(new Option(axis.title, String(k)));
      });
      select.addEventListener("change", () => turn(select));
      // parameters are looked at over a condition, where there is one
      const options = Array.from(select.options, (option) => facts.axes[Number(option.value)]);
      const condition = options.findIndex((axis) => axis.of.individuals?.name);
      if (names.includes("individuals") && condition >= 0) select.selectedIndex = condition;
      turn(select);
    }
    dark.addEventListener("change", () => paint(dark.matches ? "dark" : "light"));
    addEventListener("beforeprint", toPrint);
    addEventListener("afterprint", fromPrint);
  }
  async function begin() {
    const items = [{ docid: "report", roots: facts.places, root_ids: Object.keys(facts.places) }];
    const managers = await Bokeh.embed.embed_items(facts.documents, items);
    models = Array.from(Bokeh.documents[0]._all_models.values());
    for (const view of managers.flatMap((manager) => manager.roots)) {
      const place = facts.places[view.model.id];
      if (place !== undefined) views.set(place.replace("plot-", ""), view);
    }
    listen();
    if (dark.matches) paint("dark");
    root.dataset.ready = "yes";
  }
  begin();
})();
