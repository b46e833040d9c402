// Draws an arm by WebGL 2: one light with a shadow on the floor, a ghost, the tip's path, axes, a camera that goes around.
"use strict";

const SOLID = [`#version 300 es
in vec3 position; in vec3 normal; uniform mat4 world, camera; out vec3 n, p;
void main() { vec4 at = world * vec4(position, 1.0); p = at.xyz; n = mat3(world) * normal; gl_Position = camera * at; }`,
`#version 300 es
precision highp float; in vec3 n, p; uniform vec3 colour, eye, sun; uniform float alpha; out vec4 seen;
void main() {
  vec3 look = normalize(eye - p), N = normalize(n);
  if (dot(N, look) < 0.0) N = -N;
  float sky = 0.5 + 0.5 * N.y, direct = max(dot(N, sun), 0.0), front = max(dot(N, look), 0.0);
  float shine = pow(max(dot(N, normalize(sun + look)), 0.0), 40.0);
  vec3 light = colour * (0.2 + 0.26 * sky + 0.62 * direct + 0.16 * front) + 0.13 * shine;
  seen = vec4(pow(light, vec3(1.0 / 2.2)), 1.0) * alpha;
}`];
const FLAT = [`#version 300 es
in vec3 position; uniform mat4 world, camera; out vec3 p;
void main() { vec4 at = world * vec4(position, 1.0); p = at.xyz; gl_Position = camera * at; }`,
`#version 300 es
precision highp float; in vec3 p; uniform vec4 tint; uniform float cell, wide; uniform vec2 middle; out vec4 seen;
float lines(vec2 at, float size) {
  vec2 u = at / size, d = abs(fract(u - 0.5) - 0.5) / fwidth(u);
  return 1.0 - min(min(d.x, d.y), 1.0);
}
void main() {
  float here = 1.0;
  if (cell > 0.0) here = max(lines(p.xz, cell), 0.0) * 0.55 + lines(p.xz, 5.0 * cell) * 0.45;
  if (wide > 0.0) here *= 1.0 - smoothstep(0.35 * wide, wide, length(p.xz - middle));
  seen = vec4(tint.rgb * tint.a, tint.a) * here;
}`];
const SUN = [0.42, 0.83, 0.36];
const UNIT = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
const VIEWS = { home: [0.7, 0.42], front: [1.5708, 0.02], side: [0, 0.02], top: [0.0001, 1.5607] }; // around and above [rad]
const LENS = 2.1, FILLED = 0.92; // of the picture's half: 1 / tan of half the field of view; what the arm's whole motion may fill
const BASE = 1; // its node, below that of the whole arm
const ABOVE = 0.02; // of the motion's size: how far the camera stays above the floor
const AXIS = 0.13; // of the motion's size: length of drawn axes
const AXES = [["x", [0.85, 0.2, 0.2]], ["y", [0.15, 0.6, 0.15]], ["z", [0.25, 0.45, 0.95]]];
const NEAREST = 0.6; // of the motion's size: nearer, what is at the sides looks stretched

// Least and greatest coordinates of points.
const bounds = (points) => points.reduce(([low, high], p) => [low.map((v, i) => Math.min(v, p[i])), high.map((v, i) => Math.max(v, p[i]))],
  [points[0], points[0]]);

class Stage {
  // corners: points that the first view shows; words: element over the canvas for the names of axes and the scale.
  constructor(canvas, gltf, corners, words, changed) {
    const g = canvas.getContext("webgl2", { antialias: true, stencil: true });
    if (!g) throw new Error("this browser shows no 3-D pictures (WebGL 2 is off)");
    Object.assign(this, { canvas, g, gltf, changed, words, scale: document.createElement("b") });
    this.solid = this.program(SOLID);
    this.flat = this.program(FLAT);
    this.meshes = gltf.meshes.map((parts) => parts.map((part) => this.upload(part)));
    this.line = { buffer: g.createBuffer(), array: g.createVertexArray() };
    this.tip = gltf.nodes.findIndex((node) => node.name.startsWith("tip "));
    this.names = new Map();
    words.append(this.scale);
    this.surround(corners);
    this.look("home");
    this.listen();
  }

