// Plays an arm: time goes on by itself, by the slider, by the curves or by the keyboard.
"use strict";

const LEAST_POINTS = 600, MOST_POINTS = 20000; // of the tip's path, before it is thinned
const FINE = 1 / 1000; // of the path's size: steps between its points

class Player {
  constructor(stage, gltf, charts, plot) {
    Object.assign(this, { stage, gltf, charts, t: 0, playing: false, speed: 1 });
    this.at = (id) => document.getElementById(id);
    this.start = plot.start;
    this.duration = plot.duration;
    this.hasGhost = "reference" in gltf.animations;
    this.tip = gltf.nodes.findIndex((node) => node.name.startsWith("tip "));
    this.trace = this.tip < 0 ? null : this.traced();
    this.at("ghost").hidden = !this.hasGhost;
    this.at("path").hidden = !this.trace;
    this.listen();
    const told = location.hash.match(/\bt=([-\d.e]+)/), still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.seek(told ? +told[1] - this.start : 0);
    this.play(!/\bpause\b/.test(location.hash) && !still && this.duration > 0);
  }

  // Where the tip is, and when: at the run's rows, of which those are left out that are hardly any way from the one before.
  traced() {
    const rows = this.charts.times[0], count = Math.min(Math.max(rows.length - 1, LEAST_POINTS), MOST_POINTS);
    const all = Array.from({ length: count + 1 }, (_, k) => {
      const t = this.duration * k / count;
      return { t, at: this.gltf.pose("run", t)[this.tip].slice(12, 15) };
    });
    const wide = Math.hypot(...[0, 1, 2].map((i) => {
      const own = all.map(({ at }) => at[i]);
      return own.reduce((a, b) => Math.max(a, b)) - own.reduce((a, b) => Math.min(a, b));
    }));
    let last = all[0];
    const kept = all.filter((one, k) => {
      if (k > 0 && k < count && Math.hypot(...one.at.map((v, i) => v - last.at[i])) < FINE * wide) return false;
      last = one;
      return true;
    });
    return { times: Float64Array.from(kept, ({ t }) => t), points: Float32Array.from(kept.flatMap(({ at }) => [...at])) };
  }

  pressed(id) { return !this.at(id).hidden && this.at(id).getAttribute("aria-pressed") === "true"; }

  listen() {
    const { at } = this;
    at("play").onclick = () => this.play(!this.playing);
    at("time").oninput = () => { this.play(false); this.seek(at("time").value * this.duration); };
    at("speed").onchange = () => { this.speed = +at("speed").value; };
    at("view").onchange = () => { if (this.stage) this.stage.look(at("view").value); };
    for (const id of ["ghost", "path"]) at(id).onclick = () => {
      at(id).setAttribute("aria-pressed", String(!this.pressed(id)));
      this.draw();
    };
    document.addEventListener("keydown", (event) => {
      if (/^(INPUT|SELECT|BUTTON)$/.test(event.target.tagName)) return;
      const act = { " ": () => this.play(!this.playing), ArrowLeft: () => this.seek(this.t - this.duration / 100),
        ArrowRight: () => this.seek(this.t + this.duration / 100), Home: () => this.seek(0), End: () => this.seek(this.duration) }[event.key];
      if (act) { event.preventDefault(); act(); }
    });
    new ResizeObserver(() => this.draw()).observe(at("stage"));
  }

  play(wanted) {
    if (wanted === this.playing) return;
    this.playing = wanted;
    this.at("play").textContent = wanted ? "‖" : "▶";
    this.at("play").setAttribute("aria-label", wanted ? "Pause" : "Play");
    let before = null;
    const step = (now) => {
      if (!this.playing) return;
      if (before !== null) {
        const next = this.t + (now - before) / 1000 * this.speed;
        this.seek(next > this.duration ? (this.t < this.duration ? this.duration : 0) : next);
      }
      before = now;
      requestAnimationFrame(step);
    };
    if (wanted) requestAnimationFrame(step);
  }

  // t: [s] since the run's first row.
  seek(t) {
    this.t = Math.min(Math.max(t, 0), this.duration);
    this.at("time").value = this.duration ? this.t / this.duration : 0;
    this.at("now").textContent = `${(this.start + this.t).toFixed(this.duration < 20 ? 3 : 2)} s`;
    this.charts.cursor = this.start + this.t;
    this.charts.mark();
    this.draw();
  }

  draw() {
    if (this.asked || !this.stage) return;
    this.asked = requestAnimationFrame(() => {
      this.asked = 0;
      const colour = (name) => {
        const hex = this.charts.style(name).slice(1);
        return [0, 2, 4].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
      };
      const ghost = this.pressed("ghost") ? this.gltf.pose("reference", this.t) : null;
      const path = this.pressed("path") ? this.trace : null, seen = path ? below(path.times, this.t + 1e-9) : 0;
      this.stage.draw(this.gltf.pose("run", this.t), ghost, path && path.points.subarray(0, 3 * seen),
        { paper: colour("--paper"), ink: colour("--ink"), accent: colour("--accent"), ghost: [0.9, 0.45, 0.08] });
    });
  }
}
