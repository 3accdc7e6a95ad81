// Charts, drawn by Bokeh, with a cursor and the values at it.

class Charts {
  constructor(said, root, seek) {
    this.panels = [];
    this.seek = seek;
    for (const chart of said.charts) {
      const section = make(chart.folded ? "details" : "section", "chart", root);
      make(chart.folded ? "summary" : "h2", "", section, chart.title);
      section.open = true; // until Bokeh has measured its place
      for (const panel of chart.panels) this.add(panel, section);
    }
    this.ready = this.draw(said.document);
    this.span = said.span;
  }

  add(said, section) {
    const box = make("div", "panel", section), head = make("header", "", box);
    make("span", "label", head, said.unit ? `${said.label} (${said.unit})` : said.label);
    const save = make("span", "save", head);
    pressed(save, "CSV", "Save the numbers of this chart", () => saved(new Blob([csvOf(panel)], { type: "text/csv" }), `${said.name}.csv`));
    pressed(save, "PNG", "Save a picture of this chart", async () => saved(await pictureOf(panel), `${said.name}.png`));
    const count = said.traces.length + said.rows.length, key = make("span", count > 2 ? "key many" : count > 1 ? "key" : "key one", head);
    const entries = [...said.traces, ...said.rows].map((trace) => {
      const filled = trace.line === "filled"; // one word for all of them
      const entry = make("span", "entry", filled ? new DocumentFragment() : key), fainter = trace.behind && !/^(run|free)$/.test(trace.role);
      const mark = make("i", fainter && trace.line === "solid" ? "dashed" : trace.line === "solid" || !trace.line ? "" : trace.line, entry);
      if (said.traces.length > 1 || said.rows.length) make("span", "", entry, trace.name);
      return { ...trace, mark, told: make("b", "", entry, "") };
    });
    const words = [...said.traces.filter((t) => t.told).map((t) => (said.traces.length > 1 ? `${t.name}: ${t.told}` : t.told)), ...said.also, said.left_out].filter(Boolean);
    if (words.length) make("div", "told", box, words.join(" · "));
    const plot = make("div", "plot", box), place = make("div", "", plot), cursor = make("div", "cursor", plot);
    place.id = `plot-${said.root}`;
    if (said.nothing) make("div", "nothing", plot, said.nothing);
    const panel = { said, entries, plot, place, cursor };
    if (said.timed) this.listen(panel);
    this.panels.push(panel);
  }

  async draw(doc) {
    if (!this.panels.length) return; // a scene by itself, without Bokeh
    const roots = Object.fromEntries(this.panels.map((panel) => [panel.said.root, panel.place.id]));
    const item = { docid: "run", roots, root_ids: Object.keys(roots) };
    const [views] = await Bokeh.embed.embed_items({ run: doc }, [item]);
    for (const panel of this.panels) {
      panel.view = views.get_by_id ? views.get_by_id(panel.said.root) : [...views].find((view) => view.model.id === panel.said.root);
      const named = (name) => panel.view.model.renderers.find((each) => each.name === name);
      panel.traces = panel.said.traces.map((_, i) => named(`trace ${i}`));
      panel.rows = panel.said.rows.map((_, i) => named(`row ${i}`));
    }
    this.recolour();
    for (const folded of document.querySelectorAll("details.chart")) {
      folded.open = false;
      folded.addEventListener("toggle", () => { // the page may be wider now
        for (const { view, plot } of this.panels) if (folded.contains(plot)) view.invalidate_layout();
        setTimeout(() => this.go(this.time, true), 100);
      });
    }
  }

  recolour() {
    const style = getComputedStyle(document.documentElement), read = (name) => style.getPropertyValue(`--${name}`).trim();
    const tone = (role) => {
      const [kind, which] = role.split(" ");
      if (kind === "series") return read(`s${which % 8}`);
      if (kind === "part") return mixed(RAMPS.one, 0.05 + 0.8 * which);
      return read(role);
    };
    for (const { view, traces, rows, entries } of this.panels) {
      const { model } = view;
      dress(model, read);
      for (const line of model.center) {
        if ("location" in line) Object.assign(line, { line_color: tone(line.name || "faint"), line_width: 1, line_alpha: line.name === "faint" ? 0.8 : 0.7 });
      }
      [...traces, ...rows].forEach((renderer, i) => {
        const colour = tone(entries[i].role), { glyph } = renderer;
        entries[i].mark.style.borderTopColor = colour;
        if ("line_color" in glyph && !rows.length) glyph.line_color = colour;
        if ("fill_color" in glyph) glyph.fill_color = colour;
      });
    }
  }

  // The time under a pointer, by the scale of the plot.
  at(panel, event) {
    const frame = panel.view.frame, left = panel.plot.getBoundingClientRect().left;
    return frame.x_scale.invert(event.clientX - left);
  }

