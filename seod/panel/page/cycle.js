// The limit cycle beside its model's, and Fig. 13: the frequency response, measured from here.

import { at, colour, figure } from "/static/common.js";
import { work } from "/static/jobs.js";
import { Plot, axes } from "/static/plots.js";

const EVERY_MS = 500;
const PERIODS = 3;

export class Cycle {
  constructor(wire, about, axis) {
    this.wire = wire; this.about = about; this.axis = axis; this.visible = false;
    this.estimates = new Map(); this.status = null; this.found = null;
    wire.hear("estimate", (estimate) => this.estimates.set(estimate.axis, estimate));
    wire.hear("panel", (status) => { this.status = status; });
    setInterval(() => this.update(), EVERY_MS);
    const line = (label, mark, dash) => ({ label, stroke: colour(mark), width: 1.5, dash, paths: curve, facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }] });
    this.portrait = new Plot(at("portrait"), 340, () => ({
      mode: 2, scales: { x: { time: false }, y: {} }, legend: { show: false },
      axes: axes(["deviation", "y"]).map((each, k) => ({ ...each, label: k ? "speed" : "deviation", scale: k ? "y" : "x" })),
      series: [{}, line("measured", "y"), line("model", "model", [7, 4])],
    }));
    const decibel = { x: { time: false, distr: 3 } };
    const shown = (name) => [{ label: "omega [rad/s]", value: (_, v) => figure(v) },
      { label: name, scale: name, stroke: colour("y"), paths: () => null, points: { show: true, size: 6 }, value: (_, v) => figure(v) },
      { label: "low", scale: name, stroke: colour("y"), width: 1, dash: [2, 3], spanGaps: true, value: (_, v) => figure(v) },
      { label: "high", scale: name, stroke: colour("y"), width: 1, dash: [2, 3], spanGaps: true, value: (_, v) => figure(v) },
      { label: "fit", scale: name, stroke: colour("model"), width: 2, value: (_, v) => figure(v) },
      { label: "limit cycle", scale: name, stroke: colour("u"), paths: () => null, points: { show: true, size: 12 }, value: (_, v) => figure(v) },
      ...(name === "phase [deg]" ? [] : [{ label: "coherence", scale: "coherence", stroke: colour("e"), width: 1, spanGaps: true, value: (_, v) => figure(v) }])];
    this.bode = ["gain [dB]", "phase [deg]"].map((name) => {
      const place = document.createElement("div");
      at("bode").append(place);
      return new Plot(place, 230, () => ({ scales: { ...decibel, coherence: { range: [0, 1.05] } }, series: shown(name),
        axes: axes(name === "phase [deg]" ? ["omega [rad/s]", name] : ["omega [rad/s]", name, "coherence"]) }));
    });
    at("bode-form").onsubmit = (event) => { event.preventDefault(); this.measure(event.target); };
  }

  show(visible) { this.visible = visible; if (visible) { this.update(); if (this.found) this.drawBode(); } }

  async update() {
    const axis = this.axis(), estimate = this.estimates.get(axis);
    if (!this.visible || !this.status || !this.wire.socket) return;
    if (!estimate || !estimate.frequency || this.status.axes[axis].state !== "exciting") {
      this.portrait.show([null, [[], []], [[], []]]);
      at("portrait-text").textContent = "The limit cycle is seen while the rig is excited.";
      return;
    }
    const period = (2 * Math.PI) / estimate.frequency, step = 1 / this.about.rate_hz;
    const end = this.status.t, start = end - PERIODS * period;
    const columns = Math.min(4096, Math.ceil((end - start) / step));
    let block;
    try { block = await this.wire.history(axis, start, end, columns); } catch (error) { return; }
    const y = [];
    for (let k = 0; k < block.columns; k++) y.push(0.5 * (block.table[2 * block.columns + k] + block.table[3 * block.columns + k]));
    const measured = portrait(y.filter((each) => Number.isFinite(each)), block.step);
    const model = modelled(estimate, this.status.axes[axis].e_a, this.about.axes[axis].mode);
    this.portrait.show([null, measured, model]);
    const { unit } = this.about.axes[axis];
    at("portrait-text").textContent = `deviation [${unit}] and its rate [${unit}/s]; dashed: the limit cycle of zeta ${figure(estimate.zeta)}, ` +
      `omega_n ${figure(estimate.omega_n)} rad/s under the relay`;
  }

  axisChanged() { this.update(); }

  async measure(form) {
    const said = at("bode-said");
    said.className = "";
    try {
      const body = { kind: "response", axis: this.axis(), input: form.input.value, amplitude: form.amplitude.value.trim() };
      this.found = (await work(this.about, said, body)).answer;
      this.drawBode();
    } catch (error) { said.textContent = error.message; said.className = "bad"; }
  }

  drawBode() {
    const { points, fit, limit_cycle: cycle, distortion, quality, message, output } = this.found;
    const decibels = (gain) => 20 * Math.log10(gain);
    const best = Object.fromEntries(["K_L", "omega_n", "zeta", "delay"].map((name) => [name, fit[name]?.value ?? 0]));
    const omegas = points.map((p) => p.omega);
    const grid = Array.from({ length: 160 }, (_, k) => omegas[0] * (omegas.at(-1) / omegas[0]) ** (k / 159));
    const all = [...new Set([...omegas, ...grid, ...(cycle ? [cycle.omega_n.value] : [])])].sort((a, b) => a - b);
    const of = new Map(points.map((p) => [p.omega, p]));
    const pick = (make) => all.map((omega) => (of.has(omega) ? make(of.get(omega)) : null));
    const fitted = all.map((omega) => transfer(best, omega, output));
    const at_ = cycle ? transfer({ K_L: cycle.K_L, omega_n: cycle.omega_n.value, zeta: cycle.zeta.value, delay: best.delay }, cycle.omega_n.value, output) : null;
    const only = (value) => all.map((omega) => (cycle && omega === cycle.omega_n.value ? value : null));
    this.bode[0].show([all, pick((p) => decibels(p.gain)), pick((p) => decibels(Math.max(p.gain - 1.96 * p.sd, 1e-3 * p.gain))),
      pick((p) => decibels(p.gain + 1.96 * p.sd)), fitted.map(([gain]) => decibels(gain)), only(at_ && decibels(at_[0])), pick((p) => p.coherence)]);
    const wide = (p) => (180 / Math.PI) * Math.atan2(1.96 * p.sd, p.gain);
    this.bode[1].show([all, pick((p) => p.phase), pick((p) => p.phase - wide(p)), pick((p) => p.phase + wide(p)),
      fitted.map(([, phase]) => phase), only(at_ && at_[1])]);
    const odd = distortion.odd ? `, distortion odd ${figure(100 * distortion.odd.level, 2)} %` : "";
    const even = distortion.even ? `, even ${figure(100 * distortion.even.level, 2)} %` : "";
    at("bode-said").textContent = `Fit: zeta ${figure(best.zeta)}, omega_n ${figure(best.omega_n)} rad/s, K_L ${figure(best.K_L)}, ` +
      `delay ${figure(1e3 * best.delay, 3)} ms; quality ${quality}${message ? ` (${message})` : ""}${odd}${even}`;
  }
}

