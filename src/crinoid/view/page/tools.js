// Tools of all pages: colours, numbers as text, elements.

const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);

function digits(value) {
  if (!Number.isFinite(value)) return "–";
  const text = Math.abs(value) >= 1e5 ? value.toExponential(3) : Number(value.toPrecision(4)).toString();
  return text.replaceAll("-", "−");
}

// The colour at a share of a scale; a share beyond 0 and 1, as by round-off, has that of the end.
function blend(stops, share) {
  const place = Math.min(1, Math.max(0, share)) * (stops.length - 1), i = Math.min(stops.length - 2, Math.floor(place)), a = rgb(stops[i]), b = rgb(stops[i + 1]);
  return a.map((p, d) => 255 * (p + (place - i) * (b[d] - p)));
}

const mixed = (stops, share) => `rgb(${blend(stops, share).map(Math.round).join(",")})`;

function make(kind, name, parent, text) {
  const found = document.createElement(kind);
  if (name) found.className = name;
  if (text !== undefined) found.textContent = text;
  parent.append(found);
  return found;
}

// A button that acts when it is pressed.
function pressed(parent, text, title, act) {
  return Object.assign(make("button", "", parent, text), { type: "button", title, onclick: act });
}

// Fill a list with values and their texts; `act` hears which one is chosen later.
function listed(select, options, chosen, act) {
  for (const [value, text] of options) Object.assign(make("option", "", select, text), { value, selected: value === chosen });
  select.addEventListener("change", () => act(select.value));
  return select;
}

// Set the colours of axes and grid of a Bokeh plot.
function dress(model, read) {
  const [soft, grid] = ["soft", "grid"].map(read);
  model.outline_line_color = null;
  for (const axis of [...model.below, ...model.left]) {
    if (!axis.major_label_text_color && axis.major_label_text_color !== null) continue;
    Object.assign(axis, { major_label_text_color: soft, axis_line_color: grid, major_tick_line_color: grid, minor_tick_line_color: null, major_label_text_font_size: "11px", major_label_text_font: getComputedStyle(document.body).fontFamily });
  }
  for (const line of model.center) if ("grid_line_color" in line) line.grid_line_color = grid;
}