  // Lays the floor below these points, and a grid for their size.
  surround(corners) {
    this.corners = corners;
    const [low, high] = bounds(corners);
    Object.assign(this, { low, high, floor: low[1], fitted: "" });
    this.size = Math.hypot(...high.map((v, i) => v - low[i])) || 1;
    this.middle = high.map((v, i) => (v + low[i]) / 2);
    const raw = this.size / 14, power = 10 ** Math.floor(Math.log10(raw));
    this.cell = power * [1, 2, 5, 10].find((m) => m * power >= raw * 0.99);
    this.quad = this.buffered(new Float32Array([-1, 0, -1, 1, 0, -1, -1, 0, 1, 1, 0, 1].map((v, k) =>
      k % 3 === 1 ? this.floor : this.middle[k % 3] + 3 * this.size * v)));
    this.scale.textContent = `grid ${+this.cell.toPrecision(1)} m`;
  }

  // Makes room for further points; the view steps back for them until the reader looks closer. From then on all that is
  // inside the box around them is seen, so that the view stands still most of the time.
  include(points) {
    const [low, high] = bounds([this.low, this.high, ...points]);
    if (this.corners.length === 8 && `${[low, high]}` === `${[this.low, this.high]}`) return;
    this.surround(Array.from({ length: 8 }, (_, k) => low.map((v, i) => (k >> i & 1 ? high[i] : v))));
  }

  program([vertex, fragment]) {
    const { g } = this, program = g.createProgram();
    for (const [kind, text] of [[g.VERTEX_SHADER, vertex], [g.FRAGMENT_SHADER, fragment]]) {
      const shader = g.createShader(kind);
      g.shaderSource(shader, text);
      g.compileShader(shader);
      if (!g.getShaderParameter(shader, g.COMPILE_STATUS)) throw new Error(g.getShaderInfoLog(shader));
      g.attachShader(program, shader);
    }
    g.bindAttribLocation(program, 0, "position");
    g.bindAttribLocation(program, 1, "normal");
    g.linkProgram(program);
    if (!g.getProgramParameter(program, g.LINK_STATUS)) throw new Error(g.getProgramInfoLog(program));
    const at = {};
    for (let k = 0; k < g.getProgramParameter(program, g.ACTIVE_UNIFORMS); k++) {
      const { name } = g.getActiveUniform(program, k);
      at[name] = g.getUniformLocation(program, name);
    }
    return { program, at };
  }

  upload({ positions, normals, triangles, colour }) {
    const { g } = this, array = g.createVertexArray();
    g.bindVertexArray(array);
    [positions, normals].forEach((values, k) => {
      g.bindBuffer(g.ARRAY_BUFFER, g.createBuffer());
      g.bufferData(g.ARRAY_BUFFER, values, g.STATIC_DRAW);
      g.enableVertexAttribArray(k);
      g.vertexAttribPointer(k, 3, g.FLOAT, false, 0, 0);
    });
    g.bindBuffer(g.ELEMENT_ARRAY_BUFFER, g.createBuffer());
    g.bufferData(g.ELEMENT_ARRAY_BUFFER, triangles, g.STATIC_DRAW);
    return { array, count: triangles.length, kind: triangles instanceof Uint32Array ? g.UNSIGNED_INT : g.UNSIGNED_SHORT, colour };
  }

  buffered(values) {
    const { g } = this, array = g.createVertexArray(), buffer = g.createBuffer();
    g.bindVertexArray(array);
    g.bindBuffer(g.ARRAY_BUFFER, buffer);
    g.bufferData(g.ARRAY_BUFFER, values, g.STATIC_DRAW);
    g.enableVertexAttribArray(0);
    g.vertexAttribPointer(0, 3, g.FLOAT, false, 0, 0);
    return { array, count: values.length / 3 };
  }

