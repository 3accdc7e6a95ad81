// Scene of a run: the arm, its mount, target, obstacles, and the water.

class Member {
  constructor(said, bytes, spatial) {
    Object.assign(this, said);
    for (const name of ["root", "offset", "target", "anchor", "ahead", "frame", "held"]) this[name] = numbers(bytes, said[name]);
    this.fields = Object.fromEntries(Object.entries(said.fields).map(([name, where]) => [name, numbers(bytes, where)]));
    this.threads = said.threads.map((thread) => ({ ...thread, share: numbers(bytes, thread.share) }));
    this.director = said.director && numbers(bytes, said.director);
    this.bodies = said.bodies.map((body) => ({ ...body, path: numbers(bytes, body.path), half: numbers(bytes, body.half), solid: body.points && solid(numbers(bytes, body.points).values, numbers(bytes, body.facets).values) }));
    this.axes = spatial ? [0, 1, 2] : [0, 2];
    this.points = new Float32Array(3 * this.nodes);
    this.flat = new Float32Array(this.offset.row);
    this.shade = new Float32Array(this.nodes);
    this.tips = Float32Array.from({ length: 3 * this.time.length }, (_, i) => {
      const at = Math.floor(i / 3), axis = this.axes.indexOf(i % 3), last = this.offset.row - this.axes.length;
      return this.root.values[i] + (axis < 0 ? 0 : this.offset.values[at * this.offset.row + last + axis]);
    });
  }

  go(time) {
    const { at, share } = locate(this.time, time), read = (some, n = some.row) => between(some, at, share, new Float32Array(n));
    const root = read(this.root);
    between(this.offset, at, share, this.flat);
    const wide = this.axes.length;
    for (let i = 0; i < this.nodes; i++) {
      for (let d = 0; d < 3; d++) this.points[3 * i + d] = root[d];
      this.axes.forEach((d, j) => { this.points[3 * i + d] += this.flat[wide * i + j]; });
    }
    const frame = read(this.frame), column = (i) => [frame[i], frame[3 + i], frame[6 + i]];
    this.now = {
      at, share, root: [...root], target: [...read(this.target)], anchor: [...read(this.anchor)],
      ahead: V.unit(read(this.ahead)), frame: [0, 1, 2].map(column), held: this.held.values[this.held.rows === 1 ? 0 : at] > 0.5,
      tip: [0, 1, 2].map((d) => this.points[3 * this.nodes - 3 + d]),
      shares: this.threads.map((thread) => read(thread.share)[0]), director: this.director && read(this.director),
      bodies: this.bodies.map((body) => [body.path, body.half].map((each) => [...between(each, at, share, new Float32Array(3))])),
    };
  }
}

class Scene {
  constructor(said, bytes, canvas) {
    Object.assign(this, said);
    this.members = said.members.map((member) => new Member(member, bytes, said.spatial));
    this.velocity = said.water && numbers(bytes, said.water.velocity);
    this.paint = new Painter(canvas);
    this.canvas = canvas;
    this.arms = this.members.map((member) => this.paint.arm(member.nodes));
    this.colour = said.fields.length ? said.fields[0].name : "";
    this.other = this.members.length > 1 ? "ghost" : "none";
    this.window();
    this.camera = new Camera(this.low, this.high, this.cloud);
    this.frame(this.hulls.length && this.members[0].sizes.hull[0] < 0.5 * this.length ? "all" : "arm");
    this.recolour();
  }

  // Displacement of the first arm's root, of a base that travels far; zero otherwise.
  drift() {
    return this.far ? V.sub(this.members[0].now.root, this.begun) : [0, 0, 0];
  }

