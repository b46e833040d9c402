// Panels of curves over one time axis: zoom, move, read values, hide curves. All that is drawn is described by plot_curves.py.
"use strict";

const LEFT = 58, RIGHT = 10, TOP = 6, BOTTOM = 26; // [px] around the curves
const FEW = 40; // samples in view: up to so many are marked with dots
const CLICK = 4; // [px] that the pointer may move in a click

const element = (tag, properties, ...children) => {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
};

const written = (v) => {
  if (!Number.isFinite(v)) return "—";
  const size = Math.abs(v), text = size !== 0 && (size < 1e-4 || size >= 1e6) ? v.toExponential(3) : +v.toPrecision(5) + "";
  return text.replace("-", "−");
};

// Round numbers that divide [low, high] into about `count` parts, and how they are written.
function ticks(low, high, count) {
  const raw = (high - low) / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= raw * 0.999);
  const found = [], decimals = Math.max(0, Math.min(12, -Math.floor(Math.log10(step) + 1e-9)));
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return { found, write: (v) => (Math.abs(v) >= 1e5 ? v.toExponential(1) : v.toFixed(decimals)).replace("-", "−") };
}

// Number of elements of an increasing array that are below v.
function below(sorted, v) {
  let low = 0, high = sorted.length;
  while (low < high) { const mid = (low + high) >> 1; if (sorted[mid] < v) low = mid + 1; else high = mid; }
  return low;
}

// Index of the time nearest to t; -1 before the first and after the last.
function nearest(times, t) {
  const i = below(times, t), last = times.length - 1, slack = last ? (times[last] - times[0]) / last : 1;
  if (t < times[0] - slack || t > times[last] + slack) return -1;
  return i > 0 && (i > last || t - times[i - 1] < times[i] - t) ? i - 1 : i;
}

class Charts {
  // plot: result of plot_data in plot_page.py; numbers: its Float32Array; onseek: called with the time that is clicked.
  constructor(host, legend, plot, numbers, onseek) {
    const part = ([from, count]) => numbers.subarray(from, from + count);
    Object.assign(this, { onseek, bandOpacity: plot.band_opacity, hidden: new Set(), cursor: null, hover: null, selection: null, drag: null });
    this.times = plot.times.map(({ start, step, count, high, low }) => {
      if (count) return Float64Array.from({ length: count }, (_, i) => start + i * step);
      const rest = part(low);
      return Float64Array.from(part(high), (v, i) => v + rest[i]);
    });
    this.full = [Math.min(...this.times.map((t) => t[0])), Math.max(...this.times.map((t) => t.at(-1)))];
    if (!(this.full[1] > this.full[0])) this.full = [this.full[0] - 0.5, this.full[0] + 0.5];
    this.span = this.full;
    this.panels = plot.panels.map((panel) => this.build(panel, part));
    host.append(...this.panels.map(({ figure }) => figure));
    this.buildLegend(legend, plot.legend);
    new ResizeObserver(() => this.draw()).observe(host);
  }

  build(panel, part) {
    const label = `${panel.title} in ${panel.unit} over time in s`, mark = (name) => element("div", { className: name, hidden: true });
    const canvas = element("canvas", { tabIndex: 0, role: "img", ariaLabel: label }), tip = mark("tip");
    const marks = { washed: mark("wash"), hover: mark("pointed"), cursor: mark("cursor") };
    const caption = element("figcaption", {}, panel.title, element("span", { textContent: `${panel.symbol} [${panel.unit}]` }));
    const figure = element("figure", { className: "panel" }, caption, element("div", {}, canvas, ...Object.values(marks), tip));
    const curves = panel.curves.map((curve) => ({ ...curve, values: part(curve.values), bands: curve.bands.map((band) => band.map(part)) }));
    const built = { ...panel, figure, canvas, marks, tip, curves };
    this.listen(built);
    return built;
  }

