// Camera: its direction, centre and scale.

class Camera {
  // `cloud` is a list of points that must be visible.
  constructor(low, high, cloud) {
    Object.assign(this, { low, high, cloud });
    this.fit("side", 1);
  }

  get axes() {
    const y = (this.yaw * Math.PI) / 180, p = (this.pitch * Math.PI) / 180;
    const toward = [Math.cos(p) * Math.cos(y), Math.cos(p) * Math.sin(y), Math.sin(p)];
    const across = [-Math.sin(y), Math.cos(y), 0];
    return { across, up: V.cross(toward, across), toward };
  }

  // Show everything from a direction.
  fit(name, aspect) {
    [this.yaw, this.pitch] = PRESETS[name];
    this.preset = name;
    this.flat = name !== "angle"; // a parallel projection
    const { across, up, toward } = this.axes, middle = V.by(V.add(this.low, this.high), 0.5), size = V.size(V.sub(this.high, this.low));
    let [left, right, bottom, top] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const point of this.cloud) {
      const off = V.sub(point, middle), nearer = this.flat ? 1 : 1 / (1 - (0.12 * V.dot(off, toward)) / size);
      const x = V.dot(off, across) * nearer, y = V.dot(off, up) * nearer;
      left = Math.min(left, x); right = Math.max(right, x); bottom = Math.min(bottom, y); top = Math.max(top, y);
    }
    this.centre = V.add(middle, V.add(V.by(across, (left + right) / 2), V.by(up, (bottom + top) / 2)));
    const [wide, high] = [(right - left) / 2, (top - bottom) / 2];
    this.half = 1.18 * Math.max(high, wide / aspect, 1e-6);
  }

  turn(right, up) {
    this.yaw -= right;
    this.pitch = Math.max(-89.9, Math.min(90, this.pitch + up));
    this.flat = false;
    this.preset = "";
  }

  move(right, up) { // in halves of the height
    const { across, up: top } = this.axes;
    this.centre = V.sub(this.centre, V.add(V.by(across, right * this.half), V.by(top, up * this.half)));
  }

  zoom(by) {
    this.half = Math.max(1e-5, this.half * by);
  }

  view(aspect) {
    const { across, up, toward } = this.axes, far = this.half * (this.flat ? 200 : 1 / Math.tan(0.24));
    const eye = V.add(this.centre, V.by(toward, far));
    const look = new DOMMatrix([
      across[0], up[0], toward[0], 0, across[1], up[1], toward[1], 0, across[2], up[2], toward[2], 0,
      -V.dot(across, eye), -V.dot(up, eye), -V.dot(toward, eye), 1,
    ]);
    const reach = Math.max(V.size(V.sub(this.high, this.low)), this.half) * 3;
    const near = Math.max(far * 0.02, far - reach), end = far + reach, s = 1 / this.half, f = far * s;
    const lens = new DOMMatrix(this.flat
      ? [s / aspect, 0, 0, 0, 0, s, 0, 0, 0, 0, -2 / (end - near), 0, 0, 0, -(end + near) / (end - near), 1]
      : [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, -(end + near) / (end - near), -1, 0, 0, (-2 * end * near) / (end - near), 0]);
    return { matrix: lens.multiply(look).toFloat32Array(), eye, across, up, toward };
  }
}