  // A box around everything at all times, which moves with a base that travels far.
  window() {
    const { root } = this.members[0], at = (i) => [...root.values.slice(3 * i, 3 * i + 3)];
    this.begun = at(0);
    this.far = Array.from({ length: root.rows }, (_, i) => V.size(V.sub(at(i), this.begun))).some((gone) => gone > TRAVELS * this.length);
    this.mean = V.by(Array.from({ length: root.rows }, (_, i) => at(i)).reduce(V.add), 1 / root.rows);
    this.follow = this.far ? "root" : "";
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    this.cloud = [];
    this.hulls = []; // points around the submarine
    const hold = (seen, by = 0, drift = [0, 0, 0]) => {
      const point = V.sub(seen, drift);
      point.forEach((p, d) => { low[d] = Math.min(low[d], p - by); high[d] = Math.max(high[d], p + by); });
      for (const way of by ? [-by, by] : [0]) this.cloud.push(point.map((p) => p + way));
    };
    for (const member of this.members) {
      const step = Math.max(1, Math.floor(member.time.length / 100));
      for (let k = 0; k < member.time.length; k += step) {
        member.go(member.time[k]);
        const drift = this.far ? V.sub(member.now.root, this.begun) : [0, 0, 0];
        for (let i = 0; i < member.nodes; i += Math.max(1, Math.floor(member.nodes / 20))) hold([0, 1, 2].map((d) => member.points[3 * i + d]), member.diameter[i] / 2, drift);
        hold(member.now.tip, member.diameter[member.nodes - 1] / 2, drift);
        if (member.aims) hold(member.now.target, 0, drift);
        hold(member.now.anchor, 0.05 * this.length, drift);
        if (!member.sizes.hull) continue;
        const { middle, axes } = this.hullOf(member);
        for (const axis of axes) for (const way of [-1, 1]) this.hulls.push(V.sub(V.add(middle, V.by(axis, way)), drift));
      }
    }
    const near = ROOM * this.length, a = low.map((p) => p - near), b = high.map((p) => p + near);
    for (const member of this.members) for (const body of member.bodies) {
      const path = Array.from({ length: body.path.rows }, (_, i) => [...body.path.values.slice(3 * i, 3 * i + 3)]);
      for (const at of path) {
        if (body.solid) { // as far as it is near
          for (let i = 0; i < body.solid.points.length; i += 9) {
            const corner = at.map((p, d) => p + body.solid.points[i + d]);
            if (corner.every((p, d) => p > a[d] && p < b[d])) hold(corner);
          }
          continue;
        }
        const foot = body.kind === "plane" ? this.foot(body, at, V.by(V.add(a, b), 0.5)) : at;
        hold(foot.map((p, d) => Math.min(b[d], Math.max(a[d], p))), body.kind === "plane" ? 0 : Math.min(body.radius, near));
      }
    }
    const back = this.far ? V.sub(this.mean, this.begun) : [0, 0, 0];
    if (this.water) this.water.start.forEach((start) => hold(start, 0.04 * this.length, back));
    [this.low, this.high] = [low, high];
    this.size = Math.max(...low.map((p, d) => high[d] - p));
  }

  foot(plane, at, point) {
    return V.sub(point, V.by(plane.out, V.dot(V.sub(point, at), plane.out)));
  }

  // Choose whether views hold the submarine ("all"), or the arm and a part of it ("arm").
  frame(framed) {
    this.framed = framed;
    this.camera.cloud = framed === "all" ? [...this.cloud, ...this.hulls] : this.cloud;
  }

  // Show everything from a direction.
  look(name, aspect) {
    this.camera.fit(name, aspect);
    this.followed = this.far && this.follow === "root" ? this.begun : undefined;
  }

  // Colours from the style sheet, which knows whether it is dark.
  recolour() {
    const style = getComputedStyle(document.documentElement), read = (name) => rgb(style.getPropertyValue(`--${name}`).trim());
    this.tones = Object.fromEntries(["ink", "soft", "run", "free", "faint", "water", "chamber", "tendon"].map((name) => [name, read(name)]));
    this.dark = matchMedia("(prefers-color-scheme: dark)").matches;
    this.hull = this.dark ? [0.3, 0.36, 0.4] : [0.78, 0.82, 0.84];
    this.steel = this.dark ? [0.55, 0.61, 0.65] : [0.46, 0.52, 0.56];
    this.stone = this.dark ? [0.52, 0.48, 0.42] : [0.76, 0.72, 0.66];
    const field = this.fields.find((each) => each.name === this.colour);
    this.paint.colours(RAMPS[field && field.signed && field.low < 0 ? "two" : "one"]);
  }