// Eq. 1 at one frequency: gain, and phase in degrees.
function transfer({ K_L, omega_n, zeta, delay }, omega, output) {
  const x = omega / omega_n, real = 1 - x * x, imaginary = 2 * zeta * x;
  let gain = K_L / Math.hypot(real, imaginary), phase = -Math.atan2(imaginary, real) - omega * delay;
  if (output === "position") { gain /= omega; phase -= Math.PI / 2; }
  return [gain, (180 / Math.PI) * phase];
}

// Deviation from the mean, and its rate by central differences over 2 samples each side.
function portrait(y, step) {
  const mean = y.reduce((sum, each) => sum + each, 0) / y.length;
  const x = [], rate = [];
  for (let k = 2; k < y.length - 2; k++) {
    x.push((y[k - 1] + y[k] + y[k + 1]) / 3 - mean);
    rate.push((2 * (y[k + 2] - y[k - 2]) + (y[k + 1] - y[k - 1])) / (10 * step));
  }
  return [x, rate];
}

// The steady limit cycle of Eq. 1 under a square wave of the measured frequency.
function modelled({ zeta, omega_n, K_L, frequency }, e_a, mode) {
  if (![zeta, omega_n, K_L, frequency, e_a].every((each) => Number.isFinite(each) && each > 0)) return [[], []];
  const half = 200, step = Math.PI / frequency / half, x = [], rate = [];
  let v = 0, a = 0, y = 0, mean = 0;
  const settle = Math.ceil((12 / (zeta * omega_n)) * frequency / Math.PI) * 2 + 4;
  for (let k = 0; k < Math.min(settle, 400) * half; k++) {
    const u = Math.floor(k / half) % 2 ? -e_a : e_a;
    a += step * (omega_n * omega_n * (K_L * u - v) - 2 * zeta * omega_n * a);
    v += step * a; y += step * v;
    const last = k - (Math.min(settle, 400) - 2) * half;
    if (last >= 0) { x.push(mode === "velocity" ? v : y); rate.push(mode === "velocity" ? a : v); mean += mode === "velocity" ? v : y; }
  }
  mean /= x.length;
  return [[...x.map((each) => each - mean), x[0] - mean], [...rate, rate[0]]];
}

// A curve through points in their order, for uPlot's mode 2.
function curve(plot, index) {
  window.uPlot.orient(plot, index, (series, dataX, dataY, scaleX, scaleY, valToPosX, valToPosY, left, top, width, height) => {
    const [x, y] = plot.data[index];
    const path = new Path2D();
    x.forEach((value, k) => {
      const px = valToPosX(value, scaleX, width, left), py = valToPosY(y[k], scaleY, height, top);
      if (k) path.lineTo(px, py); else path.moveTo(px, py);
    });
    plot.ctx.save();
    plot.ctx.strokeStyle = series.stroke(plot, index); plot.ctx.lineWidth = 1.5; plot.ctx.setLineDash(series.dash || []);
    plot.ctx.stroke(path);
    plot.ctx.restore();
  });
  return null;
}
