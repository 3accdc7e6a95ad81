// Vectors, matrices (by columns, as WebGL has them) and shapes.

const V = {
  add: (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]],
  sub: (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]],
  by: (a, s) => [a[0] * s, a[1] * s, a[2] * s],
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  cross: (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  size: (a) => Math.hypot(a[0], a[1], a[2]),
  unit: (a) => { const s = Math.hypot(a[0], a[1], a[2]) || 1; return [a[0] / s, a[1] / s, a[2] / s]; },
  aside: (a) => { // a direction perpendicular to another
    const small = [0, 1, 2].sort((i, j) => Math.abs(a[i]) - Math.abs(a[j]))[0], e = [0, 0, 0];
    e[small] = 1;
    return V.unit(V.cross(a, e));
  },
};

// Transformation from a body's axes, each with its length, to the world.
const placed = (x, y, z, at) => new Float32Array([...x, 0, ...y, 0, ...z, 0, ...at, 1]);

// A body of revolution about x: rings of a radius along it, with normals.
function turned(rings, around = 28) {
  const points = [], normals = [];
  rings.forEach(([x, r, nx, nr]) => {
    for (let i = 0; i <= around; i++) {
      const a = (2 * Math.PI * i) / around, c = Math.cos(a), s = Math.sin(a);
      points.push(x, r * c, r * s);
      normals.push(nx, nr * c, nr * s);
    }
  });
  return { points: new Float32Array(points), normals: new Float32Array(normals), corners: ringCorners(rings.length, around) };
}

// Triangles between rings of points that follow each other, each ring closed by its first point.
function ringCorners(rings, around) {
  const corners = [];
  for (let j = 0; j + 1 < rings; j++) for (let i = 0; i < around; i++) {
    const p = j * (around + 1) + i, q = p + around + 1;
    corners.push(p, q, p + 1, p + 1, q, q + 1);
  }
  return new Uint32Array(corners);
}

const shapes = {
  ball: () => turned(Array.from({ length: 17 }, (_, i) => {
    const a = (Math.PI * i) / 16;
    return [-Math.cos(a), Math.sin(a), -Math.cos(a), Math.sin(a)];
  })),
  rod: () => turned([[0, 0, -1, 0], [0, 1, -1, 0], [0, 1, 0, 1], [1, 1, 0, 1], [1, 1, 1, 0], [1, 0, 1, 0]]),
  cone: () => turned([[0, 0, -1, 0], [0, 1, -1, 0], [0, 1, 0.45, 0.9], [1, 0, 0.45, 0.9]]),
  field: () => ({
    points: new Float32Array([0, -1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1]),
    normals: new Float32Array([1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0]),
    corners: new Uint32Array([0, 1, 2, 0, 2, 3]),
  }),
};

// Triangles that share no corner, each with its own normal.
function solid(places, facets) {
  const points = new Float32Array(3 * facets.length), normals = new Float32Array(3 * facets.length);
  for (let i = 0; i < facets.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((j) => [...places.slice(3 * facets[i + j], 3 * facets[i + j] + 3)]);
    const out = V.unit(V.cross(V.sub(b, a), V.sub(c, a)));
    [a, b, c].forEach((corner, j) => { points.set(corner, 3 * (i + j)); normals.set(out, 3 * (i + j)); });
  }
  return { points, normals, corners: Uint32Array.from(facets, (_, i) => i) };
}

// Surface of a tube around nodes without twist; `shade` is a number for each node.
const AROUND = 20;
function tube(nodes, diameter, shade, into) {
  const count = nodes.length / 3, at = (i) => [nodes[3 * i], nodes[3 * i + 1], nodes[3 * i + 2]];
  const rings = [];
  let side = null;
  for (let i = 0; i < count; i++) {
    const ahead = V.unit(V.sub(at(Math.min(i + 1, count - 1)), at(Math.max(i - 1, 0))));
    side = side ? V.unit(V.sub(side, V.by(ahead, V.dot(side, ahead)))) : V.aside(ahead);
    rings.push([at(i), diameter[i] / 2, ahead, side, V.cross(ahead, side), shade[i]]);
  }
  // round ends: rings that shrink beyond the first node and the last
  const cap = (ring, way) => [0.0, 0.5, 0.85].map((part) => {
    const far = way * ring[1] * Math.sqrt(1 - part * part) * 0.9;
    return [V.add(ring[0], V.by(ring[2], far)), ring[1] * part, ring[2], ring[3], ring[4], ring[5], way * Math.sqrt(1 - part * part), part];
  });
  const all = [...cap(rings[0], -1), ...rings, ...cap(rings[count - 1], 1).reverse()];
  let k = 0;
  for (const [middle, radius, ahead, one, other, value, tip = 0, out = 1] of all) {
    for (let i = 0; i <= AROUND; i++) {
      const a = (2 * Math.PI * i) / AROUND, c = Math.cos(a), s = Math.sin(a);
      for (let d = 0; d < 3; d++) {
        const round = c * one[d] + s * other[d];
        into[k + d] = middle[d] + radius * round;
        into[k + 3 + d] = out * round + tip * ahead[d];
      }
      into[k + 6] = value;
      k += 7;
    }
  }
}