  draw(time) {
    const { canvas, paint, camera } = this, ratio = Math.min(2, devicePixelRatio || 1);
    const wide = Math.max(1, Math.round(canvas.clientWidth * ratio)), high = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
    paint.ratio = ratio;
    this.members.forEach((member, i) => {
      member.go(time);
      const field = this.fields.find((each) => each.name === this.colour);
      if (field && member.fields[this.colour]) {
        between(member.fields[this.colour], member.now.at, member.now.share, member.shade);
        for (let n = 0; n < member.nodes; n++) member.shade[n] = (member.shade[n] - field.low) / (field.high - field.low);
      }
      paint.bend(this.arms[i], member.points, member.diameter, member.shade);
    });
    if (this.follow) {
      const now = this.members[0].now[this.follow];
      if (this.followed) camera.centre = V.add(camera.centre, V.sub(now, this.followed));
      this.followed = now;
    }
    const apart = this.other === "beside" && this.members.length > 1;
    const parts = apart ? this.members.map((_, i) => [i]) : [this.other === "none" ? [0] : this.members.map((_, i) => i)];
    const each = Math.floor(wide / parts.length);
    parts.forEach((shown, i) => {
      paint.begin(camera.view(each / high), i * each, each, high, i === 0);
      this.picture(shown, time);
    });
    this.drawn = { parts: parts.length, wide: each, high };
  }

  picture(shown, time) {
    const { paint, tones } = this, [main, ...ghosts] = shown, member = this.members[main], { now } = member;
    this.grid();
    this.mount(member);
    member.bodies.forEach((body, i) => this.body(body, ...now.bodies[i]));
    const alone = main > 0, coloured = this.colour !== "" && member.fields[this.colour] !== undefined;
    const tone = [...(alone ? tones.free : tones.run), 1];
    paint.draw(this.arms[main], placed([1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]), tone, { coloured });
    this.threads(member);
    if (now.held && member.tool !== null) this.tool(member);
    this.trail(member, time, alone ? tones.free : tones.run);
    if (member.aims) this.aim(now.target, member);
    this.flow(time);
    if (this.pull) { // of a live session
      const pieces = [];
      this.arrow(now.tip, this.pull, tones.free, pieces);
      paint.lines(pieces, 3);
    }
    for (const i of ghosts) {
      const other = this.members[i];
      paint.draw(this.arms[i], placed([1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]), [...tones.free, 0.3], { culled: true });
      this.trail(other, time, tones.free, 0.5);
    }
  }

  // A grid: a floor in space, a wall behind a planar arm.
  grid() {
    const drift = this.drift(), low = V.add(this.low, drift), high = V.add(this.high, drift), { tones, paint } = this, step = nice(this.size / 6), [a, b] = this.spatial ? [0, 1] : [0, 2], c = 3 - a - b, room = this.spatial ? 0.3 : 1.5;
    const level = this.spatial ? low[2] - 0.02 * this.size : high[1] + 0.1 * this.size, ink = [...tones.faint, this.dark ? 0.22 : 0.3];
    const from = [low[a], low[b]].map((p) => Math.floor((p - room * this.size) / step) * step), to = [high[a], high[b]].map((p) => Math.ceil((p + room * this.size) / step) * step);
    const pieces = [], point = (p, q) => { const at = [0, 0, 0]; at[a] = p; at[b] = q; at[c] = level; return at; };
    for (let p = from[0]; p <= to[0] + step / 2; p += step) pieces.push([point(p, from[1]), point(p, to[1]), ink]);
    for (let q = from[1]; q <= to[1] + step / 2; q += step) pieces.push([point(from[0], q), point(to[0], q), ink]);
    paint.lines(pieces, 1);
    if (!this.spatial) return;
    const shadow = [];
    const { points, nodes } = this.members[0];
    for (let i = 0; i + 1 < nodes; i++) shadow.push([[points[3 * i], points[3 * i + 1], level], [points[3 * i + 3], points[3 * i + 4], level], this.dark ? [0, 0, 0, 0.5] : [...tones.soft, 0.35]]);
    paint.lines(shadow, 4);
  }

