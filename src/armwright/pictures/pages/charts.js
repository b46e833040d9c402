// Panels of curves over one time axis: zoom, move, read off values, hide joints. Drawn on canvases, a panel each.
"use strict";

const LEFT = 58, RIGHT = 10, TOP = 6, BOTTOM = 26; // [px] around the curves
const DASHES = [[], [7, 4], [2, 3], [8, 3, 2, 3]], REFERENCES = [[3, 3], [1, 2], [6, 2, 1, 2]]; // of the first run, of the second, …

const tidy = (v) => {
  if (!Number.isFinite(v)) return "—";
  const size = Math.abs(v), text = size !== 0 && (size < 1e-4 || size >= 1e6) ? v.toExponential(3) : +v.toPrecision(5) + "";
  return text.replace("-", "−");
};

// Round numbers that divide [low, high] into about `count` parts, and how many decimals they need.
function ticks(low, high, count) {
  const raw = (high - low) / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= raw * 0.999);
  const found = [], decimals = Math.max(0, Math.min(12, -Math.floor(Math.log10(step) + 1e-9)));
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return { found, write: (v) => (Math.abs(v) >= 1e5 ? v.toExponential(1) : v.toFixed(decimals)).replace("-", "−") };
}

// How many of the increasing numbers are below v.
function below(sorted, v) {
  let low = 0, high = sorted.length;
  while (low < high) { const mid = (low + high) >> 1; if (sorted[mid] < v) low = mid + 1; else high = mid; }
  return low;
}

const BLOCKS = [1, 32, 1024]; // samples whose least and greatest are known together

class Charts {
  // plot: what plot_data of pictures/curves.py tells; numbers: its Float32Array; onseek: told the time that was clicked.
  constructor(host, legend, plot, numbers, onseek) {
    Object.assign(this, { host, legend, plot, numbers, onseek, hidden: new Set(), hiddenRuns: new Set(), hiddenKinds: new Set(),
      cursor: null, hover: null });
    this.byRun = plot.joints.length === 1 && plot.runs.length > 1; // of one joint a colour is a run
    this.times = plot.runs.map((run) => this.timesOf(run.time));
    this.full = [Math.min(...this.times.map((t) => t[0])), Math.max(...this.times.map((t) => t[t.length - 1]))];
    if (!(this.full[1] > this.full[0])) this.full = [this.full[0] - 0.5, this.full[0] + 0.5];
    this.span = [...this.full];
    this.panels = plot.panels.map((panel) => this.build(panel));
    this.buildLegend();
    new ResizeObserver(() => this.draw()).observe(host);
  }

  timesOf(time) {
    if (time.count) return Float64Array.from({ length: time.count }, (_, i) => time.start + i * time.step);
    const high = this.part(time.high), low = this.part(time.low); // sums of two, as one has not digits enough
    return Float64Array.from(high, (v, i) => v + low[i]);
  }

  part([from, count]) { return this.numbers.subarray(from, from + count); }

  // Least and greatest of every `size` samples of an array, counted from its beginning.
  blocks(values, size) {
    if (size === 1) return [values, values];
    values.blocks = values.blocks || {};
    if (!values.blocks[size]) {
      const finer = BLOCKS[BLOCKS.indexOf(size) - 1], [least, most] = this.blocks(values, finer), each = size / finer;
      const low = new Float32Array(Math.ceil(least.length / each)).fill(Infinity), high = low.map(() => -Infinity);
      for (let i = 0; i < least.length; i++) { // what is not finite is in no block
        const k = Math.floor(i / each);
        if (Math.abs(least[i]) < Infinity && least[i] < low[k]) low[k] = least[i];
        if (Math.abs(most[i]) < Infinity && most[i] > high[k]) high[k] = most[i];
      }
      values.blocks[size] = [low, high];
    }
    return values.blocks[size];
  }