  listen(panel) {
    let held = false;
    const go = (event) => panel.view && this.seek(this.at(panel, event));
    panel.plot.addEventListener("pointerdown", (event) => {
      held = event.button === 0;
      if (held) { panel.plot.setPointerCapture(event.pointerId); go(event); }
    }, true);
    panel.plot.addEventListener("pointermove", (event) => held && go(event), true);
    for (const name of ["pointerup", "pointercancel"]) panel.plot.addEventListener(name, () => { held = false; }, true);
    panel.plot.addEventListener("dblclick", () => this.zoom(panel, 0, 0));
    panel.plot.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      this.zoom(panel, Math.exp(event.deltaY / 300), this.at(panel, event));
    }, { passive: false });
  }

  // All charts share their time; a zoom by nothing shows all of it.
  zoom(panel, by, about) {
    const range = panel.view.model.x_range, [begin, end] = this.span;
    const start = by ? Math.max(begin, about + (range.start - about) * by) : begin;
    const stop = by ? Math.min(end, about + (range.end - about) * by) : end;
    if (stop - start > 1e-9 * (end - begin)) range.setv({ start, end: stop });
    this.go(this.time, true);
  }

  // Move the cursor, and show the values at it.
  go(time, tell) {
    this.time = time;
    for (const { view, cursor, traces, rows, entries, said } of this.panels) {
      if (!view || !view.frame || !said.timed) continue;
      const { frame } = view, { left, right, top, height } = frame.bbox, x = frame.x_scale.compute(time);
      const seen = x >= left - 0.5 && x <= right + 0.5;
      cursor.style.cssText = seen ? `display:block;top:${top}px;height:${height}px;transform:translateX(${x}px)` : "";
      if (!tell) continue;
      const { start, end } = view.model.y_range, noise = 1e-9 * Math.abs(end - start); // below it is round-off
      traces.forEach((trace, i) => {
        const value = valueAt(trace.data_source.data, time, entries[i].line);
        entries[i].told.textContent = digits(Math.abs(value) < noise ? 0 : value);
      });
      rows.forEach((row, i) => {
        const { left: begins, right: ends } = row.data_source.data;
        entries[i].told.textContent = [...begins].some((begin, j) => begin <= time && time <= ends[j]) ? "yes" : "no";
      });
    }
  }
}

// The value at the saved instant nearest to a time.
function valueAt({ t, v }, time, line) {
  const { at, share } = locate(t, time);
  return v[line !== "filled" && share > 0.5 ? at + 1 : at];
}

function saved(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// The numbers of a panel: traces of the same instants follow one column of these.
function csvOf({ said, traces, rows, entries }) {
  const quoted = (text) => `"${text.replaceAll('"', '""')}"`, unit = said.unit ? ` (${said.unit})` : "", columns = [];
  rows.forEach(({ data_source: { data } }, i) => {
    for (const [end, word] of [["left", "begin"], ["right", "end"]]) columns.push([`${entries[i].name}, ${word} (s)`, data[end]]);
  });
  let before;
  traces.forEach(({ data_source: { data } }, i) => {
    if (!before || data.t.length !== before.length || data.t.some((t, j) => t !== before[j])) columns.push([said.timed ? "time (s)" : "frequency (Hz)", data.t]);
    before = data.t;
    columns.push([`${entries[i].name}${unit}`, data.v]);
  });
  const lines = Array.from({ length: Math.max(...columns.map(([, values]) => values.length)) }, (_, j) => columns.map(([, values]) => (j < values.length && Number.isFinite(values[j]) ? Number(values[j].toPrecision(7)) : "")).join(","));
  return [columns.map(([name]) => quoted(name)).join(","), ...lines, ""].join("\r\n");
}

const FINE = 3; // pixels of a picture for each on the screen
const LINE_HEIGHT = 17;
const KEY_WIDTH = 200;

// A picture of a panel with its label, its key and its lower axis, which the page shows once for several panels.
async function pictureOf({ said, view, entries }) {
  const { model } = view, [axis] = model.below, { visible } = axis, { height: tall, min_border_bottom: room } = model;
  const lay = async (shown, by) => {
    axis.visible = shown;
    model.setv({ height: tall + by, min_border_bottom: room + by });
    await new Promise((done) => { setTimeout(done, 100); });
  };
  if (!visible) await lay(true, 18);
  const image = new Image(), { width, height } = view.bbox, drawing = URL.createObjectURL(await view.export("svg").to_blob());
  if (!visible) await lay(false, 0);
  image.src = drawing;
  await image.decode();
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), style = getComputedStyle(document.body);
  const named = entries.filter(({ mark }) => mark.isConnected && entries.length > 1), columns = Math.max(1, Math.floor(width / KEY_WIDTH));
  const head = LINE_HEIGHT * (1 + Math.ceil(named.length / columns)) + 4;
  Object.assign(canvas, { width: FINE * width, height: FINE * (head + height) });
  pen.scale(FINE, FINE);
  Object.assign(pen, { fillStyle: style.backgroundColor, font: `12px ${style.fontFamily}`, textBaseline: "middle", lineWidth: 2 });
  pen.fillRect(0, 0, width, head + height);
  pen.fillStyle = style.color;
  pen.fillText(`${said.unit ? `${said.label} (${said.unit})` : said.label} over ${said.timed ? "time (s)" : "frequency (Hz)"}`, 4, LINE_HEIGHT / 2 + 2);
  named.forEach(({ name, mark }, i) => {
    const left = KEY_WIDTH * (i % columns), middle = LINE_HEIGHT * (1.5 + Math.floor(i / columns));
    pen.strokeStyle = mark.style.borderTopColor;
    pen.setLineDash(mark.className === "dashed" ? [5, 3] : []);
    pen.stroke(new Path2D(`M${left + 4} ${middle} h18`));
    pen.fillText(name, left + 28, middle, KEY_WIDTH - 36); // a long name is narrower
  });
  pen.drawImage(image, 0, head, width, height);
  URL.revokeObjectURL(drawing);
  return new Promise((done) => { canvas.toBlob(done); });
}