  look(view) {
    [this.around, this.above] = VIEWS[view];
    this.away = this.size;
    this.target = [...this.middle];
    Object.assign(this, { fits: true, fitted: "" }); // until the reader looks closer
    this.changed();
  }

  // Stands where the whole motion just fills the picture; in a few rounds, as coming nearer changes where its middle is.
  fit() {
    const { right, up, back } = this.axes(), { across, along } = this.lens();
    const dot = (a, b) => (a[0] - this.target[0]) * b[0] + (a[1] - this.target[1]) * b[1] + (a[2] - this.target[2]) * b[2];
    const stand = () => {
      this.away = this.corners.reduce((most, p) => Math.max(most,
        dot(p, back) + Math.max(Math.abs(dot(p, right)) * across, Math.abs(dot(p, up)) * along) / FILLED), NEAREST * this.size);
    };
    for (let round = 0; round < 8; round++) {
      stand();
      for (const way of [right, up]) {
        let low = null, high = null; // what is seen outermost on either side: how far aside, and how far off
        for (const p of this.corners) {
          const side = dot(p, way), off = this.away - dot(p, back);
          if (!low || side / off < low.side / low.off) low = { side, off };
          if (!high || side / off > high.side / high.off) high = { side, off };
        }
        const shift = (low.side * high.off + high.side * low.off) / (low.off + high.off); // then both are as far from the middle
        this.target = this.target.map((v, i) => v + shift * way[i]);
      }
    }
    stand();
  }

