// Page of a live session: frames over a socket, controls, and messages.

class Live extends Page {
  async start() {
    this.past = []; // [time, values of traces, tip] of the last seconds
    this.plotted = -Infinity;
    this.time = Math.fround(this.time); // frames have that precision
    await super.start();
    this.connect();
  }

  play() {} // the session has the clock

  go() { this.show(true); }

  show(tell) {
    if (this.scene) this.scene.draw(this.time);
    this.charts.go(this.time, tell);
    if (tell) this.overlay();
  }

  // Frames arrive until the connection is lost; then it is tried again.
  connect() {
    const socket = this.socket = new WebSocket(location.href.replace(/^http/, "ws"));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => { this.lost = ""; };
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") { this.told(JSON.parse(data)); return; }
      requestAnimationFrame(() => {
        this.feed(new Float32Array(data));
        if (socket.readyState === WebSocket.OPEN) socket.send("seen");
      });
    };
    socket.onclose = ({ code }) => {
      this.lost ||= code === 1001 ? "The session has ended." : "The connection to the session is lost.";
      this.message(`${this.lost} This page connects again as soon as crinoid live runs at this address.`, true);
      setTimeout(() => this.connect(), 1000);
    };
  }

  send(name, value = null) {
    if (this.socket && this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ name, value }));
  }

  message(text, wrong) {
    const line = this.byId("message");
    line.textContent = text || this.said.kind;
    line.className = wrong ? "status" : text ? "status plain" : "sub";
  }

  // What the server says: its identity, a refusal, or the state of controls, numbers and message.
  told(said) {
    if (said.id) {
      if (said.id !== this.said.id) location.reload(); // another session
      return;
    }
    if (said.refused) { this.refused = [said.refused, performance.now()]; this.message(said.refused, true); return; }
    if (!this.refused || performance.now() - this.refused[1] > 5000) this.message(said.said, said.wrong);
    for (const [name, { take, parts }] of Object.entries(this.inputs)) {
      if (name in said.values) take(said.values[name]);
      for (const part of parts) part.disabled = said.off.includes(name);
    }
    if (!said.numbers) return;
    this.inputs.run.parts[0].textContent = said.run;
    this.inputs.record.parts[0].textContent = said.record;
    this.byId("now").replaceChildren(...Object.entries(said.numbers).map(([name, text]) => {
      const entry = document.createElement("span");
      make("span", "", entry, name);
      make("b", "", entry, text);
      return entry;
    }));
    const { time, speed, "tip error": error } = said.numbers;
    this.byId("clock").textContent = `${time} · tip error ${error}${speed === "paused" ? " · paused" : ""}`;
  }

  controls() {
    const groups = {}, place = (name) => {
      if (!name) return this.byId("bar");
      if (!groups[name]) make("legend", "", groups[name] = make("fieldset", "", this.byId("controls")), name);
      return groups[name];
    };
    this.byId("controls").addEventListener("submit", (event) => event.preventDefault());
    this.inputs = {};
    for (const said of this.said.controls) if (said.kind !== "target") this.inputs[said.name] = this.input(said, place(said.group));
    this.inputs.record.parts[0].classList.add("record");
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, select, button")) return;
      const keys = { " ": () => this.send("run"), "+": () => this.zoom(0.8), "-": () => this.zoom(1.25), 1: () => this.preset("side"), 2: () => this.preset("above"), 3: () => this.preset("ahead"), 4: () => this.preset("angle") };
      if (keys[event.key]) { keys[event.key](); event.preventDefault(); }
    });
  }

  // An input: its elements, and the function that shows a value of the server.
  input({ name, kind, label, hint, ends: [low, high], options }, parent) {
    const press = (text, value) => pressed(parent, text, hint, () => this.send(name, value));
    if (kind === "button") return { parts: [press(label, null)], take: () => {} };
    const row = make("label", kind, parent);
    row.title = hint;
    make("span", "", row, label);
    if (kind === "buttons") {
      const group = make("span", "group", row), made = options.map((each) => press(each, each));
      group.append(...made);
      return { parts: made, take: () => {} };
    }
    if (kind === "choice") {
      const select = listed(make("select", "", row), options.map((each) => [each, each]), null, (value) => this.send(name, value));
      return { parts: [select], take: (value) => { select.value = value; } };
    }
    const slider = make("input", "", row), shown = make("output", "", row);
    let changed = -Infinity;
    Object.assign(slider, { type: "range", min: low, max: high, step: "any" });
    const write = () => { shown.textContent = digits(Number(Number(slider.value).toPrecision(3))); };
    slider.addEventListener("input", () => {
      changed = performance.now();
      const step = (high - low) / 60;
      write();
      this.send(name, Math.min(high, Math.max(low, Number((Math.round(slider.value / step) * step).toPrecision(6)))));
    });
    return { parts: [slider], take: (value) => { if (performance.now() - changed > 600) { slider.value = value; write(); } } };
  }

  // Show the numbers of a frame: time, traces, pull, and those of `LiveScene.numbers`.
  feed(numbers) {
    let at = 0;
    const take = (count) => numbers.subarray(at, (at += count)), before = this.time, { scene } = this;
    const [time] = take(1), values = [...take(this.charts.panels.flatMap((panel) => panel.said.traces).length)], pull = [...take(3)];
    this.time = time;
    if (time < before || time - before > 5) this.past = []; // a reset, or a tab that was hidden
    if (this.past.length && this.past[this.past.length - 1][0] === time) this.past.pop();
    const tip = scene ? this.bend(take, time === 0 || time < before) : [];
    this.past.push([time, values, tip]);
    while (time - this.past[0][0] > this.end - this.begin) this.past.shift();
    if (scene) {
      scene.pull = V.size(pull) > 0 ? V.by(V.unit(pull), 0.3 * scene.length) : null;
      scene.members[0].time = this.past.map((each) => each[0]);
      scene.members[0].tips = Float32Array.from(this.past.flatMap((each) => each[2]));
    }
    const now = performance.now(), tell = now - this.plotted > 150;
    if (tell) this.plotted = now;
    if (tell) this.plot();
    this.show(tell);
    if (scene) this.widen(scene);
  }

  // Move the arm and all around it; return the place of the tip.
  bend(take, begins) {
    const { scene } = this, [arm, ghost] = scene.members, bodies = arm.bodies.flatMap((body) => [body.path, body.half]);
    const fields = scene.fields.map((field) => [field, arm.fields[field.name]]);
    for (const each of [arm.root, arm.offset, arm.target, arm.anchor, arm.ahead, arm.frame, arm.held, ...fields.map(([, values]) => values), ...bodies, ...(scene.water ? [scene.velocity] : [])]) each.values.set(take(each.row));
    if (begins) {
      for (const name of ["root", "offset"]) ghost[name].values.set(arm[name].values);
      for (const [field] of fields) field.high = 0;
      Object.assign(scene, { far: false, follow: "" });
    }
    for (const [field, { values }] of fields) {
      const top = values.reduce((most, value) => Math.max(most, Math.abs(value)), 1e-3), step = nice(top);
      if (top <= field.high) continue;
      field.high = [1, 2, 2.5].map((by) => by * step).find((end) => end >= top);
      field.low = field.signed ? -field.high : 0;
      scene.recolour();
    }
    for (let i = 0; scene.water && i < scene.velocity.row; i += 3) {
      scene.water.scale = Math.max(scene.water.scale, V.size(scene.velocity.values.slice(i, i + 3)) / (this.said.reach * scene.length));
    }
    const last = arm.offset.row - arm.axes.length, tip = [...arm.root.values];
    arm.axes.forEach((d, j) => { tip[d] += arm.offset.values[last + j]; });
    return tip;
  }

  // Widen the view to an arm that leaves it, and follow a base that travels far.
  widen(scene) {
    const [arm] = scene.members, { low, high, length } = scene, step = Math.max(1, Math.floor(arm.nodes / 20));
    let wider = false;
    if (!scene.far && V.size(V.sub(arm.now.root, scene.begun)) > TRAVELS * length) {
      Object.assign(scene, { far: true, follow: "root" });
      wider = true;
    }
    const drift = scene.drift();
    for (let i = arm.nodes - 1; i >= 0; i -= step) {
      const at = V.sub(arm.points.slice(3 * i, 3 * i + 3), drift), out = at.map((p, d) => (p < low[d] ? p - 0.1 * length : p > high[d] ? p + 0.1 * length : p));
      if (out.every((p, d) => p === at[d])) continue;
      out.forEach((p, d) => { low[d] = Math.min(low[d], p); high[d] = Math.max(high[d], p); });
      scene.cloud.push(out);
      wider = true;
    }
    if (wider) this.refit();
  }

  plot() {
    const t = this.past.map(([time]) => time);
    let column = 0;
    for (const { view, traces } of this.charts.panels) {
      if (!view) return;
      let low = Infinity, high = -Infinity;
      for (const trace of traces) {
        const v = this.past.map(([, values]) => values[column]);
        for (const value of v) { low = Math.min(low, value); high = Math.max(high, value); }
        trace.data_source.data = { t, v };
        column += 1;
      }
      const room = high - low > 1e-9 ? 0.06 * (high - low) : 0.1 * Math.abs(high) || 1;
      view.model.y_range.setv({ start: low - room, end: high + room });
      view.model.x_range.setv({ start: t[0], end: t[0] + this.end - this.begin });
    }
  }

  // The target is dragged in the plane of the arm, or of the picture.
  pointers() {
    const canvas = this.byId("scene");
    let held = null;
    const near = (event) => {
      const { scene } = this, { camera, drawn } = scene, box = canvas.getBoundingClientRect(), wide = box.width / drawn.parts;
      const { matrix: m } = camera.view(wide / box.height), target = scene.members[0].now.target;
      const [x, y, , w] = [0, 1, 2, 3].map((row) => m[row] * target[0] + m[4 + row] * target[1] + m[8 + row] * target[2] + m[12 + row]);
      const apart = Math.hypot(event.clientX - box.left - ((x / w + 1) * wide) / 2, event.clientY - box.top - ((1 - y / w) * box.height) / 2);
      const share = camera.flat ? 1 : w / (camera.half / Math.tan(0.24));
      return apart < 26 && { x: event.clientX, y: event.clientY, from: target, metres: (2 * camera.half * share) / box.height };
    };
    canvas.addEventListener("touchstart", (event) => near(event.touches[0]) && event.preventDefault(), { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      held = near(event) || null;
      if (!held) return;
      canvas.setPointerCapture(event.pointerId);
      event.stopImmediatePropagation();
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!held) { canvas.style.cursor = near(event) ? "move" : ""; return; }
      event.stopImmediatePropagation();
      const { across: a, up: u } = this.scene.camera.axes, x = (event.clientX - held.x) * held.metres, y = (held.y - event.clientY) * held.metres;
      const flat = a[0] * u[2] - a[2] * u[0], planar = !this.scene.spatial;
      if (planar && Math.abs(flat) < 0.1) return; // seen from its edge
      const way = planar ? [(x * u[2] - a[2] * y) / flat, 0, (a[0] * y - u[0] * x) / flat] : V.add(V.by(a, x), V.by(u, y));
      this.send("target", this.scene.members[0].axes.map((d) => held.from[d] + way[d]));
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { held = null; });
    super.pointers();
  }
}
