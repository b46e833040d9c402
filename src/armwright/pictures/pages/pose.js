// An arm whose joints move by sliders, and where its end effector is then.
"use strict";

const DEGREE = Math.PI / 180;
const fixed = (v, digits) => (Math.round(v * 10 ** digits) / 10 ** digits + 0).toFixed(digits); // no -0

class Poser {
  // data: joints {name, angle, low, high, start, open}, bodies {node, turns, way, turn, at, offset, joint, factor, shift}, legs.
  constructor(gltf, data) {
    Object.assign(this, { gltf, data, q: data.joints.map(({ start }) => start) });
    this.at = (id) => document.getElementById(id);
    this.sliders = data.joints.map((joint, k) => this.slider(joint, k));
    this.tip = gltf.nodes.findIndex((node) => node.name.startsWith("tip "));
    this.at("effector").hidden = this.tip < 0;
    this.stage = new Stage(this.at("stage"), gltf, gltf.boxes(this.world()), this.at("words"), () => this.draw());
    this.at("view").onchange = () => this.stage.look(this.at("view").value);
    this.at("start").onclick = () => this.go(data.joints.map(({ start }) => start));
    this.at("zero").onclick = () => this.go(data.joints.map(({ low, high }) => Math.min(Math.max(0, low), high)));
    new ResizeObserver(() => this.draw()).observe(this.at("stage"));
    this.go(this.q);
  }

  slider({ name, low, high, open }, k) {
    const label = document.createElement("label"), value = document.createElement("span"), input = document.createElement("input");
    Object.assign(input, { type: "range", min: low, max: high, step: "any" });
    input.setAttribute("aria-label", name);
    if (open) label.title = "the robot file has no limit here";
    label.append(name, value, input);
    input.oninput = () => { this.q[k] = +input.value; this.moved(); };
    this.at("sliders").append(label);
    return { value, input };
  }

  go(q) {
    this.q = [...q];
    this.sliders.forEach(({ input }, k) => { // a program may go beyond the limits, and a joint without limits beyond the slider
      Object.assign(input, { min: Math.min(input.min, q[k]), max: Math.max(input.max, q[k]) });
      input.value = q[k];
    });
    this.moved();
  }

  // World matrices of all nodes at q.
  world() {
    const turns = new Map(), slides = new Map();
    for (const { node, turns: rotates, way, turn: [x, y, z, w], at, axis, offset, joint, factor, shift } of this.data.bodies) {
      const q = factor * this.q[joint] + shift;
      if (rotates) {
        const c = Math.cos((q + offset) / 2), s = Math.sin((q + offset) / 2);
        turns.set(node, [x * c + y * s, y * c - x * s, z * c + w * s, w * c - z * s]);
      }
      if (way) slides.set(node, at.map((v, i) => v + way * q * axis[i]));
    }
    return this.gltf.placements(turns, slides);
  }

  moved() {
    this.data.joints.forEach(({ angle }, k) => {
      const q = this.q[k];
      this.sliders[k].value.textContent = angle ? `${fixed(q / DEGREE, 1)}°  ${fixed(q, 3)} rad` : `${fixed(q, 4)} m`;
    });
    this.at("q").textContent = this.q.map((q) => +q.toFixed(4)).join(",");
    if (this.tip >= 0) this.tell(this.world());
    this.draw();
  }

  // Position and fixed-axis angles of the end effector in the base, which may itself be turned in the world.
  tell(world) {
    const b = world[BASE], t = world[this.tip], dot = (i, v) => b[4 * i] * v[0] + b[4 * i + 1] * v[1] + b[4 * i + 2] * v[2];
    const away = [12, 13, 14].map((i) => t[i] - b[i]), r = (i, j) => dot(i, t.slice(4 * j, 4 * j + 3));
    const angles = [Math.atan2(r(2, 1), r(2, 2)), Math.atan2(-r(2, 0), Math.hypot(r(0, 0), r(1, 0))), Math.atan2(r(1, 0), r(0, 0))];
    const rows = [..."xyz"].map((name, i) => [name, `${fixed(dot(i, away), 4)} m`]);
    rows.push(...["roll", "pitch", "yaw"].map((name, i) => [name, `${fixed(angles[i] / DEGREE, 2)}°`]));
    this.at("place").replaceChildren(...rows.map((cells) => {
      const row = document.createElement("tr");
      row.append(...cells.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
      return row;
    }));
  }

  draw() {
    if (this.asked || !this.stage) return;
    this.asked = requestAnimationFrame(() => {
      this.asked = 0;
      const style = getComputedStyle(document.documentElement), world = this.world();
      const colour = (name) => [1, 3, 5].map((k) => parseInt(style.getPropertyValue(name).trim().slice(k, k + 2), 16) / 255);
      const point = (m, p) => [0, 1, 2].map((i) => m[i] * p[0] + m[i + 4] * p[1] + m[i + 8] * p[2] + m[i + 12]);
      const legs = this.data.legs.map(({ nodes, ends }) => new Float32Array(ends.flatMap((p, k) => point(world[nodes[k]], p))));
      this.stage.draw(world, null, null, { paper: colour("--paper"), ink: colour("--ink"), accent: colour("--accent") }, legs);
    });
  }
}
