// Fig. 10: u, y and the relay's input, live, triggered, or a minute of the past.

import { at, colour, figure, make } from "/static/common.js";
import { Plot, axes } from "/static/plots.js";
import { Strip } from "/static/strip.js";
import { LIVE, SWEEP } from "/static/wire.js";

const MOST_AXES = 4;
const PAST_S = 60;
const CHUNK = 4096;
const POINTS = 1200;
const BEHIND = 3; // messages that may wait: the panel sends one a frame, but not in step with the screen

export class Scope {
  constructor(wire, about) {
    this.wire = wire; this.about = about;
    this.names = Object.keys(about.axes);
    this.shown = this.names.slice(0, MOST_AXES);
    this.strips = new Map();
    this.paused = false;
    this.visible = true;
    this.frames = 0;
    this.intervals = 0;
    this.waiting = [];
    this.drawing = false;
    this.number = 0;
    this.clock = 0;
    wire.hear("panel", (status) => { this.clock = status.t; });
    for (const id of ["span", "mode"]) at(id).onchange = () => this.begin();
    at("again").onclick = () => this.begin();
    at("pause").onclick = () => (this.paused ? this.resume() : this.pause());
    at("scope-axes").append(...this.names.map((name) => this.choice(name)));
    document.addEventListener("visibilitychange", () => this.begin()); // a page in the background is sent nothing
    setInterval(() => this.count(), 1000);
  }

  choice(name) {
    const box = make("input", { type: "checkbox", checked: this.shown.includes(name) });
    box.onchange = () => {
      this.shown = this.names.filter((each) => (each === name ? box.checked : this.shown.includes(each))).slice(0, MOST_AXES);
      this.begin();
    };
    return make("label", { class: "check" }, box, ` ${name}`);
  }

  // Ask for what is to be seen; on a new connection as well.
  async begin() {
    if (this.paused || !this.visible || document.hidden) {
      if (this.wire.socket) await this.wire.ask("view", { axes: [], mode: "off" }).catch(() => {});
      return;
    }
    const columns = Math.max(200, Math.min(1200, Math.floor(at("strips").clientWidth) || 800));
    this.mode = at("mode").value;
    const span = Number(at("span").value);
    this.strips.clear();
    for (const name of this.shown) this.strips.set(this.names.indexOf(name), new Strip(name, this.about.axes[name], columns));
    at("strips").replaceChildren(...[...this.strips.values()].map((strip) => strip.element));
    this.waiting = [];
    try {
      const answer = await this.wire.ask("view", { axes: this.shown, span, columns, mode: this.mode });
      this.number = answer.number;
    } catch (error) { this.number = 0; }
  }

  take(blocks) {
    this.waiting.push(blocks);
    if (!this.drawing) this.nextFrame();
  }

  nextFrame() {
    this.drawing = this.waiting.length > 0;
    if (this.drawing) requestAnimationFrame(() => { this.draw(); this.nextFrame(); });
  }

  // One message a frame, so that two that come close together fill two frames; all of them when it falls behind.
  draw() {
    const blocks = this.waiting.splice(0, this.waiting.length > BEHIND ? this.waiting.length : 1).flat();
    let drawn = false;
    for (const block of blocks) {
      const strip = this.strips.get(block.axis);
      if (!strip || block.number < this.number) continue;
      drawn = true;
      this.intervals += block.columns;
      if (block.kind === LIVE) strip.add(block); else if (block.kind === SWEEP) strip.show(block);
    }
    if (drawn) this.frames += 1;
  }

  count() {
    if (!this.visible) return;
    at("frames").textContent = this.paused ? "paused" : `${this.frames} frames/s`;
    document.documentElement.dataset.frames = String(this.frames);
    this.frames = 0;
  }

  theme() {
    for (const strip of this.strips.values()) strip.theme();
  }

  show(visible) {
    this.visible = visible;
    if (visible && this.paused) this.drawPast(); else this.begin();
  }

  // ---- the past: all of the last minute comes here, so that nothing is lost however long one looks