  buildLegend(host, entries) {
    const curves = this.panels.flatMap((panel) => panel.curves);
    for (const { name, group, value, colour, dash, width } of entries) {
      const own = `${group} ${value}`, button = element("button", { title: "Click to hide or show, double-click for this one alone" });
      button.innerHTML = `<svg width="26" height="8"><path d="M0 4H26" stroke="${colour}" stroke-width="${2 * width}" stroke-dasharray="${dash.map((v) => 2 * width * v)}"/></svg>`;
      button.append(name);
      button.onclick = () => { if (!this.hidden.delete(own)) this.hidden.add(own); this.draw(); };
      button.ondblclick = () => { for (const curve of curves) this.hidden.add(`${group} ${curve[group]}`); this.hidden.delete(own); this.draw(); };
      button.show = () => button.setAttribute("aria-pressed", String(!this.hidden.has(own)));
      host.append(button);
    }
    const reset = element("button", { className: "reset", textContent: "Show all times", onclick: () => this.look(...this.full) });
    reset.show = () => { reset.disabled = this.span.every((v, i) => v === this.full[i]); };
    host.append(reset);
    this.legend = [...host.children];
  }

  // Shows the times from `low` to `high`, or the nearest that there are.
  look(low, high) {
    const whole = this.full[1] - this.full[0], wide = Math.min(Math.max(high - low, whole * 1e-6), whole);
    low = Math.min(Math.max((low + high - wide) / 2, this.full[0]), this.full[1] - wide);
    this.span = wide === whole ? this.full : [low, low + wide];
    this.draw();
  }

  move(shift) { this.look(this.span[0] + shift, this.span[1] + shift); }

  zoom(factor, t) { this.look(t - (t - this.span[0]) * factor, t + (this.span[1] - t) * factor); }

  // Seconds per pixel.
  scale({ canvas }) { return (this.span[1] - this.span[0]) / (canvas.clientWidth - LEFT - RIGHT); }

