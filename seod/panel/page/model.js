// The model beside the rig: its error live, and what a diagnosis of the last seconds says.

import { at, colour, figure } from "/static/common.js";
import { showDiagnosis, work } from "/static/jobs.js";
import { Plot, axes } from "/static/plots.js";

const KEPT = 2000;

export class Model {
  constructor(wire, about, axis) {
    this.about = about; this.axis = axis; this.visible = false;
    this.errors = new Map();
    this.plot = new Plot(at("model-plot"), 220, () => ({
      scales: { x: { time: false } }, axes: axes(["t [s]", "error [%]"]),
      series: [{ label: "t", value: (_, v) => figure(v) },
        { label: "error [%]", scale: "error [%]", stroke: colour("y"), width: 1.5, points: { show: true, size: 5 }, value: (_, v) => figure(v) },
        { label: "noise [%]", scale: "error [%]", stroke: colour("quiet"), width: 1, value: (_, v) => figure(v) },
        { label: "tolerance [%]", scale: "error [%]", stroke: colour("bad"), width: 1, dash: [6, 4], value: (_, v) => figure(v) }],
    }));
    wire.hear("model_error", (error) => this.told(error));
    at("diagnose").onsubmit = (event) => { event.preventDefault(); this.diagnose(event.target); };
  }

  show(visible) { this.visible = visible; if (visible) this.draw(); }

  axisChanged() { this.draw(); }

  told(error) {
    if (!this.errors.has(error.axis)) this.errors.set(error.axis, []);
    const kept = this.errors.get(error.axis);
    kept.push(error);
    if (kept.length > KEPT) kept.shift();
    if (this.visible && error.axis === this.axis()) this.draw();
  }

  draw() {
    const kept = this.errors.get(this.axis()) || [];
    if (!this.visible) return;
    const newest = kept.at(-1);
    if (!newest) { at("model-now").textContent = "Nothing yet: the model is simulated while the rig is excited."; return; }
    const said = newest.left ? "The rig has left its model." : "The rig keeps to its model.";
    at("model-now").textContent = `${said} Error ${figure(100 * newest.nrmse, 3)} % of the movement (rms ${figure(newest.rms, 3)}), ` +
      `systematic ${figure(newest.statistic, 3)} of ${figure(newest.significant, 3)}; model: ${newest.model}`;
    at("model-now").className = newest.left ? "bad" : "ok";
    this.plot.show([kept.map((each) => each.t - newest.t), kept.map((each) => 100 * each.nrmse),
      kept.map((each) => (each.rms ? (100 * each.nrmse * each.noise) / each.rms : null)), kept.map((each) => 100 * each.tolerance)]);
  }

  async diagnose(form) {
    const place = at("job");
    try {
      const body = { kind: "diagnose", axis: this.axis(), seconds: Number(form.seconds.value), effort: form.effort.value };
      showDiagnosis(place, await work(this.about, place, body));
    } catch (error) { place.textContent = error.message; }
  }
}
