// Page of a study: a table of its cases, and their measures over the varied keys.

const ROWS = 200; // of the table, until a click shows all
const MEASURES = 8; // columns of the table, until a click shows all
const NEAR = 18; // distance in pixels within which a point is selected

const withUnit = ({ label, unit }) => (unit ? `${label} (${unit})` : label);

class StudyPage {
  constructor(said) {
    Object.assign(this, said);
    this.byId = (id) => document.getElementById(id);
    this.order = { column: 0, down: false };
    this.most = ROWS;
    this.measure = this.measures[0];
    this.lines = [...document.querySelectorAll(".finals [data-case]")];
    this.columns = [
      { label: "case", of: (i) => this.names[i], title: "" },
      ...this.keys.map((key) => ({ label: key.short, title: key.name, of: (i) => (key.numbers ? key.numbers[key.level[i]] : key.levels[key.level[i]]), text: (i) => this.level(key, i) })),
      ...this.measures.map((each) => ({ label: withUnit(each), title: "", measure: each, of: (i) => each.values[i], text: (i) => digits(each.values[i] ?? NaN) })),
      ...(this.status.some((each) => each !== "ok") ? [{ label: "status", title: "", of: (i) => this.status[i] }] : []),
    ];
  }

  async start() {
    this.choices();
    this.arms();
    this.pointers();
    if (this.views.length) await this.see(this.views[0]); else this.byId("choose").hidden = this.byId("plot").hidden = true;
    this.colour();
    this.table();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.colour());
    this.byId("only").lastElementChild.addEventListener("click", () => this.filter());
    this.byId("columns").lastElementChild.addEventListener("click", () => { this.whole = true; this.table(); });
    this.byId("more").lastElementChild.addEventListener("click", () => { this.most = Infinity; this.table(); });
    document.documentElement.dataset.ready = "yes";
  }

  choices() {
    const fill = (id, names, act) => listed(this.byId(id), names.entries(), 0, (i) => act(Number(i)));
    fill("measure", this.measures.map((each) => each.label), (i) => { this.measure = this.measures[i]; this.colour(); this.table(); });
    fill("over", this.views.map(({ keys }) => keys.map((k) => this.keys[k].short).join(" × ")), (i) => this.see(this.views[i]).then(() => this.colour()));
    if (!this.measures.length) this.byId("measure").parentElement.hidden = this.byId("legend").hidden = true;
  }

  // Draw a view; earlier ones are kept in memory.
  async see(view) {
    if (!view.box) {
      view.box = make("div", "", this.byId("plot"));
      view.box.id = `plot-${view.root}`;
      const item = { docid: "study", roots: { [view.root]: view.box.id }, root_ids: [view.root] };
      const [views] = await Bokeh.embed.embed_items({ study: view.document }, [item]);
      view.drawn = views.get_by_id ? views.get_by_id(view.root) : [...views][0];
    }
    this.view = view;
    for (const each of this.views) if (each.box) each.box.hidden = each !== view;
    const [across, up] = view.keys.map((k) => this.keys[k].label);
    this.byId("across").textContent = across;
    this.byId("up").dataset.key = up || "";
    this.point();
  }

  get ends() {
    const known = this.measure.values.filter((value) => value !== null);
    return [known.reduce((a, b) => Math.min(a, b)), known.reduce((a, b) => Math.max(a, b))];
  }

  // Colour everything by the shown measure.
  colour() {
    const { view, measure } = this;
    if (!measure) return;
    const [low, high] = this.ends, style = getComputedStyle(document.documentElement), read = (name) => style.getPropertyValue(`--${name}`).trim();
    const share = (value) => (high > low ? (value - low) / (high - low) : 0.5);
    const tone = (value) => (Number.isFinite(value) ? mixed(RAMPS.one, share(value)) : read("grid"));
    for (const line of this.lines) {
      const value = measure.values[line.dataset.case];
      line.style.stroke = value === null ? read("faint") : tone(value);
    }
    this.byId("coloured").textContent = measure.label;
    const legend = this.byId("legend"), [from, to] = legend.querySelectorAll("b");
    legend.querySelector("i").style.background = `linear-gradient(90deg, ${RAMPS.one.join(",")})`;
    [from.textContent, to.textContent] = [`${digits(low)}`, `${digits(high)} ${measure.unit}`];
    this.effects();
    this.extremes();
    if (!view) return;
    const { model } = view.drawn;
    dress(model, read);
    if (view.kind === "lines") {
      const [start, end] = view.ends[measure.name];
      model.y_range.setv({ start, end });
    }
    this.byId("up").textContent = view.kind === "lines" ? withUnit(measure) : this.byId("up").dataset.key;
    for (const { name, glyph, data_source: source } of model.renderers) {
      const data = { ...source.data }, values = name === "points" ? measure.values.map((value) => value ?? NaN) : [...data[measure.name]];
      data.v = Float64Array.from(values);
      data.fill = values.map(tone);
      const half = data[`${measure.name} half`] || [], short = (value) => Number(value.toPrecision(3)).toString();
      const most = view.box.clientWidth / new Set(data.x).size / 8; // letters in a cell
      const whole = (value, i) => short(value) + (half[i] > 0 ? ` ± ${Number(half[i].toPrecision(2))}` : "");
      data.text = values.map((value, i) => (!Number.isFinite(value) ? "–" : whole(value, i).length > most ? short(value) : whole(value, i)));
      data.tone = values.map((value) => (!Number.isFinite(value) ? read("soft") : share(value) > 0.55 ? "#14201f" : "#ffffff"));
      if ("low" in data) [data.low, data.high] = [data[`${measure.name} low`], data[`${measure.name} high`]];
      source.data = data;
      if (name === "cells") glyph.line_color = read("paper");
      if (name === "line") glyph.line_color = read("soft");
      if (name === "band" || name === "means") glyph.fill_color = read("soft");
    }
  }

  // The text of a key in a case; a number has six digits at most.
  level({ levels, level, numbers }, i) {
    const text = levels[level[i]];
    return numbers ? String(Number(Number(text).toPrecision(6))) : text;
  }

  // Shares of the variance of the measure.
  effects() {
    const box = this.byId("effects"), table = box.querySelector("table"), { effects } = this.measure;
    box.hidden = !effects.length;
    table.replaceChildren();
    this.byId("totals").hidden = !effects.some(({ total }) => total !== undefined);
    for (const { key, share, low, high, total, within } of effects) {
      const row = make("tr", "", table), percent = (value) => `${(100 * value).toFixed(0)} %`.replace("-", "−");
      make("td", "", row, this.keys[key].short).title = this.keys[key].name;
      const bar = make("div", "bar-of", make("td", "wide", row));
      const inside = (value) => 100 * Math.max(0, Math.min(1, value));
      if (total !== undefined) make("i", "total", bar).style.width = `${inside(total)}%`;
      make("i", "", bar).style.width = `${inside(share)}%`;
      Object.assign(make("b", "", bar).style, { left: `${inside(low)}%`, width: `${inside(high) - inside(low)}%` });
      make("td", "", row, percent(share));
      make("td", "range", row, `${percent(low)} to ${percent(high)}`);
      if (total !== undefined) make("td", "", row, `${percent(total)} ± ${percent(within)}`);
    }
  }

  // Name the cases with the smallest and the largest value of the measure.
  extremes() {
    const { values } = this.measure, box = this.byId("extremes");
    box.replaceChildren();
    this.ends.forEach((value, at) => {
      const i = values.indexOf(value);
      box.append(at ? "Largest: " : "Smallest: ");
      if (this.pages[i]) make("a", "", box, this.names[i]).href = this.pages[i]; else box.append(this.names[i]);
      box.append(`${this.told([i]).slice(this.names[i].length)}.${at ? "" : " "}`);
    });
  }

  arms() {
    for (const line of this.lines) {
      const i = Number(line.dataset.case);
      line.addEventListener("pointerenter", () => this.point([i]));
      line.addEventListener("pointerleave", () => this.point());
      line.addEventListener("click", () => this.open([i]));
    }
  }

  // Cases under a pointer: those of a cell, or the nearest point.
  at(event) {
    const { view } = this, { frame } = view.drawn, box = this.byId("plot").getBoundingClientRect();
    const x = event.clientX - box.left, y = event.clientY - box.top, all = this.names.keys();
    if (view.kind === "cells") {
      const [a, b] = [frame.x_scale.invert(x), frame.y_scale.invert(y)].map(Math.round), [k, l] = view.keys.map((key) => this.keys[key].level);
      return [...all].filter((i) => k[i] === a && l[i] === b);
    }
    let found, least = NEAR;
    for (const i of all) {
      const [p, q] = this.where(i), far = Math.hypot(p - x, q - y);
      if (far < least) [found, least] = [i, far];
    }
    return found === undefined ? [] : [found];
  }

  // Position of a case in the chart, in pixels.
  where(i) {
    const { view, measure } = this, { frame } = view.drawn;
    const on = view.keys.map((k) => { const { numbers, level } = this.keys[k]; return numbers && view.kind !== "cells" ? numbers[level[i]] : level[i]; });
    if (view.kind === "lines") on.push(measure.values[i] ?? NaN);
    return [frame.x_scale.compute(on[0]), frame.y_scale.compute(on[1])];
  }

  pointers() {
    const plot = this.byId("plot");
    plot.addEventListener("pointermove", (event) => this.view && this.point(this.at(event)), true);
    plot.addEventListener("pointerleave", () => this.point());
    plot.addEventListener("click", (event) => this.view && this.open(this.at(event)), true);
  }

  // Name the selected cases, and mark them everywhere.
  point(cases = []) {
    const some = new Set(cases), ring = this.byId("ring");
    for (const line of this.lines) line.classList.toggle("on", some.has(Number(line.dataset.case)));
    this.byId("arms").classList.toggle("chosen", some.size > 0);
    for (const row of this.byId("cases").querySelectorAll("tbody tr")) row.classList.toggle("on", some.has(Number(row.dataset.case)));
    const one = cases.length && this.view ? this.where(cases[0]) : [];
    ring.hidden = !one.every(Number.isFinite) || !one.length;
    if (!ring.hidden) ring.style.transform = `translate(${one[0]}px, ${one[1]}px)`;
    this.byId("said").textContent = cases.length ? this.told(cases) : "";
  }

  told(cases) {
    const { measure } = this;
    const shared = this.keys.filter((key) => new Set(cases.map((i) => key.level[i])).size === 1).map((key) => `${key.short} ${this.level(key, cases[0])}`);
    const known = measure ? cases.map((i) => measure.values[i]).filter((value) => value !== null) : [];
    const mean = known.length ? `${measure.label} ${digits(known.reduce((a, b) => a + b) / known.length)} ${measure.unit}` : `${measure ? measure.label : "measures"} unknown`;
    if (cases.length > 1) return `${cases.length} cases · ${[...shared, `mean ${mean}`].join(" · ")}`;
    const status = this.status[cases[0]];
    return [this.names[cases[0]], ...shared, mean, ...(status === "ok" ? [] : [status])].join(" · ");
  }

  open(cases) {
    const page = cases.length === 1 && this.pages[cases[0]];
    if (page) location.href = page; else if (cases.length) this.filter(cases);
  }

  filter(cases) {
    this.some = cases;
    this.table();
    if (cases) this.byId("heading").scrollIntoView({ block: "start" });
  }

  hides({ measure }) {
    return measure && !this.whole && measure !== this.measure && this.measures.indexOf(measure) >= MEASURES;
  }

  sorted() {
    const { of } = this.columns[this.order.column], sign = this.order.down ? -1 : 1, cases = this.some ? [...this.some] : [...this.names.keys()];
    const lacks = (value) => value === null || value === undefined;
    return cases.sort((i, j) => {
      const [a, b] = [of(i), of(j)];
      if (lacks(a) || lacks(b)) return lacks(a) - lacks(b) || i - j;
      return (typeof a === "number" ? sign * (a - b) : sign * a.localeCompare(b, "en", { numeric: true })) || i - j;
    });
  }

  table() {
    const root = this.byId("cases"), order = this.sorted(), focused = document.activeElement && document.activeElement.dataset.column;
    root.replaceChildren();
    const heads = make("tr", "", make("thead", "", root));
    this.columns.forEach((column, at) => {
      if (this.hides(column)) return;
      const head = make("th", "", heads), chosen = this.order.column === at;
      head.scope = "col";
      head.ariaSort = chosen ? (this.order.down ? "descending" : "ascending") : "none";
      const button = pressed(head, column.label, column.title, () => { this.order = { column: at, down: chosen && !this.order.down }; this.table(); });
      button.dataset.column = at;
      if (focused === String(at)) button.focus();
    });
    const body = make("tbody", "", root);
    for (const i of order.slice(0, this.most)) this.row(i, body);
    const only = this.byId("only"), more = this.byId("more"), columns = this.byId("columns"), hidden = this.columns.filter((column) => this.hides(column)).length;
    columns.hidden = !hidden;
    columns.firstElementChild.textContent = `${this.measures.length - hidden} of ${this.measures.length} measures are shown.`;
    only.hidden = !this.some;
    if (this.some) only.firstElementChild.textContent = this.told(this.some);
    more.hidden = order.length <= this.most;
    more.firstElementChild.textContent = `${this.most} of ${order.length} rows are shown.`;
  }

  row(i, body) {
    const row = make("tr", this.status[i] === "ok" ? "" : "bad", body);
    row.dataset.case = i;
    this.columns.forEach((column, at) => {
      if (this.hides(column)) return;
      const cell = make("td", column.measure && column.measure === this.measure ? "shown" : "", row), text = column.text ? column.text(i) : column.of(i);
      if (at || !this.pages[i]) { cell.textContent = text; return; }
      make("a", "", cell, text).href = this.pages[i];
    });
    row.addEventListener("pointerenter", () => this.point([i]));
    row.addEventListener("pointerleave", () => this.point());
    if (this.pages[i]) row.addEventListener("click", (event) => { if (!event.target.closest("a") && !getSelection().toString()) location.href = this.pages[i]; });
  }
}

globalThis.crinoid = new StudyPage(JSON.parse(document.getElementById("table").textContent));
globalThis.crinoid.start();