  listen() {
    const { canvas } = this, fingers = new Map();
    let before = null;
    const state = () => {
      const all = [...fingers.values()], n = all.length || 1;
      return { x: all.reduce((s, p) => s + p[0], 0) / n, y: all.reduce((s, p) => s + p[1], 0) / n,
        apart: all.length > 1 ? Math.hypot(all[0][0] - all[1][0], all[0][1] - all[1][1]) : 0 };
    };
    for (const kind of ["pointermove", "wheel"])
      canvas.addEventListener(kind, (event) => { if (kind === "wheel" || fingers.has(event.pointerId)) this.fits = false; });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      before = state();
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) return;
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      const now = state(), dx = now.x - before.x, dy = now.y - before.y;
      if (fingers.size > 1 || event.shiftKey || event.buttons & 6) this.shift(dx, dy); else this.turn(dx, dy);
      if (now.apart && before.apart) this.zoom(before.apart / now.apart);
      before = now;
      this.changed();
    });
    for (const kind of ["pointerup", "pointercancel"])
      canvas.addEventListener(kind, (event) => { fingers.delete(event.pointerId); before = state(); });
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.zoom(Math.exp(Math.max(-80, Math.min(80, event.deltaY)) * 0.002)); this.changed(); },
      { passive: false });
    canvas.addEventListener("dblclick", () => this.look("home"));
  }

  turn(dx, dy) {
    this.around -= dx * 0.008;
    this.above = Math.min(Math.max(this.above + dy * 0.008, -1.56), 1.56);
  }

  shift(dx, dy) {
    const step = this.away / this.canvas.clientHeight, { right, up } = this.axes();
    this.target = this.target.map((v, i) => v + step * (dy * up[i] - dx * right[i]));
  }

  zoom(factor) { this.away = Math.min(Math.max(this.away * factor, 0.05 * this.size), 8 * this.size); }

  // Directions of the screen in the world; `back` is towards the reader.
  axes() {
    const { around, above } = this, [c, s] = [Math.cos(above), Math.sin(above)];
    return { right: [Math.sin(around), 0, -Math.cos(around)], back: [c * Math.cos(around), s, c * Math.sin(around)],
      up: [-s * Math.cos(around), c, -s * Math.sin(around)] };
  }

  // How much of the picture's half a length beside the view's axis fills, at a distance of 1.
  lens() {
    const aspect = this.canvas.width / this.canvas.height, along = Math.min(1, aspect) * LENS;
    return { across: along / aspect, along };
  }

  // Turns the view upward where the eye would come below the floor.
  keepAbove() {
    const least = this.floor + ABOVE * this.size;
    this.target[1] = Math.max(this.target[1], least);
    this.above = Math.max(this.above, Math.asin(Math.min(Math.max((least - this.target[1]) / this.away, -1), 1)));
  }

  // Matrix from the world to the screen, and where the eye is.
  camera() {
    this.keepAbove();
    const { away, target } = this, { right, up, back } = this.axes(), { across, along } = this.lens();
    const eye = target.map((v, i) => v + away * back[i]), dot = (a) => -(a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2]);
    const view = [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, dot(right), dot(up), dot(back), 1];
    const near = 0.01 * this.size, far = 20 * this.size;
    const lens = [across, 0, 0, 0, 0, along, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
    return { matrix: multiplied(lens, view), eye };
  }

  // pose: matrices of all nodes; ghost: those of the reference, or null; colours: of paper, ink and ghost, 0 to 1; legs: further lines.
  draw(pose, ghost, path, colours, legs = []) {
    const { g, canvas } = this, ratio = Math.min(devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const seen = [width, height, this.around, this.above].join();
    if (this.fits && this.fitted !== seen) this.fit();
    this.fitted = seen;
    g.viewport(0, 0, width, height);
    g.clearColor(...colours.paper, 1);
    g.clear(g.COLOR_BUFFER_BIT | g.DEPTH_BUFFER_BIT | g.STENCIL_BUFFER_BIT);
    g.enable(g.DEPTH_TEST);
    g.enable(g.BLEND);
    g.blendFunc(g.ONE, g.ONE_MINUS_SRC_ALPHA);
    const camera = this.camera();
    this.drawSolid(pose, camera, null, 1);
    this.drawFloor(camera, pose, colours);
    const at = pose[BASE].subarray(12, 15);
    if (at[1] > this.floor + 0.02 * this.size) this.drawLine(new Float32Array([...at, at[0], this.floor, at[2]]), [...colours.ink, 0.5]);
    const thick = (points, tint) => { // WebGL's lines are one pixel wide
      for (const [x, y] of [[0, 0], [ratio, 0], [0, ratio], [ratio, ratio]]) {
        g.viewport(x, y, width, height);
        this.drawLine(points, tint);
      }
      g.viewport(0, 0, width, height);
    };
    if (path) thick(path, [...colours.accent, 1]);
    for (const leg of legs) thick(leg, [...colours.ink, 0.8]);
    g.disable(g.DEPTH_TEST); // axes are seen through the arm
    this.axesOf(pose[BASE], "", camera, thick);
    if (this.tip >= 0) this.axesOf(pose[this.tip], "tip ", camera, thick);
    g.enable(g.DEPTH_TEST);
    if (ghost) {
      g.enable(g.POLYGON_OFFSET_FILL); // where both are in one place the arm is in front
      g.polygonOffset(1, 4);
      g.colorMask(false, false, false, false); // first its depth, so that only its front is seen
      this.drawSolid(ghost, camera, colours.ghost, 1);
      g.colorMask(true, true, true, true);
      g.depthFunc(g.LEQUAL);
      this.drawSolid(ghost, camera, colours.ghost, 0.42);
      g.depthFunc(g.LESS);
      g.disable(g.POLYGON_OFFSET_FILL);
    }
  }

  // Three axes at a node, each with its name where it ends.
  axesOf(at, of, camera, thick) {
    const m = camera.matrix, from = [at[12], at[13], at[14]], length = AXIS * this.size * (of ? 0.7 : 1);
    AXES.forEach(([name, colour], k) => {
      const end = from.map((v, i) => v + length * at[4 * k + i]), far = from.map((v, i) => v + 1.18 * length * at[4 * k + i]);
      thick(new Float32Array([...from, ...end]), [...colour, 1]);
      const [x, y, w] = [0, 1, 3].map((i) => m[i] * far[0] + m[i + 4] * far[1] + m[i + 8] * far[2] + m[i + 12]);
      let word = this.names.get(of + name);
      if (!word) {
        word = document.createElement("i");
        word.textContent = of ? "" : name;
        word.style.color = `rgb(${colour.map((v) => Math.round(255 * v)).join()})`;
        this.names.set(of + name, word);
        this.words.append(word);
      }
      word.hidden = w <= 0;
      word.style.left = `${50 * (1 + x / w)}%`;
      word.style.top = `${50 * (1 - y / w)}%`;
    });
  }

  drawSolid(pose, camera, colour, alpha) {
    const { g } = this, { program, at } = this.solid;
    g.useProgram(program);
    g.uniformMatrix4fv(at.camera, false, camera.matrix);
    g.uniform3fv(at.eye, camera.eye);
    g.uniform3fv(at.sun, SUN);
    g.uniform1f(at.alpha, alpha);
    this.eachPart(pose, (part, world) => {
      g.uniformMatrix4fv(at.world, false, world);
      g.uniform3fv(at.colour, colour || part.colour);
      g.drawElements(g.TRIANGLES, part.count, part.kind, 0);
    });
  }

  eachPart(pose, visit) {
    this.gltf.nodes.forEach((node, k) => { if (node.mesh !== undefined) for (const part of this.meshes[node.mesh]) {
      this.g.bindVertexArray(part.array);
      visit(part, pose[k]);
    } });
  }

  drawFloor(camera, pose, colours) {
    const { g } = this, { program, at } = this.flat;
    g.useProgram(program);
    g.uniformMatrix4fv(at.camera, false, camera.matrix);
    g.uniform2f(at.middle, this.middle[0], this.middle[2]);
    g.uniform1f(at.wide, 1.9 * this.size);
    g.depthMask(false);
    g.uniform1f(at.cell, this.cell);
    g.uniform4f(at.tint, ...colours.ink, 0.32);
    g.uniformMatrix4fv(at.world, false, UNIT);
    g.bindVertexArray(this.quad.array);
    g.drawArrays(g.TRIANGLE_STRIP, 0, this.quad.count);
    if (camera.eye[1] > this.floor) { // the shadow: every point slides along the light down to the floor, once a pixel
      const [x, y, z] = SUN, lift = this.floor + 1e-4 * this.size;
      const shadow = [1, 0, 0, 0, -x / y, 0, -z / y, 0, 0, 0, 1, 0, x / y * lift, lift, z / y * lift, 1];
      g.enable(g.STENCIL_TEST);
      g.stencilFunc(g.EQUAL, 0, 255);
      g.stencilOp(g.KEEP, g.KEEP, g.INCR);
      g.uniform1f(at.cell, 0);
      g.uniform4f(at.tint, 0, 0, 0, 0.2);
      this.eachPart(pose, (part, world) => {
        g.uniformMatrix4fv(at.world, false, multiplied(shadow, world));
        g.drawElements(g.TRIANGLES, part.count, part.kind, 0);
      });
      g.disable(g.STENCIL_TEST);
    }
    g.depthMask(true);
  }

  drawLine(points, tint) { // right after the floor, whose program and camera it uses
    const { g } = this, { at } = this.flat;
    g.uniform1f(at.cell, 0);
    g.uniform1f(at.wide, 0);
    g.uniform4f(at.tint, ...tint);
    g.uniformMatrix4fv(at.world, false, UNIT);
    g.bindVertexArray(this.line.array);
    g.bindBuffer(g.ARRAY_BUFFER, this.line.buffer);
    g.bufferData(g.ARRAY_BUFFER, points, g.DYNAMIC_DRAW);
    g.enableVertexAttribArray(0);
    g.vertexAttribPointer(0, 3, g.FLOAT, false, 0, 0);
    g.drawArrays(g.LINE_STRIP, 0, points.length / 3);
  }
}