  async pause() {
    this.paused = true;
    at("pause").textContent = "Go on"; at("pause").setAttribute("aria-pressed", "true");
    const newest = this.clock;
    this.past = new Map();
    this.plots = [];
    this.begin();
    for (const name of this.shown) this.past.set(name, await this.fetch(name, newest));
    const span = Number(at("span").value);
    this.window = [newest - span, newest];
    this.from = newest - PAST_S; this.to = newest;
    at("strips").hidden = true; at("past").hidden = false;
    this.build();
    this.drawPast();
  }

  async fetch(name, newest) {
    const step = Math.max(1 / this.about.rate_hz, 5e-4);
    const whole = { step, parts: [] };
    for (let start = newest - PAST_S; start < newest; start += CHUNK * step) {
      const end = Math.min(newest, start + CHUNK * step);
      whole.parts.push(await this.wire.history(name, start, end, CHUNK));
    }
    return whole;
  }

  resume() {
    this.paused = false;
    at("pause").textContent = "Pause"; at("pause").setAttribute("aria-pressed", "false");
    for (const plot of this.plots || []) plot.remove();
    this.plots = [];
    at("past").replaceChildren();
    at("strips").hidden = false; at("past").hidden = true;
    this.begin();
  }

  build() {
    this.cursors = [null, null];
    const scroll = make("input", { type: "range", min: 0, max: 1000, value: 1000, "aria-label": "Scroll through the last minute" });
    scroll.oninput = () => {
      const span = this.window[1] - this.window[0];
      const begin = this.from + (Number(scroll.value) / 1000) * (PAST_S - span);
      this.move(begin, begin + span);
    };
    const zoom = (factor) => () => {
      const middle = 0.5 * (this.window[0] + this.window[1]), half = 0.5 * factor * (this.window[1] - this.window[0]);
      this.move(middle - half, middle + half);
    };
    this.read = make("span", { id: "cursors", role: "status" }, "Click sets cursor A, shift and click cursor B.");
    const buttons = [
      make("button", { type: "button", id: "zoom-in", onclick: zoom(0.5) }, "Zoom in"),
      make("button", { type: "button", id: "zoom-out", onclick: zoom(2) }, "Zoom out"),
      make("button", { type: "button", id: "whole", onclick: () => this.move(this.from, this.to) }, "All"),
    ];
    const marks = ["A", "B"].map((letter, number) => make("button", { type: "button", onclick: () => this.put(number, 0),
      title: "Arrow keys move it, with shift by one sample", onkeydown: (event) => this.nudge(number, event) }, `Cursor ${letter}`));
    at("past").replaceChildren(make("p", { class: "row bar" }, ...buttons, ...marks, scroll, this.read));
    scroll.style.flex = "1";
    this.plots = this.shown.map((name) => {
      const place = make("div", { class: "past-plot" });
      at("past").append(make("h3", {}, name), place);
      const plot = new Plot(place, 260, () => this.options(name));
      plot.axis = name;
      return plot;
    });
  }

