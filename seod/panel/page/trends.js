// Figs. 11 and 12: zeta, omega_n and K_L with their intervals of 95 %, pressure and temperature, over hours.

import { at, colour, figure, make, QUALITIES } from "/static/common.js";
import { Plot, axes } from "/static/plots.js";

const EVERY_MS = 1000;
const POINTS = 1500;

export class Trends {
  constructor(wire, about, axis) {
    this.wire = wire; this.about = about; this.axis = axis;
    this.columns = null; this.of = null; this.visible = false;
    at("qualities").append(...Object.entries(QUALITIES).map(([word, mark]) =>
      make("span", { class: "quality" }, make("span", { class: `dot ${mark}` }), word.replaceAll("_", " "))));
    for (const dot of at("qualities").querySelectorAll(".dot")) dot.style.color = `var(--${dot.classList[1]})`;
    at("last").onchange = () => this.draw();
    this.plots = ["zeta", "omega_n", "K_L"].map((name) => this.plot(name));
    const place = make("div", {});
    at("trend-plots").append(place);
    this.conditions = new Plot(place, 170, () => ({
      scales: { x: { time: false } }, axes: axes(["t [s]", "supply pressure [MPa]", "temperature [K]"]), legend: { show: true },
      series: [{ label: "t", value: (_, v) => figure(v) },
        { label: "supply pressure [MPa]", scale: "supply pressure [MPa]", stroke: colour("u"), width: 1.5, value: (_, v) => figure(v) },
        { label: "temperature [K]", scale: "temperature [K]", stroke: colour("model"), width: 1.5, value: (_, v) => figure(v) }],
    }));
    setInterval(() => this.update(), EVERY_MS);
  }

  plot(name) {
    const place = make("div", { id: `trend-${name}` });
    at("trend-plots").append(place);
    const unit = { zeta: "zeta", omega_n: "omega_n [rad/s]", K_L: "K_L" }[name];
    const plot = new Plot(place, 190, () => ({
      scales: { x: { time: false } }, axes: axes(["t [s]", unit]),
      series: [{ label: "t", value: (_, v) => figure(v) },
        { label: unit, scale: unit, stroke: colour("y"), width: 1.5, spanGaps: false, value: (_, v) => figure(v, 5) },
        { label: "low", scale: unit, stroke: "transparent", value: (_, v) => figure(v, 5) },
        { label: "high", scale: unit, stroke: "transparent", value: (_, v) => figure(v, 5) }],
      bands: [{ series: [3, 2], fill: `${colour("y")}40` }],
      hooks: { draw: [(chart) => this.ribbon(chart)] },
    }));
    plot.quantity = name;
    return plot;
  }

  show(visible) { this.visible = visible; if (visible) this.update(); }

  async update() {
    if (!this.visible || !this.wire.socket) return;
    const axis = this.axis();
    const since = this.of === axis && this.columns && this.columns.t.length ? this.columns.t.at(-1) : null;
    try {
      const got = await this.wire.ask("trends", since === null ? { axis } : { axis, since });
      if (since === null) this.columns = got;
      else for (const key of Object.keys(got)) this.columns[key].push(...got[key]);
      this.of = axis;
    } catch (error) { return; }
    this.draw();
  }

  draw() {
    if (!this.columns || !this.columns.t.length) return;
    const { t } = this.columns, newest = t.at(-1), last = Number(at("last").value);
    const first = Math.max(0, t.findIndex((each) => each >= newest - last));
    const every = Math.max(1, Math.floor((t.length - first) / POINTS));
    const kept = t.map((_, k) => k).filter((k) => k >= first && (k - first) % every === 0);
    const pick = (key, factor = 1) => kept.map((k) => (this.columns[key][k] === null ? null : factor * this.columns[key][k]));
    const time = kept.map((k) => t[k] - newest);
    this.qualities = kept.map((k) => this.columns.quality[k]);
    for (const plot of this.plots) {
      const value = pick(plot.quantity), sd = pick(`${plot.quantity}_sd`);
      const edge = (sign) => value.map((each, k) => (each === null || sd[k] === null ? null : each + sign * 1.96 * sd[k]));
      plot.show([time, value, edge(-1), edge(1)]);
    }
    const pressure = pick("ps", 1e-6), temperature = pick("temperature");
    this.conditions.place.hidden = ![...pressure, ...temperature].some((each) => each !== null);
    if (!this.conditions.place.hidden) this.conditions.show([time, pressure, temperature]);
  }

  // Quality as colour along the upper edge.
  ribbon(chart) {
    if (!this.qualities || chart.data[0].length !== this.qualities.length) return;
    const { ctx, bbox } = chart;
    ctx.save();
    chart.data[0].forEach((t, k) => {
      const x = chart.valToPos(t, "x", true);
      const next = k + 1 < chart.data[0].length ? chart.valToPos(chart.data[0][k + 1], "x", true) : x + 3;
      ctx.fillStyle = colour(QUALITIES[this.qualities[k]] || "quiet");
      ctx.fillRect(x, bbox.top, Math.max(1, next - x), 6);
    });
    ctx.restore();
  }

  advise(estimate) {
    if (estimate.axis !== this.axis()) return;
    at("advice").textContent = estimate.quality === "ok" ? "" : `${estimate.quality.replaceAll("_", " ")}: ${estimate.advice || ""}`;
  }
}