  listen(panel) {
    const { canvas } = panel, time = (event) => this.span[0] + (event.offsetX - LEFT) * this.scale(panel);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.move(event.deltaX * this.scale(panel));
      else this.zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * 0.006), time(event));
    }, { passive: false });
    canvas.onpointerdown = (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.drag = { x: event.offsetX, t: time(event), moves: event.shiftKey || event.offsetY > canvas.clientHeight - BOTTOM };
    };
    canvas.onpointermove = (event) => {
      if (this.drag?.moves) this.move(this.drag.t - time(event));
      else if (this.drag) this.selection = Math.abs(event.offsetX - this.drag.x) > CLICK ? [this.drag.t, time(event)].sort((a, b) => a - b) : null;
      this.hover = { panel, t: Math.min(Math.max(time(event), this.span[0]), this.span[1]) };
      this.mark();
    };
    canvas.onpointerup = (event) => {
      if (this.selection) this.look(...this.selection);
      else if (this.drag && this.onseek && Math.abs(event.offsetX - this.drag.x) <= CLICK) this.onseek(time(event));
      this.drag = this.selection = null;
      this.mark();
    };
    canvas.onpointerleave = canvas.onpointercancel = () => { this.hover = this.drag = this.selection = null; this.mark(); };
    canvas.ondblclick = () => this.look(...this.full);
    canvas.onkeydown = (event) => {
      const wide = this.span[1] - this.span[0], middle = (this.span[0] + this.span[1]) / 2;
      const act = { ArrowLeft: () => this.move(-wide / 8), ArrowRight: () => this.move(wide / 8), 0: () => this.look(...this.full),
        "+": () => this.zoom(0.7, middle), "-": () => this.zoom(1 / 0.7, middle) }[event.key];
      if (act) { event.preventDefault(); event.stopPropagation(); act(); }
    };
  }

  draw() {
    this.asked ??= requestAnimationFrame(() => {
      this.asked = null;
      for (const button of this.legend) button.show();
      for (const panel of this.panels) this.drawPanel(panel);
      this.mark();
    });
  }

  style(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }

  shown(panel) { return panel.curves.filter((curve) => !["joint", "run", "series"].some((group) => this.hidden.has(`${group} ${curve[group]}`))); }

  // Points [x, value] in view and one beyond each edge; null is a gap. Of many samples in a column of pixels they are the first,
  // the least, the greatest and the last, which looks as if all were drawn.
  points(panel, { run }, values) {
    const t = this.times[run], scale = this.scale(panel), found = [];
    const from = Math.max(below(t, this.span[0]) - 1, 0), to = Math.min(below(t, this.span[1]) + 1, t.length);
    const many = to - from > 4 * panel.canvas.clientWidth;
    const add = (x, v) => { const last = found.at(-1); if (panel.stepped && last) found.push([x, last[1]]); found.push([x, v]); };
    for (let i = from; i < to;) {
      const x = LEFT + (t[i] - this.span[0]) / scale, first = values[i], end = this.span[0] + (Math.floor(x) + 1 - LEFT) * scale;
      let least = first, greatest = first, last = first;
      if (!Number.isFinite(first)) found.push(null);
      else if (many) {
        for (i++; i < to && t[i] < end && Number.isFinite(values[i]); i++) {
          last = values[i];
          if (last < least) least = last;
          if (last > greatest) greatest = last;
        }
        for (const v of [first, least, greatest, last]) add(Math.floor(x) + 0.5, v);
        continue;
      } else add(x, first);
      i++;
    }
    return found;
  }

  drawPanel(panel) {
    const { canvas } = panel, g = canvas.getContext("2d"), ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    if (!width) return;
    const traces = this.shown(panel).map((curve) => ({ curve, line: this.points(panel, curve, curve.values),
      bands: curve.bands.map((band) => band.map((edge) => this.points(panel, curve, edge))) }));
    let low = Infinity, high = -Infinity;
    for (const { line, bands } of traces) for (const points of [line, ...bands.flat()]) for (const point of points)
      if (point) { low = Math.min(low, point[1]); high = Math.max(high, point[1]); }
    if (!(high >= low)) [low, high] = [-1, 1];
    const size = Math.max(Math.abs(low), Math.abs(high)), level = high - low <= 2e-7 * size; // the rounding of single precision
    const room = level ? size * 0.05 || 1 : (high - low) * 0.07;
    low -= room;
    high += room;
    const X = (t) => LEFT + (t - this.span[0]) / this.scale(panel), Y = (v) => TOP + (high - v) / (high - low) * (height - TOP - BOTTOM);
    g.scale(ratio, ratio);
    this.drawGrid(g, ticks(low, high, (height - TOP - BOTTOM) / 38), ticks(...this.span, (width - LEFT - RIGHT) / 76), X, Y, width, height);
    g.beginPath();
    g.rect(LEFT, TOP - 2, width - LEFT - RIGHT, height - TOP - BOTTOM + 4);
    g.clip();
    const set = ({ colour, opacity, width, dash }) => {
      const own = colour === "currentColor" ? this.style("--ink") : colour;
      Object.assign(g, { fillStyle: own, strokeStyle: own, globalAlpha: opacity, lineWidth: width, lineJoin: "round" });
      g.setLineDash(dash.map((v) => v * width));
      g.beginPath();
    };
    for (const { curve, bands } of traces) for (const [lower, upper] of bands) {
      set({ ...curve, opacity: this.bandOpacity });
      for (const point of [...lower, ...upper.reverse()]) if (point) g.lineTo(point[0], Y(point[1]));
      g.fill();
    }
    for (const { curve, line } of traces) {
      set(curve);
      line.forEach((point, k) => { if (point) g[line[k - 1] ? "lineTo" : "moveTo"](point[0], Y(point[1])); });
      g.stroke();
      if (line.length < FEW && !panel.stepped) for (const point of line) if (point) { g.beginPath(); g.arc(point[0], Y(point[1]), 2.2, 0, 7); g.fill(); }
    }
  }

  drawGrid(g, rows, columns, X, Y, width, height) {
    Object.assign(g, { font: "11.5px system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif", fillStyle: this.style("--quiet"), strokeStyle: this.style("--faint") });
    g.beginPath();
    for (const v of rows.found) { g.moveTo(LEFT, Math.round(Y(v)) + 0.5); g.lineTo(width - RIGHT, Math.round(Y(v)) + 0.5); }
    for (const t of columns.found) { g.moveTo(Math.round(X(t)) + 0.5, TOP); g.lineTo(Math.round(X(t)) + 0.5, height - BOTTOM); }
    g.stroke();
    Object.assign(g, { textAlign: "right", textBaseline: "middle" });
    for (const v of rows.found) g.fillText(rows.write(v), LEFT - 7, Y(v), LEFT - 9);
    g.textBaseline = "top";
    g.fillText("t [s]", width - RIGHT, height - BOTTOM + 8);
    g.textAlign = "center";
    for (const t of columns.found) if (X(t) < width - RIGHT - 34) g.fillText(columns.write(t), X(t), height - BOTTOM + 8);
  }

  // Places what lies over the curves: the player's time, the pointer's time with its values, the times that are being selected.
  mark() {
    const run = this.hover && this.shown(this.hover.panel)[0]?.run, k = run == null ? -1 : nearest(this.times[run], this.hover.t);
    const t = this.hover && (k < 0 ? this.hover.t : this.times[run][k]);
    for (const panel of this.panels) {
      const X = (t) => LEFT + (t - this.span[0]) / this.scale(panel), { marks, tip, canvas } = panel;
      const place = (mark, from, to = from) => {
        mark.hidden = from === null || to < this.span[0] || from > this.span[1];
        if (mark.hidden) return;
        const [left, right] = [from, to].map((v) => X(Math.min(Math.max(v, this.span[0]), this.span[1])));
        Object.assign(mark.style, { left: `${left}px`, width: from === to ? "" : `${right - left}px` });
      };
      place(marks.cursor, this.cursor);
      place(marks.hover, t);
      place(marks.washed, ...(this.selection || [null]));
      tip.hidden = this.hover?.panel !== panel || Boolean(this.selection);
      if (tip.hidden) continue;
      tip.replaceChildren(this.table(panel, t));
      const right = X(t) + 14 + tip.offsetWidth < canvas.clientWidth;
      tip.style.left = `${Math.max(right ? X(t) + 14 : X(t) - 14 - tip.offsetWidth, 2)}px`;
    }
  }

  // Values at time t: a row for each joint and a column for each run or reference; of a single joint they are the rows.
  table(panel, t) {
    const shown = this.shown(panel), all = (group) => [...new Set(shown.map((curve) => curve[group]))];
    const [row, column] = all("joint").length > 1 ? ["joint", "series"] : ["series", "joint"];
    const heads = all(column).map((name) => element("th", { textContent: `${name} [${panel.unit}]`.trim() }));
    return element("table", {}, element("tr", {}, element("th", { textContent: `t = ${written(t)} s` }), ...heads),
      ...all(row).map((name) => element("tr", {}, element("td", { textContent: name }), ...all(column).map((head) =>
        this.cell(shown.filter((curve) => curve[row] === name && curve[column] === head), t)))));
  }

  // Value of a curve, or the least and the greatest of several lanes, at time t.
  cell(curves, t) {
    if (!curves.length) return element("td");
    const [{ run, bands: [band], values, colour }] = curves, at = nearest(this.times[run], t), chip = element("span", { className: "chip" });
    const lanes = curves.map((curve) => curve.values[at]).filter(Number.isFinite);
    chip.style.background = colour;
    return element("td", {}, chip, curves.length > 1 ? `${written(Math.min(...lanes))} … ${written(Math.max(...lanes))}`
      : written(values[at]) + (band ? ` (${band.map((edge) => written(edge[at])).join(" … ")})` : ""));
  }
}