  options(name) {
    const about = this.about.axes[name];
    const series = (label, scale, mark) => ({ label, scale, stroke: colour(mark), width: 1.25, value: (_, v) => figure(v) });
    const y = `y [${about.unit}]`, e = `error [${about.signal_unit}]`, u = `u [${about.command_unit}]`;
    const shown = axes(["t [s]", y, u]);
    return {
      scales: { x: { time: false } },
      series: [{ label: "t", value: (_, v) => figure(v, 8) }, series("y", y, "y"), series("error", e, "e"), series("u", u, "u")],
      axes: shown, cursor: { drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => null } },
      hooks: {
        setSelect: [(plot) => this.zoomTo(plot)],
        ready: [(plot) => plot.over.addEventListener("click", (event) => this.mark(plot, name, event))],
        draw: [(plot) => this.drawCursors(plot, name)],
      },
    };
  }

  zoomTo(plot) {
    const { left, width } = plot.select;
    if (width < 5) return;
    const begin = plot.posToVal(left, "x"), end = plot.posToVal(left + width, "x");
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.zoomed = performance.now();
    this.move(begin, end);
  }

  move(begin, end) {
    const span = Math.max(4 / this.about.rate_hz, Math.min(PAST_S, end - begin));
    begin = Math.max(this.from, Math.min(begin, this.to - span));
    this.window = [begin, begin + span];
    this.drawPast();
  }

  // A cursor by key: into the middle, then by arrows.
  nudge(number, event) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step) return;
    event.preventDefault();
    this.put(number, step * (event.shiftKey ? 1 / this.about.rate_hz : (this.window[1] - this.window[0]) / 100));
  }

  put(number, by) {
    const plot = this.plots[0].plot, time = plot.data[0];
    const t = this.cursors[number] ? this.cursors[number].t + by : 0.5 * (this.window[0] + this.window[1]);
    let index = time.findIndex((each) => each >= t);
    if (index < 0) index = time.length - 1;
    if (by && this.cursors[number]?.t === time[index]) index += Math.sign(by);
    this.set(number, this.plots[0].axis, plot, Math.max(0, Math.min(index, time.length - 1)));
  }

  mark(plot, name, event) {
    if (performance.now() - (this.zoomed || 0) < 300) return;
    const index = plot.cursor.idx;
    if (index === null || index === undefined) return;
    this.set(event.shiftKey ? 1 : 0, name, plot, index);
  }

  set(number, name, plot, index) {
    const values = plot.data.map((column) => column[index]);
    this.cursors[number] = { name, t: values[0], y: values[1], e: values[2], u: values[3] };
    const [a, b] = this.cursors;
    if (a && b) {
      const unit = this.about.axes[name].unit;
      this.read.textContent = `A to B: dt = ${figure(b.t - a.t)} s (${figure(1 / Math.abs(b.t - a.t))} Hz), ` +
        `dy = ${figure(b.y - a.y)} ${unit}, du = ${figure(b.u - a.u)} ${this.about.axes[name].command_unit}`;
    } else this.read.textContent = `${number ? "B" : "A"}: t = ${figure(values[0], 8)} s, y = ${figure(values[1])}`;
    for (const each of this.plots) if (each.plot) each.plot.redraw();
  }

  drawCursors(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    this.cursors.forEach((cursor, number) => {
      if (!cursor || cursor.t < this.window[0] || cursor.t > this.window[1]) return;
      const x = plot.valToPos(cursor.t, "x", true);
      ctx.strokeStyle = ctx.fillStyle = colour(number ? "model" : "accent");
      ctx.beginPath(); ctx.moveTo(x, bbox.top); ctx.lineTo(x, bbox.top + bbox.height); ctx.stroke();
      ctx.fillText(number ? "B" : "A", x + 3, bbox.top + 12);
    });
    ctx.restore();
  }

  drawPast() {
    for (const plot of this.plots || []) plot.show(this.cut(this.past.get(plot.axis)));
  }

  // Lowest and highest in as many intervals as the screen can show, as one line for each signal.
  cut(whole) {
    const [begin, end] = this.window;
    const width = Math.max(whole.step, (end - begin) / POINTS);
    const time = [], lines = [[], [], []], order = [1, 2, 0];
    let low = [NaN, NaN, NaN], high = [NaN, NaN, NaN], k = -1;
    const flush = () => {
      if (k < 0) return;
      const t = begin + (k + 0.5) * width, split = width > 1.5 * whole.step;
      time.push(t); if (split) time.push(t + 0.4 * width);
      for (let s = 0; s < 3; s++) {
        const gone = Number.isNaN(low[s]);
        lines[s].push(gone ? null : low[s]); if (split) lines[s].push(gone ? null : high[s]);
      }
      low = [NaN, NaN, NaN]; high = [NaN, NaN, NaN];
    };
    for (const part of whole.parts) {
      const first = Math.max(0, Math.floor((begin - part.start) / part.step));
      const last = Math.min(part.columns, Math.ceil((end - part.start) / part.step));
      for (let c = first; c < last; c++) {
        const place = Math.floor((part.start + c * part.step - begin) / width + 1e-6);
        if (place !== k) { flush(); k = place; }
        for (let s = 0; s < 3; s++) {
          const a = part.table[2 * order[s] * part.columns + c], b = part.table[(2 * order[s] + 1) * part.columns + c];
          if (!(low[s] <= a)) low[s] = a;
          if (!(high[s] >= b)) high[s] = b;
        }
      }
    }
    flush();
    return [time, ...lines];
  }
}
