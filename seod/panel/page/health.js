// How well the loop keeps its time, and what is lost.

import { at, colour, figure, fill, make } from "/static/common.js";
import { Plot, axes } from "/static/plots.js";

const EVENTS = 200;

export class Health {
  constructor(wire) {
    this.visible = false; this.before = null; this.newest = null;
    this.free = null;
    wire.hear("panel", (status) => { this.free = status.disk_free; });
    this.edges = Array.from({ length: 64 }, (_, k) => 2 ** (k / 4));
    this.plot = new Plot(at("lateness"), 240, () => ({
      scales: { x: { time: false, distr: 3, log: 10 }, ticks: { distr: 3, log: 10 } },
      axes: axes(["lateness [us]", "ticks"]),
      series: [{ label: "to [us]", value: (_, v) => figure(v, 3) },
        { label: "since start", scale: "ticks", stroke: colour("quiet"), width: 1, paths: window.uPlot.paths.stepped({ align: -1 }) },
        { label: "last second", scale: "ticks", stroke: colour("y"), fill: `${colour("y")}55`, width: 1.5,
          paths: window.uPlot.paths.stepped({ align: -1 }) }],
    }));
    wire.hear("health", (health) => { this.before = this.newest; this.newest = health; if (this.visible) this.draw(); });
    wire.hear("event", (event) => this.told(event));
  }

  show(visible) { this.visible = visible; if (visible && this.newest) this.draw(); }

  began(events) {
    at("events").replaceChildren();
    for (const event of events) this.told(event);
  }

  told(event) {
    const { event: kind, t, axis, why, ...rest } = event;
    const numbers = ["state", "previous", "values", "code"].filter((key) => rest[key] !== undefined)
      .map((key) => `${key} ${JSON.stringify(rest[key])}`).join(", ");
    const mark = kind === "fault" ? "bad" : kind === "warning" ? "warn" : "";
    at("events").prepend(make("li", { class: mark }, `${figure(t, 9)} s  ${axis || "rig"}: ${kind} ${numbers} ${why || ""}`));
    while (at("events").children.length > EVENTS) at("events").lastChild.remove();
  }

  draw() {
    const health = this.newest, bins = health.lateness.bins;
    const last = this.before ? bins.map((count, k) => count - this.before.lateness.bins[k]) : bins;
    const used = bins.reduce((most, count, k) => (count ? k : most), 20) + 2;
    const shown = (counts) => counts.slice(0, used).map((count) => (count > 0 ? count : null));
    this.plot.show([this.edges.slice(0, used), shown(bins), shown(last)]);
    const us = (value) => `${figure(value, 3)} us`;
    const row = (name, each) => [name, `${us(each.p50_us)} / ${us(each.p99_us)} / ${us(each.p999_us)} / ${us(each.max_us)}`];
    fill(at("latencies"), [["", "50 % / 99 % / 99.9 % / most"], row("lateness", health.lateness), row("execution", health.execution)]);
    const { clients, recorder, bus_log: bus, counters } = health;
    fill(at("counts"), [
      ["real-time", health.realtime.ok ? "yes" : `no: ${health.realtime.why.join("; ")}`],
      ["ticks", figure(health.ticks, 12)], ["rate", `${figure(health.rate_hz)} Hz`], ["overruns", figure(health.overruns, 12)],
      ["rows lost", figure(health.rows_lost, 12)], ["events lost", figure(health.events_lost, 12)],
      ["age of samples", `${figure(1e3 * health.sample_age_s, 3)} ms, at most ${figure(1e3 * health.sample_age_max_s, 3)} ms`],
      ["clients", `${clients.connected ?? "–"}, ${clients.waiting ?? 0} wait`],
      ...(recorder ? Object.entries(recorder).map(([name, value]) => [`recorder: ${name.replaceAll("_", " ")}`, String(value ?? "–")]) : [["recorder", "none"]]),
      ["free disk", `${figure(this.free / 1e9, 4)} GB`],
      ...(bus ? Object.entries(bus).map(([name, value]) => [`bus log: ${name}`, String(value ?? "–")]) : []),
      ...Object.entries(counters).map(([name, value]) => [`driver: ${name.replaceAll("_", " ")}`, String(value)]),
    ]);
  }
}