  // The submarine or the plate of another base, the boom that servos shift, the joint and the clamp.
  mount(member) {
    const { paint, length } = this, { anchor, root, ahead, frame } = member.now, { hull, base, boom, joint, clamp } = member.sizes;
    const grey = [...this.hull, 1], steel = [...this.steel, 1];
    if (base) this.rod(V.sub(anchor, V.by(this.outOf(member), 2)), anchor, base[1], grey);
    else {
      const { middle, axes } = this.hullOf(member), along = V.by(V.unit(axes[0]), hull[0]);
      if (member.capsule) {
        const ends = [V.add(middle, along), V.sub(middle, along)];
        if (hull[0] > 0) this.rod(...ends, hull[1], grey);
        for (const end of ends) this.ball(end, hull[1], grey);
      } else paint.draw(paint.meshes.ball, placed(...axes, middle), grey);
    }
    if (boom && V.size(V.sub(root, anchor)) > 1e-6) this.rod(anchor, root, boom[1], steel);
    this.ball(root, joint[1], steel);
    this.rod(root, V.add(root, V.by(ahead, 2 * clamp[0])), clamp[1], steel);
    const rails = member.rails.map(([axis, low, high]) => [V.add(anchor, V.by(frame[axis], low)), V.add(anchor, V.by(frame[axis], high))])
      .filter(([p, q]) => V.size(V.sub(p, q)) < 3 * length);
    paint.lines(rails.map(([p, q]) => [p, q, [...this.tones.soft, 0.5]]), 1.5);
  }

  // The way from the middle of the base or hull to where the arm leaves it.
  outOf({ out, now: { frame } }) {
    return [0, 1, 2].reduce((sum, i) => V.add(sum, V.by(frame[i], out[i])), [0, 0, 0]);
  }

  // The middle of the submarine, and its axes, each of half its length.
  hullOf(member) {
    const { capsule, now: { anchor, root, ahead, frame }, sizes: { hull: [half, radius] } } = member, out = this.outOf(member);
    if (!capsule) return { middle: V.sub(anchor, out), axes: frame.map((axis, i) => V.by(axis, i ? radius : half)) };
    const [nose, way] = capsule === "held" ? [root, ahead] : [anchor, V.unit(out)], y = V.aside(way);
    return { middle: V.sub(nose, V.by(way, half + radius)), axes: [V.by(way, half + radius), V.by(y, radius), V.by(V.cross(way, y), radius)] };
  }

