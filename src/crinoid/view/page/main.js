// Page of a run: playback, buttons, keys and pointers.

class Page {
  constructor(said) {
    this.said = said;
    [this.begin, this.end] = said.span;
    this.records = said.times;
    this.time = this.begin;
    this.playing = false;
    this.byId = (id) => document.getElementById(id);
    this.charts = new Charts(said, this.byId("charts"), (time) => { this.go(time); });
    const wanted = (this.end - this.begin) / 40;
    this.speed = wanted < 0.1 ? SPEEDS.find((s) => s >= (this.end - this.begin) / 10) || 1 : SPEEDS.find((s) => s >= Math.max(1, wanted)) || 1000;
    this.controls();
  }

  async start() {
    try {
      const bytes = await unpack(this.byId("numbers").textContent);
      this.scene = new Scene(this.said.scene, bytes, this.byId("scene"));
      this.byId("stage").classList.add("drawn");
      this.tools();
      this.pointers();
      this.preset(this.said.scene.spatial ? "angle" : "side");
    } catch (error) {
      this.still(error);
    }
    await this.charts.ready;
    const redo = () => {
      this.charts.recolour();
      if (this.scene) this.scene.recolour();
      this.show(true);
    };
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redo);
    addEventListener("beforeprint", redo);
    addEventListener("afterprint", redo);
    new ResizeObserver(() => this.show(true)).observe(this.byId("charts"));
    // an embedded frame can be laid out late
    const laidOut = new Promise((done) => {
      new ResizeObserver(([{ contentRect }]) => {
        if (contentRect.width && contentRect.height) done();
        this.show(true);
      }).observe(this.byId("stage"));
    });
    this.go(this.begin);
    setTimeout(() => this.show(true), 300); // once Bokeh has laid out
    if (this.scene && this.end > this.begin && !matchMedia("(prefers-reduced-motion: reduce)").matches) this.play(true);
    await laidOut;
    if (this.scene) this.refit();
    document.documentElement.dataset.ready = "yes";
  }

  // Without WebGL2 the still picture stays, and the charts have their cursor.
  still(error) {
    for (const id of ["scene", "hint", "clock"]) this.byId(id).hidden = true;
    const trouble = this.byId("trouble");
    trouble.hidden = false;
    trouble.textContent = `This browser cannot draw the animation (${error.message}); the picture shows the arm over time.`;
    this.scene = undefined;
  }

  go(time) {
    this.time = Math.min(this.end, Math.max(this.begin, time));
    this.show(true);
  }

  play(on) {
    if (on === this.playing || this.end <= this.begin) return;
    this.playing = on;
    this.byId("play").classList.toggle("playing", on);
    if (!on) { this.show(true); return; }
    if (this.time >= this.end) this.time = this.begin;
    let last = performance.now(), told = 0;
    const tick = (now) => {
      if (!this.playing) return;
      this.time += ((now - last) / 1000) * this.speed;
      last = now;
      if (this.time > this.end) this.time = this.begin + ((this.time - this.begin) % (this.end - this.begin));
      const tell = now - told > 90;
      if (tell) told = now;
      this.show(tell);
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  // Show the present time; numbers change less often than the picture.
  show(tell) {
    if (this.scene) this.scene.draw(this.time);
    this.charts.go(this.time, tell);
    this.byId("scrub").value = this.time;
    if (!tell) return;
    this.byId("clock").textContent = `${this.time.toFixed(this.end - this.begin < 5 ? 3 : 2)} s`;
    this.byId("scrub").setAttribute("aria-valuetext", `${this.time.toFixed(2)} seconds`);
    this.overlay();
  }

  step(by) {
    this.play(false);
    const { at, share } = locate(this.records, this.time);
    const next = by > 0 ? at + by : share > 1e-3 ? at + by + 1 : at + by;
    this.go(this.records[Math.min(this.records.length - 1, Math.max(0, next))]);
  }

  controls() {
    listed(this.byId("speed"), SPEEDS.map((speed) => [speed, `${speed} ×`]), this.speed, (value) => { this.speed = Number(value); });
    const scrub = this.byId("scrub");
    Object.assign(scrub, { min: this.begin, max: this.end, value: this.begin, disabled: this.end <= this.begin });
    scrub.addEventListener("input", () => { this.play(false); this.go(Number(scrub.value)); });
    this.byId("play").disabled = this.end <= this.begin;
    this.byId("play").addEventListener("click", () => this.play(!this.playing));
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, select, summary, pre")) return;
      const keys = {
        " ": () => !event.target.matches("button") && (this.play(!this.playing), true),
        ArrowRight: () => (this.step(event.shiftKey ? 10 : 1), true), ArrowLeft: () => (this.step(event.shiftKey ? -10 : -1), true),
        Home: () => event.target === this.byId("scene") && (this.go(this.begin), true), End: () => event.target === this.byId("scene") && (this.go(this.end), true),
        "+": () => this.zoom(0.8), "-": () => this.zoom(1.25), 1: () => this.preset("side"), 2: () => this.preset("above"), 3: () => this.preset("ahead"), 4: () => this.preset("angle"),
      };
      if (keys[event.key] && keys[event.key]()) event.preventDefault();
    });
    const copy = this.byId("copy"), save = this.byId("save");
    if (save) save.addEventListener("click", () => saved(new Blob([this.byId("toml").textContent], { type: "application/toml" }), "scenario.toml"));
    if (copy) copy.addEventListener("click", async () => {
      try { await navigator.clipboard.writeText(this.byId("toml").textContent); copy.textContent = "Copied"; } catch { getSelection().selectAllChildren(this.byId("toml")); copy.textContent = "Selected"; }
    });
  }

  tools() {
    const { threads } = this.scene.members[0], kinds = [...new Set(threads.map(({ kind }) => kind))];
    for (const kind of kinds) {
      const most = new Set(threads.filter((each) => each.kind === kind).map(({ largest }) => largest)), line = make("span", "drive", this.byId("hint"), "");
      make("i", "", line).style.background = `var(--${kind})`;
      line.append(`${kind}s, thickest at ${[...most].join(", ")}. `);
    }
    const bar = this.byId("tools"), group = (label) => { const g = make("span", "group", bar); g.setAttribute("role", "group"); g.setAttribute("aria-label", label); return g; };
    const views = group("View");
    this.views = Object.fromEntries([["side", "Side", 1], ["above", "Above", 2], ["ahead", "Ahead", 3], ["angle", "3-D", 4]].map(([name, text, key]) => [name, pressed(views, text, `See it ${name === "angle" ? "at an angle" : `from ${name === "side" ? "the side" : name}`} (${key})`, () => this.preset(name))]));
    const near = group("Zoom");
    pressed(near, "−", "Smaller (-)", () => this.zoom(1.25));
    pressed(near, "+", "Larger (+)", () => this.zoom(0.8));
    this.choice(bar, "Follow", [["", "nothing"], ["tip", "tip"], ["root", "base"]], this.scene.follow, (value) => { this.scene.follow = value; this.scene.followed = undefined; });
    if (this.scene.hulls.length) this.choice(bar, "Frame", [["arm", "arm"], ["all", "all"]], this.scene.framed, (value) => { this.scene.frame(value); this.preset(this.scene.camera.preset || "side"); });
    if (this.scene.fields.length) {
      const fields = this.scene.fields.map(({ name, label }) => [name, label]);
      this.choice(bar, "Colour", [...fields, ["", "plain"]], this.scene.colour, (value) => { this.scene.colour = value; this.scene.recolour(); });
    }
    if (this.scene.members.length > 1) this.choice(bar, this.said.ghost || "Without control", [["ghost", "ghost"], ["beside", "side by side"], ["none", "hidden"]], this.scene.other, (value) => { this.scene.other = value; this.refit(); });
  }

  choice(bar, label, options, chosen, act) {
    listed(make("select", "", make("label", "pick", bar, label)), options, chosen, (value) => { act(value); this.show(true); });
  }

  aspect() {
    const { canvas, other, members } = this.scene;
    return canvas.clientWidth / Math.max(1, canvas.clientHeight) / (other === "beside" && members.length > 1 ? 2 : 1);
  }

  preset(name) {
    if (!this.scene) return false;
    this.scene.look(name, this.aspect());
    this.marked();
    return true;
  }

  refit() {
    const { preset } = this.scene.camera;
    if (preset) this.preset(preset);
  }

  marked() {
    for (const [name, button] of Object.entries(this.views)) button.setAttribute("aria-pressed", String(name === this.scene.camera.preset));
    this.show(true);
  }

  zoom(by) {
    if (!this.scene) return false;
    this.scene.camera.zoom(by);
    this.show(true);
    return true;
  }

  pointers() {
    const canvas = this.byId("scene"), down = new Map();
    let apart = 0;
    const spread = () => { const [a, b] = [...down.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      down.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (down.size === 2) apart = spread();
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = down.get(event.pointerId);
      if (!before) return;
      const right = event.clientX - before.x, up = event.clientY - before.y, { camera } = this.scene, half = canvas.clientHeight / 2;
      down.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (down.size === 2) {
        const now = spread();
        if (apart > 0 && now > 0) camera.zoom(apart / now);
        apart = now;
        camera.move(right / half / 2, -up / half / 2);
      } else if (event.shiftKey || event.buttons & 2) camera.move(right / half, -up / half);
      else camera.turn(right * 0.4, up * 0.4);
      this.marked();
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => down.delete(event.pointerId));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey && document.activeElement !== canvas) return;
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY / 600));
    }, { passive: false });
    canvas.addEventListener("webglcontextlost", () => { this.byId("stage").classList.remove("drawn"); this.play(false); this.still(new Error("the graphics were lost")); });
  }

  // Overlay of the picture: a scale, the colours, and the names of the arms.
  overlay() {
    const { scene } = this;
    if (!scene || !scene.drawn) return;
    const pixels = scene.canvas.clientHeight / (2 * scene.camera.half), long = nice(90 / pixels), scale = this.byId("scale");
    scale.hidden = false;
    scale.firstElementChild.style.width = `${long * pixels}px`;
    scale.lastElementChild.textContent = long >= 1 ? `${long} m` : long >= 0.01 ? `${+(100 * long).toPrecision(2)} cm` : `${+(1000 * long).toPrecision(2)} mm`;
    const { water } = scene, speed = this.byId("speeds");
    speed.hidden = !water;
    if (water) { // an arrow of a round speed
      const fast = nice((90 / pixels) * water.scale);
      speed.firstElementChild.style.width = `${(fast / water.scale) * pixels}px`;
      speed.lastElementChild.textContent = `water ${+fast.toPrecision(2)} m/s`;
    }
    const field = scene.fields.find((each) => each.name === scene.colour), legend = this.byId("legend");
    legend.hidden = !field;
    if (field) {
      legend.querySelector(".name").textContent = `${field.label} (${field.unit})`;
      const [low, high] = legend.querySelectorAll("b");
      low.textContent = digits(Number(field.low.toPrecision(3)));
      high.textContent = digits(Number(field.high.toPrecision(3)));
      const stops = RAMPS[field.signed && field.low < 0 ? "two" : "one"];
      legend.querySelector("i").style.background = `linear-gradient(90deg, ${stops.join(",")})`;
    }
    const names = this.byId("names"), many = scene.members.length > 1 && scene.other !== "none";
    names.hidden = !many;
    const state = `${many} ${scene.drawn.parts}`;
    if (names.dataset.state === state) return;
    names.dataset.state = state;
    names.replaceChildren();
    names.classList.toggle("key", scene.drawn.parts === 1);
    scene.members.forEach((member, i) => {
      const entry = make("span", "", names);
      if (scene.drawn.parts === 1) make("i", "", entry).style.background = i ? "var(--free)" : "var(--run)";
      entry.append(member.label);
    });
  }
}
