// Drawing by WebGL2: lit bodies, the arm, and lines of a width in pixels.

const BODY = [`#version 300 es
uniform mat4 eye, place; in vec3 point, normal; in float shade; out vec3 facing; out float value; out vec3 at;
void main() { vec4 p = place * vec4(point, 1.0); at = p.xyz; value = shade;
  facing = mat3(place) * normal; gl_Position = eye * p; }`, `#version 300 es
precision highp float;
uniform vec4 colour; uniform vec3 toward, light; uniform float coloured; uniform sampler2D scale;
in vec3 facing, at; in float value; out vec4 pixel;
void main() { vec3 n = normalize(facing);
  vec3 base = coloured > 0.5 ? texture(scale, vec2(value, 0.5)).rgb : colour.rgb;
  float lit = 0.62 + 0.38 * max(dot(n, light), 0.0) - 0.22 * max(-dot(n, light), 0.0);
  float rim = pow(1.0 - abs(dot(n, toward)), 3.0);
  pixel = vec4(mix(base * lit, base, 0.15) * (1.0 - 0.18 * rim), colour.a) ; pixel.rgb *= pixel.a; }`];

const LINE = [`#version 300 es
uniform mat4 eye; uniform vec2 size; uniform float wide;
in vec2 corner; in vec3 from, to; in vec4 ink; out vec4 tone;
void main() { vec4 a = eye * vec4(from, 1.0), b = eye * vec4(to, 1.0);
  vec2 p = a.xy / a.w * size, q = b.xy / b.w * size; vec2 d = q - p; float l = length(d);
  d = l > 1e-6 ? d / l : vec2(1.0, 0.0);
  vec4 c = mix(a, b, corner.x); vec2 off = vec2(-d.y, d.x) * corner.y * wide + d * (corner.x * 2.0 - 1.0) * wide * 0.5;
  gl_Position = vec4(c.xy + off / size * c.w, c.z - 0.0004 * c.w, c.w); tone = ink; }`, `#version 300 es
precision mediump float; in vec4 tone; out vec4 pixel; void main() { pixel = vec4(tone.rgb * tone.a, tone.a); }`];

class Painter {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, premultipliedAlpha: true, alpha: true });
    if (!gl) throw new Error("no WebGL2");
    this.gl = gl;
    this.body = this.program(BODY, ["point", "normal", "shade"]);
    this.line = this.program(LINE, ["corner", "from", "to", "ink"]);
    this.meshes = {};
    for (const [name, make] of Object.entries(shapes)) this.meshes[name] = this.mesh(make());
    this.strokes = { buffer: gl.createBuffer(), array: gl.createVertexArray() };
    gl.bindVertexArray(this.strokes.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, -1, 1, -1, 0, 1, 1, 1]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.strokes.buffer);
    [[1, 3, 0], [2, 3, 12], [3, 4, 24]].forEach(([index, size, offset]) => {
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, size, gl.FLOAT, false, 40, offset);
      gl.vertexAttribDivisor(index, 1);
    });
    this.ramp = gl.createTexture();
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  program([vertex, fragment], names) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    names.forEach((name, index) => gl.bindAttribLocation(program, index, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const uniforms = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
      const { name } = gl.getActiveUniform(program, i);
      uniforms[name] = gl.getUniformLocation(program, name);
    }
    return { program, uniforms };
  }

  mesh({ points, normals, corners }) {
    const gl = this.gl, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    [points, normals].forEach((data, index) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, 3, gl.FLOAT, false, 0, 0);
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    return { array, count: corners.length };
  }

  // Buffers for the surface of an arm, which are filled for each picture.
  arm(nodes) {
    const gl = this.gl, rings = nodes + 6, corners = ringCorners(rings, AROUND), array = gl.createVertexArray();
    const data = new Float32Array(rings * (AROUND + 1) * 7), buffer = gl.createBuffer();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data.byteLength, gl.DYNAMIC_DRAW);
    [[0, 3, 0], [1, 3, 12], [2, 1, 24]].forEach(([index, size, offset]) => {
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, size, gl.FLOAT, false, 28, offset);
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    return { array, count: corners.length, data, buffer };
  }

  bend(arm, nodes, diameter, shade) {
    tube(nodes, diameter, shade, arm.data);
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, arm.buffer);
    this.gl.bufferSubData(this.gl.ARRAY_BUFFER, 0, arm.data);
  }

  colours(stops) {
    const gl = this.gl, data = new Uint8Array(256 * 4);
    for (let i = 0; i < 256; i++) data.set([...blend(stops, i / 255), 255], 4 * i);
    gl.bindTexture(gl.TEXTURE_2D, this.ramp);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, data);
    for (const [key, value] of [["MIN_FILTER", "LINEAR"], ["MAG_FILTER", "LINEAR"], ["WRAP_S", "CLAMP_TO_EDGE"], ["WRAP_T", "CLAMP_TO_EDGE"]]) {
      gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${key}`], gl[value]);
    }
  }

  // Start a picture in a part of the canvas.
  begin(view, left, wide, high, clear) {
    const gl = this.gl;
    this.view = view;
    this.size = [wide, high];
    gl.viewport(left, 0, wide, high);
    if (clear) gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  draw(mesh, place, colour, { coloured = false, culled = false } = {}) {
    const gl = this.gl, { program, uniforms } = this.body, { matrix, toward, up, across } = this.view;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.eye, false, matrix);
    gl.uniformMatrix4fv(uniforms.place, false, place);
    gl.uniform4fv(uniforms.colour, colour);
    gl.uniform3fv(uniforms.toward, toward);
    gl.uniform3fv(uniforms.light, V.unit(V.add(V.add(V.by(toward, 0.7), V.by(up, 0.8)), V.by(across, -0.35))));
    gl.uniform1f(uniforms.coloured, coloured ? 1 : 0);
    if (culled) gl.enable(gl.CULL_FACE); else gl.disable(gl.CULL_FACE);
    gl.depthMask(colour[3] >= 0.99);
    gl.bindVertexArray(mesh.array);
    gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
    gl.depthMask(true);
  }

  // Lines from point to point: each piece is [from, to, colour with alpha].
  lines(pieces, wide, over = false) {
    if (!pieces.length) return;
    const gl = this.gl, data = new Float32Array(pieces.length * 10);
    pieces.forEach(([from, to, ink], i) => { data.set(from, 10 * i); data.set(to, 10 * i + 3); data.set(ink, 10 * i + 6); });
    gl.useProgram(this.line.program);
    gl.uniformMatrix4fv(this.line.uniforms.eye, false, this.view.matrix);
    gl.uniform2fv(this.line.uniforms.size, [this.size[0] / 2, this.size[1] / 2]);
    gl.uniform1f(this.line.uniforms.wide, (wide / 2) * this.ratio);
    gl.bindVertexArray(this.strokes.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.strokes.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    gl.disable(gl.CULL_FACE);
    gl.depthMask(false);
    if (over) gl.disable(gl.DEPTH_TEST);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, pieces.length);
    gl.enable(gl.DEPTH_TEST);
    gl.depthMask(true);
  }
}