  // The largest blocks of which at least two fall on a column of pixels.
  blockSize(samples, columns) { return BLOCKS.findLast((size) => size === 1 || samples >= 2 * size * columns); }

  colour({ joint, run }) {
    const colour = this.plot.colours[(this.byRun ? run : this.plot.places[joint]) % this.plot.colours.length];
    return colour === "#000000" ? this.style("--ink") : colour;
  }

  dash(series) {
    if (series.kind === "reference") return REFERENCES[series.run % REFERENCES.length];
    return DASHES[(Math.floor((this.byRun ? 0 : this.plot.places[series.joint]) / this.plot.colours.length) + series.run) % DASHES.length];
  }

  style(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }

  build(panel) {
    const figure = document.createElement("figure"), canvas = document.createElement("canvas");
    const caption = document.createElement("figcaption"), unit = document.createElement("span");
    figure.className = "panel";
    caption.textContent = panel.title;
    unit.textContent = `${panel.symbol} [${panel.unit}]`;
    caption.append(unit);
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${panel.title} in ${panel.unit} over time in s`);
    const tip = document.createElement("div");
    tip.className = "tip";
    tip.hidden = true;
    figure.append(caption, canvas, tip);
    this.host.append(figure);
    const built = { ...panel, canvas, tip, seen: "", series: panel.series.map((s) => ({ ...s,
      values: this.part(s.values), low: s.low && this.part(s.low), high: s.high && this.part(s.high) })) };
    this.listen(built);
    return built;
  }

  buildLegend() {
    const toggles = [];
    const add = (words, look, set, key, all) => {
      const button = document.createElement("button"), swatch = document.createElement("canvas");
      Object.assign(swatch, { width: 44, height: 16 });
      swatch.style.cssText = "width:22px;height:8px";
      button.append(swatch, words);
      button.title = "Click to hide or show, double-click for this one alone";
      const show = () => {
        button.setAttribute("aria-pressed", String(!set.has(key)));
        const g = swatch.getContext("2d"), [colour, dash] = look();
        g.clearRect(0, 0, 44, 16);
        Object.assign(g, { strokeStyle: colour, lineWidth: 6 });
        g.setLineDash(dash.map((v) => 2 * v));
        g.beginPath(); g.moveTo(0, 8); g.lineTo(44, 8); g.stroke();
      };
      button.onclick = () => { if (!set.delete(key)) set.add(key); this.draw(); };
      button.ondblclick = () => { all.forEach((other) => set.add(other)); set.delete(key); this.draw(); };
      toggles.push(show);
      this.legend.append(button);
    };
    const { joints, places, runs, colours, panels } = this.plot, byRun = this.byRun;
    if (!byRun) joints.forEach((name, joint) => add(name, () => [this.colour({ joint, run: 0 }),
      DASHES[Math.floor(places[joint] / colours.length) % DASHES.length]], this.hidden, joint, joints.keys()));
    if (runs.length > 1) runs.forEach(({ name }, run) => add(name, () => [byRun ? this.colour({ joint: 0, run }) : this.style("--quiet"),
      DASHES[run % DASHES.length]], this.hiddenRuns, run, runs.keys()));
    if (panels.some((panel) => panel.series.some((s) => s.kind === "reference")))
      add("reference", () => [this.style("--quiet"), REFERENCES[0]], this.hiddenKinds, "reference", ["line", "lane", "band"]);
    const reset = document.createElement("button");
    reset.className = "reset";
    reset.textContent = "Show all times";
    reset.onclick = () => this.look(...this.full);
    this.legend.append(reset);
    this.showLegend = () => { toggles.forEach((show) => show()); reset.disabled = this.span.every((v, i) => v === this.full[i]); };
  }

  // Shows the times from `low` to `high`, or the nearest that there are.
  look(low, high) {
    const whole = this.full[1] - this.full[0], wide = Math.min(Math.max(high - low, whole * 1e-6), whole);
    low = Math.min(Math.max((low + high - wide) / 2, this.full[0]), this.full[1] - wide);
    this.span = [low, low + wide];
    this.draw();
  }

  zoom(factor, t) { this.look(t - (t - this.span[0]) * factor, t + (this.span[1] - t) * factor); }

  listen(panel) {
    const { canvas } = panel, fingers = new Map();
    let drag = null;
    const x = (event) => event.clientX - canvas.getBoundingClientRect().left;
    const time = (px) => this.span[0] + (px - LEFT) / (canvas.clientWidth - LEFT - RIGHT) * (this.span[1] - this.span[0]);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.slide(event.deltaX, canvas, this.span);
      else this.zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * 0.006), time(x(event)));
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, x(event));
      const onAxis = event.offsetY > canvas.clientHeight - BOTTOM;
      drag = { from: x(event), span: [...this.span], moves: event.shiftKey || onAxis || event.pointerType === "touch",
        apart: fingers.size === 2 ? this.apart(fingers) : null };
    });
    canvas.addEventListener("pointermove", (event) => {
      if (fingers.has(event.pointerId)) fingers.set(event.pointerId, x(event));
      if (drag && fingers.size === 2 && drag.apart) {
        const [a, b] = fingers.values(), middle = drag.span[0] +
          ((a + b) / 2 - LEFT) / (canvas.clientWidth - LEFT - RIGHT) * (drag.span[1] - drag.span[0]);
        const factor = drag.apart / this.apart(fingers);
        this.look(middle - (middle - drag.span[0]) * factor, middle + (drag.span[1] - middle) * factor);
      } else if (drag && drag.moves) this.slide(drag.from - x(event), canvas, drag.span);
      else if (drag) this.selection = Math.abs(x(event) - drag.from) > 4 ? [time(drag.from), time(x(event))] : null;
      this.hover = { panel, t: Math.min(Math.max(time(x(event)), this.span[0]), this.span[1]) };
      this.draw();
    });
    const end = (event) => {
      if (drag && this.selection) this.look(Math.min(...this.selection), Math.max(...this.selection));
      else if (drag && this.onseek && event.type === "pointerup" && Math.abs(x(event) - drag.from) < 4) this.onseek(time(x(event)));
      fingers.delete(event.pointerId);
      drag = this.selection = null;
      this.draw();
    };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("pointerleave", () => { this.hover = null; this.draw(); });
    canvas.addEventListener("dblclick", () => this.look(...this.full));
    canvas.addEventListener("keydown", (event) => {
      const wide = this.span[1] - this.span[0], middle = (this.span[0] + this.span[1]) / 2;
      const act = { ArrowLeft: () => this.look(this.span[0] - wide / 8, this.span[1] - wide / 8), "+": () => this.zoom(0.7, middle),
        ArrowRight: () => this.look(this.span[0] + wide / 8, this.span[1] + wide / 8), "-": () => this.zoom(1 / 0.7, middle),
        0: () => this.look(...this.full) }[event.key];
      if (act) { event.preventDefault(); event.stopPropagation(); act(); }
    });
  }

  apart(fingers) { const [a, b] = fingers.values(); return Math.max(Math.abs(a - b), 10); }

  slide(pixels, canvas, from) {
    const shift = pixels / (canvas.clientWidth - LEFT - RIGHT) * (from[1] - from[0]), whole = this.full;
    const bounded = Math.min(Math.max(shift, whole[0] - from[0]), whole[1] - from[1]);
    this.look(from[0] + bounded, from[1] + bounded);
  }

  draw() {
    if (this.asked) return;
    this.asked = requestAnimationFrame(() => {
      this.asked = 0;
      this.showLegend();
      for (const panel of this.panels) this.drawPanel(panel);
    });
  }

  shown(panel) { return panel.series.filter((s) => !this.hidden.has(s.joint) && !this.hiddenRuns.has(s.run) && !this.hiddenKinds.has(s.kind)); }

  // First and last sample that matter for what is seen: one beyond each edge.
  window(series) {
    const t = this.times[series.run];
    return [Math.max(below(t, this.span[0]) - 1, 0), Math.min(below(t, this.span[1]) + 1, t.length)];
  }

  extent(panel) {
    let low = Infinity, high = -Infinity;
    for (const series of this.shown(panel)) {
      const [from, to] = this.window(series);
      const size = this.blockSize(to - from, panel.canvas.clientWidth);
      for (const values of [series.values, series.low, series.high]) if (values) {
        const [least, most] = this.blocks(values, size);
        for (let i = Math.floor(from / size); i * size < to; i++) {
          if (least[i] < low && least[i] > -Infinity) low = least[i];
          if (most[i] > high && most[i] < Infinity) high = most[i];
        }
      }
    }
    if (!(high >= low)) [low, high] = [-1, 1];
    const rounding = 2e-7 * Math.max(Math.abs(low), Math.abs(high), 1e-30), room = high - low > rounding ? (high - low) * 0.07
      : Math.max(Math.abs(low), Math.abs(high)) * 0.05 || 1;
    return [low - room, high + room];
  }

  // The curves are kept as a picture; pointing at them and playing only draw what is over it.
  drawPanel(panel) {
    const { canvas } = panel, ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width) return;
    const size = { width: Math.round(width * ratio), height: Math.round(height * ratio) }, [t0, t1] = this.span;
    const seen = [size.width, size.height, t0, t1, ...this.hidden, "|", ...this.hiddenRuns, "|", ...this.hiddenKinds, document.documentElement.dataset.theme].join();
    if (panel.seen !== seen) {
      panel.layer = Object.assign(document.createElement("canvas"), size);
      panel.extent = this.extent(panel);
    }
    const [low, high] = panel.extent;
    const X = (t) => LEFT + (t - t0) / (t1 - t0) * (width - LEFT - RIGHT), Y = (v) => TOP + (high - v) / (high - low) * (height - TOP - BOTTOM);
    if (panel.seen !== seen) this.drawLayer(panel, X, Y, ratio, width, height);
    panel.seen = seen;
    if (canvas.width !== size.width || canvas.height !== size.height) Object.assign(canvas, size);
    const g = canvas.getContext("2d");
    g.setTransform(1, 0, 0, 1, 0, 0);
    g.clearRect(0, 0, size.width, size.height);
    g.drawImage(panel.layer, 0, 0);
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (this.selection) {
      const [from, to] = this.selection.map((t) => Math.min(Math.max(X(t), LEFT), width - RIGHT));
      g.fillStyle = this.style("--wash");
      g.fillRect(from, TOP, to - from, height - TOP - BOTTOM);
    }
    this.drawCursor(g, this.cursor, X, height, "--accent", 1.6);
    this.drawHover(g, panel, X, Y, width, height);
  }

  drawLayer(panel, X, Y, ratio, width, height) {
    const g = panel.layer.getContext("2d"), [low, high] = panel.extent, [t0, t1] = this.span;
    g.scale(ratio, ratio);
    g.font = "11.5px system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif";
    Object.assign(g, { fillStyle: this.style("--quiet"), strokeStyle: this.style("--faint"), lineWidth: 1 });
    const rows = ticks(low, high, (height - TOP - BOTTOM) / 38), columns = ticks(t0, t1, (width - LEFT - RIGHT) / 76);
    g.beginPath();
    for (const v of rows.found) { g.moveTo(LEFT, Math.round(Y(v)) + 0.5); g.lineTo(width - RIGHT, Math.round(Y(v)) + 0.5); }
    for (const t of columns.found) { g.moveTo(Math.round(X(t)) + 0.5, TOP); g.lineTo(Math.round(X(t)) + 0.5, height - BOTTOM); }
    g.stroke();
    Object.assign(g, { textAlign: "right", textBaseline: "middle" });
    for (const v of rows.found) g.fillText(rows.write(v), LEFT - 7, Y(v));
    Object.assign(g, { textAlign: "center", textBaseline: "top" });
    const unitWide = 22;
    for (const t of columns.found) if (X(t) < width - RIGHT - unitWide - 12) g.fillText(columns.write(t), X(t), height - BOTTOM + 8);
    g.textAlign = "right";
    g.fillText("t [s]", width - RIGHT, height - BOTTOM + 8);
    g.save();
    g.beginPath(); g.rect(LEFT, TOP - 2, width - LEFT - RIGHT, height - TOP - BOTTOM + 4); g.clip();
    for (const series of this.shown(panel)) this.drawSeries(g, panel, series, X, Y);
    g.restore();
  }

  drawSeries(g, panel, series, X, Y) {
    const t = this.times[series.run], [from, to] = this.window(series);
    g.strokeStyle = g.fillStyle = this.colour(series);
    const size = this.blockSize(to - from, panel.canvas.clientWidth);
    if (series.low) {
      const low = this.blocks(series.low, size)[0], high = this.blocks(series.high, size)[1];
      const first = Math.floor(from / size), last = Math.ceil(to / size);
      g.globalAlpha = 0.2;
      g.beginPath();
      for (let i = first; i < last; i++) g.lineTo(X(t[i * size]), Y(high[i]));
      for (let i = last - 1; i >= first; i--) g.lineTo(X(t[i * size]), Y(low[i]));
      g.fill();
    }
    g.globalAlpha = series.kind === "lane" ? 0.6 : series.kind === "reference" ? 0.8 : 1;
    g.lineWidth = series.kind === "line" ? 1.7 : 1;
    g.lineJoin = "round";
    g.setLineDash(this.dash(series));
    g.beginPath();
    if (to - from > 3 * panel.canvas.clientWidth) this.trackColumns(g, t, series.values, from, to, X, Y, size);
    else this.trackSamples(g, t, series.values, from, to, X, Y, panel.held);
    g.stroke();
    g.setLineDash([]);
    g.globalAlpha = 1;
    if (to - from < 40 && !panel.held) for (let i = from; i < to; i++) { g.beginPath(); g.arc(X(t[i]), Y(series.values[i]), 2.2, 0, 7); g.fill(); }
  }

  trackSamples(g, t, values, from, to, X, Y, held) {
    let on = false, before = 0;
    for (let i = from; i < to; i++) {
      if (!Number.isFinite(values[i])) { on = false; continue; }
      const x = X(t[i]), y = Y(values[i]);
      if (!on) g.moveTo(x, y); else { if (held) g.lineTo(x, before); g.lineTo(x, y); }
      on = true;
      before = y;
    }
  }

  // Of each column of pixels the least and the greatest sample: looks as if all were drawn.
  trackColumns(g, t, values, from, to, X, Y, size) {
    const [least, most] = this.blocks(values, size);
    let on = false;
    for (let i = Math.floor(from / size); i * size < to;) {
      const column = Math.floor(X(t[i * size])), begin = i;
      let low = Infinity, high = -Infinity;
      for (; i * size < to && Math.floor(X(t[i * size])) === column; i++) {
        if (least[i] < low && least[i] > -Infinity) low = least[i];
        if (most[i] > high && most[i] < Infinity) high = most[i];
      }
      if (!(high >= low)) { on = false; continue; } // nothing that is known
      const first = values[begin * size], up = !(Math.abs(first - high) < Math.abs(first - low)); // the nearer end first
      for (const v of up ? [low, high] : [high, low]) { if (on) g.lineTo(column, Y(v)); else g.moveTo(column, Y(v)); on = true; }
    }
  }

  drawCursor(g, t, X, height, colour, wide) {
    if (t === null || t < this.span[0] || t > this.span[1]) return;
    Object.assign(g, { strokeStyle: this.style(colour), lineWidth: wide });
    g.beginPath(); g.moveTo(X(t), TOP); g.lineTo(X(t), height - BOTTOM); g.stroke();
  }

  // The sample of a series nearest to t; -1 where the run has ended, or has not begun.
  nearest(series, t) {
    const times = this.times[series.run], i = below(times, t), last = times.length - 1, slack = last ? (times[last] - times[0]) / last : 1;
    if (t < times[0] - slack || t > times[last] + slack) return -1;
    return i > 0 && (i === times.length || t - times[i - 1] < times[i] - t) ? i - 1 : i;
  }

  drawHover(g, panel, X, Y, width, height) {
    const { tip } = panel, here = this.hover;
    tip.hidden = !here || here.panel !== panel || Boolean(this.selection);
    if (!here) return;
    const shown = this.shown(panel), k = this.nearest({ run: 0 }, here.t), t = k < 0 ? here.t : this.times[0][k];
    this.drawCursor(g, t, X, height, "--quiet", 1);
    for (const series of shown) {
      const i = this.nearest(series, t), x = X(this.times[series.run][i]), y = Y(series.values[i]);
      if (!Number.isFinite(y) || x < LEFT || series.kind === "lane" || (panel !== here.panel && series.kind === "reference")) continue;
      g.fillStyle = this.colour(series);
      g.beginPath(); g.arc(x, y, 3.2, 0, 7); g.fill();
    }
    if (!tip.hidden) {
      this.fill(tip, panel, shown, t);
      const right = X(t) + 14 + tip.offsetWidth < width;
      tip.style.left = `${Math.max(8 + (right ? X(t) + 14 : X(t) - 14 - tip.offsetWidth), 2)}px`;
      tip.style.top = "34px";
    }
  }

  fill(tip, panel, shown, t) {
    const heads = [...new Set(shown.map((s) => `${s.run}|${s.kind === "lane" ? "lanes" : s.kind}`))];
    const several = this.plot.runs.length > 1 || heads.length > 1 || heads.some((head) => head.endsWith("reference"));
    const cell = (text, tag = "td") => Object.assign(document.createElement(tag), { textContent: text });
    const table = document.createElement("table"), head = table.insertRow();
    head.append(cell(`t = ${tidy(t)} s`, "th"));
    const chipOf = (series) => {
      const chip = document.createElement("span");
      chip.className = "chip";
      chip.style.background = this.colour(series);
      return chip;
    };
    for (const key of heads) {
      const [run, kind] = key.split("|"), named = this.plot.runs.length > 1 ? this.plot.runs[run].name : "";
      const words = { line: named || "run", reference: `${named} reference`, lanes: `${named} lanes`, band: `${named} median` }[kind];
      const told = cell(several ? `${words.trim()} [${panel.unit}]` : `[${panel.unit}]`, "th");
      if (this.byRun) told.prepend(chipOf({ joint: 0, run: +run }));
      head.append(told);
    }
    for (const joint of [...new Set(shown.map((s) => s.joint))]) {
      const row = table.insertRow(), name = cell(this.plot.joints[joint]);
      if (!this.byRun) name.prepend(chipOf({ joint, run: 0 }));
      row.append(name);
      for (const key of heads) {
        const own = shown.filter((s) => s.joint === joint && `${s.run}|${s.kind === "lane" ? "lanes" : s.kind}` === key);
        const values = own.map((s) => s.values[this.nearest(s, t)]), band = own.length === 1 && own[0].low;
        const at = own.length ? this.nearest(own[0], t) : -1;
        row.append(cell(!own.length ? "" : at < 0 ? "—" : band ? `${tidy(values[0])} (${tidy(own[0].low[at])} … ${tidy(own[0].high[at])})`
          : values.length > 1 ? `${tidy(Math.min(...values))} … ${tidy(Math.max(...values))}` : tidy(values[0])));
      }
    }
    tip.replaceChildren(table);
  }
}