  // Chambers and tendons, the thicker the more they press or pull.
  threads({ threads, nodes, points, diameter, now, sizes }) {
    const { paint, tones } = this, { eye } = paint.view, hidden = Math.ceil(((2 * sizes.clamp[0]) / this.length) * (nodes - 1)), at = (i) => [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
    threads.forEach(({ kind, first, offset, pair }, n) => {
      for (const side of pair ? [1, -1] : [1]) {
        const begin = Math.max(first, hidden), path = offset.slice(begin - first).map(([a, b], j) => {
          const i = begin + j, ahead = V.unit(V.sub(at(Math.min(i + 1, nodes - 1)), at(Math.max(i - 1, 0))));
          const m = now.director ? [...now.director.slice(3 * i, 3 * i + 3)] : [-ahead[2], 0, ahead[0]];
          const p = V.add(at(i), V.by(V.add(V.by(m, a), V.by(V.cross(ahead, m), b)), side));
          return V.add(p, V.by(V.unit(V.sub(eye, p)), diameter[i])); // before the arm's surface
        });
        const share = Math.min(1, Math.max(0, side * now.shares[n]));
        const lines = (ink, wide) => paint.lines(path.slice(1).map((p, j) => [path[j], p, ink]), wide);
        lines([1, 1, 1, 1], 2.5 + 5 * share);
        lines([...tones[kind], 1], 1 + 5 * share);
      }
    });
  }

  ball(at, radius, colour) {
    this.paint.draw(this.paint.meshes.ball, placed([radius, 0, 0], [0, radius, 0], [0, 0, radius], at), colour);
  }

  rod(from, to, radius, colour) {
    const way = V.sub(to, from), x = V.unit(way), y = V.aside(x);
    this.paint.draw(this.paint.meshes.rod, placed(way, V.by(y, radius), V.by(V.cross(x, y), radius), from), colour);
  }

  body(body, at, half) {
    const { paint, size } = this, stone = [...this.stone, 1];
    if (body.kind === "plane") {
      const foot = this.foot(body, at, V.by(V.add(this.low, this.high), 0.5)), y = V.aside(body.out), r = 1.1 * size;
      paint.draw(paint.meshes.field, placed(V.by(body.out, 1), V.by(y, r), V.by(V.cross(body.out, y), r), foot), [...this.stone, this.dark ? 0.3 : 0.7]);
      return;
    }
    if (body.solid) {
      body.mesh ??= paint.mesh(body.solid);
      paint.draw(body.mesh, placed([1, 0, 0], [0, 1, 0], [0, 0, 1], at), stone);
      return;
    }
    if (V.size(half) > size) half = V.by(V.unit(half), size); // one without end
    if (V.size(half) > 0) {
      if (!this.spatial && Math.abs(half[1]) > 0.9 * V.size(half)) half = V.by(V.unit(half), 0.06 * size);
      this.rod(V.sub(at, half), V.add(at, half), body.radius, stone);
      if (body.kind === "capsule") for (const end of [V.add(at, half), V.sub(at, half)]) this.ball(end, body.radius, stone);
    } else this.ball(at, body.radius, stone);
  }

  tool(member) {
    const n = member.nodes, p = member.points, tip = member.now.tip;
    const ahead = V.unit(V.sub(tip, [p[3 * n - 6], p[3 * n - 5], p[3 * n - 4]])), { tool, stem } = member.sizes, at = V.add(tip, V.by(ahead, member.tool));
    if (stem) this.rod(tip, at, stem[1], [...this.steel, 1]);
    this.ball(at, tool[1], [0.72, 0.45, 0.6, 1]);
  }

  // Path of the tip, paler for earlier times.
  trail(member, time, tone, faint = 1) {
    const { tips, time: times, now } = member, pieces = [], last = now.at, first = Math.max(0, last - 600), span = (times[times.length - 1] - times[0]) / 6 || 1;
    const point = (i) => [tips[3 * i], tips[3 * i + 1], tips[3 * i + 2]];
    for (let i = first; i < last; i++) {
      pieces.push([point(i), point(i + 1), [...tone, faint * Math.max(0.12, 0.9 * (1 - (time - times[i]) / span))]]);
    }
    pieces.push([point(last), now.tip, [...tone, 0.9 * faint]]);
    this.paint.lines(pieces, 1.6, true);
  }

  aim(target, member) {
    const { across, up } = this.paint.view, pieces = [], ink = [...this.tones.ink, 0.95], r = Math.max(0.024 * this.length, 0.6 * member.diameter[member.nodes - 1]);
    const point = (a, s = r) => V.add(target, V.add(V.by(across, s * Math.cos(a)), V.by(up, s * Math.sin(a))));
    for (let i = 0; i < 40; i++) pieces.push([point((i * Math.PI) / 20), point(((i + 1) * Math.PI) / 20), ink]);
    for (let i = 0; i < 4; i++) pieces.push([point((i * Math.PI) / 2, 1.35 * r), point((i * Math.PI) / 2, 0.75 * r), ink]);
    this.paint.lines(pieces, 1.8, true);
    const { values, rows } = member.target, way = [], step = Math.max(1, Math.floor(rows / 400));
    for (let i = 0; i + step < rows; i += 2 * step) way.push([[...values.slice(3 * i, 3 * i + 3)], [...values.slice(3 * (i + step), 3 * (i + step) + 3)], [...this.tones.ink, 0.4]]);
    this.paint.lines(way, 1.2, true);
  }

  flow(time) {
    if (!this.water) return;
    const { at, share } = locate(this.members[0].time, time), v = between(this.velocity, at, share, new Float32Array(this.velocity.row));
    const tone = this.tones.water, pieces = [], { paint, length } = this;
    const along = this.far ? V.sub(this.members[0].now.root, this.mean) : [0, 0, 0];
    this.water.start.forEach((begin, i) => {
      const start = V.add(begin, along);
      const way = V.by([v[3 * i], v[3 * i + 1], v[3 * i + 2]], 1 / this.water.scale);
      if (V.size(way) > 1e-3 * length) this.arrow(start, way, tone, pieces);
    });
    paint.lines(pieces, 2);
  }

  // The head of an arrow; its shaft joins the pieces of a line.
  arrow(start, way, tone, pieces) {
    const { paint, length } = this, head = Math.min(0.035 * length, 0.5 * V.size(way));
    const x = V.unit(way), y = V.by(V.aside(x), 0.32 * head), neck = V.sub(V.add(start, way), V.by(x, head));
    pieces.push([start, neck, [...tone, 0.85]]);
    paint.draw(paint.meshes.cone, placed(V.by(x, head), y, V.cross(x, y), neck), [...tone, 1]);
  }
}

// 1, 2 or 5 times a power of ten, not above a number.
function nice(value) {
  const power = 10 ** Math.floor(Math.log10(value)), part = value / power;
  return (part >= 5 ? 5 : part >= 2 ? 2 : 1) * power;
}
