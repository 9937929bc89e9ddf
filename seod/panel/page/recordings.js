// Recordings: begun and ended from here, listed, fetched, looked at, diagnosed.

import { at, figure, make } from "/static/common.js";
import { showDiagnosis, work } from "/static/jobs.js";
import { Plot, axes } from "/static/plots.js";
import { colour } from "/static/common.js";

const EVERY_MS = 2000;

export class Recordings {
  constructor(wire, about) {
    this.wire = wire; this.about = about; this.visible = false; this.recorder = null; this.rows = new Map();
    wire.hear("health", (health) => { this.recorder = health.recorder; this.tell(); });
    at("record").onclick = () => this.toggle();
    at("record").disabled = !about.command;
    setInterval(() => this.list(), EVERY_MS);
  }

  show(visible) { this.visible = visible; if (visible) this.list(); }

  tell() {
    const on = this.recorder !== null;
    at("record").textContent = on ? "End the recording" : "Record";
    at("recorder").textContent = on
      ? `${this.recorder.file}: ${figure(this.recorder.rows, 9)} rows, ${this.recorder.lost} lost${this.recorder.error ? `; ${this.recorder.error}` : ""}`
      : "Nothing is recorded.";
  }

  async toggle() {
    try {
      const answer = await this.wire.ask("record", { on: this.recorder === null });
      this.recorder = answer.recorder; this.tell(); this.list();
    } catch (error) { at("recorder").textContent = error.message; }
  }

  async list() {
    if (!this.visible) return;
    const got = await (await fetch("/api/recordings")).json();
    if (got.error) {
      this.rows.clear();
      at("recordings").replaceChildren(make("tr", {}, make("td", {}, got.error)));
      return;
    }
    // A row stays the same element while its recording is there: a press on its button is not lost to a refresh.
    const rows = got.recordings.map((each) => {
      const row = this.rows.get(each.name) || this.row(each.name);
      row.bytes.textContent = `${figure(each.bytes / 1e6, 3)} MB`;
      row.changed.textContent = new Date(1000 * each.changed).toLocaleString();
      return [each.name, row];
    });
    const names = (all) => JSON.stringify([...all].map(([name]) => name));
    const same = names(rows) === names(this.rows);
    this.rows = new Map(rows);
    if (!same) at("recordings").replaceChildren(...rows.map(([, row]) => row.whole));
  }

  row(name) {
    const bytes = make("td", { class: "number" }), changed = make("td", {});
    const whole = make("tr", {},
      make("td", {}, make("a", { href: `/api/recordings/${encodeURIComponent(name)}`, download: name }, name)), bytes, changed,
      make("td", {}, make("button", { type: "button", onclick: () => this.replay(name) }, "Replay"), " ",
        make("button", { type: "button", onclick: () => this.diagnose(name) }, "Diagnose")));
    return { whole, bytes, changed };
  }

  async diagnose(name) {
    const place = at("recording-job");
    try {
      const axis = at("axis").value;
      showDiagnosis(place, await work(this.about, place, { kind: "diagnose", recording: name, axis, effort: "quick" }));
    } catch (error) { place.textContent = error.message; }
  }

  // The recording runs past as it was, at any speed.
  async replay(name) {
    const place = at("recording-job");
    place.textContent = "it is read";
    const axis = at("axis").value;
    const answer = await fetch(`/api/recordings/${encodeURIComponent(name)}/rows?axis=${encodeURIComponent(axis)}`);
    const got = await answer.json();
    if (!answer.ok) { place.textContent = got.error; return; }
    const chart = make("div", {}), speed = make("select", { "aria-label": "Speed" },
      ...[0.1, 1, 10, 100].map((each) => make("option", { value: each, selected: each === 1 }, `${each} times`)));
    const scroll = make("input", { type: "range", min: 0, max: 1000, value: 0, "aria-label": "Where in the recording" });
    const go = make("button", { type: "button" }, "Pause");
    place.replaceChildren(make("p", { class: "row" }, make("strong", {}, name), go, speed, scroll), chart);
    scroll.style.flex = "1";
    const plot = new Plot(chart, 280, () => ({
      scales: { x: { time: false } }, axes: axes(["t [s]", "y", "u"]),
      series: [{ label: "t", value: (_, v) => figure(v, 6) }, { label: "y", scale: "y", stroke: colour("y"), value: (_, v) => figure(v) },
        { label: "u", scale: "u", stroke: colour("u"), value: (_, v) => figure(v) }],
    }));
    const whole = got.t.at(-1) || 0, window_ = Math.min(2, whole || 1);
    let now = window_, last = performance.now(), runs = true;
    go.onclick = () => { runs = !runs; go.textContent = runs ? "Pause" : "Go on"; };
    scroll.oninput = () => { now = window_ + (Number(scroll.value) / 1000) * (whole - window_); };
    const turn = () => {
      if (!chart.isConnected) { plot.remove(); return; }
      const passed = (performance.now() - last) / 1000;
      last = performance.now();
      if (runs) now = Math.min(whole, now + passed * Number(speed.value));
      if (whole > window_) scroll.value = String((1000 * (now - window_)) / (whole - window_));
      const first = lower(got.t, now - window_), end = lower(got.t, now);
      const every = Math.max(1, Math.floor((end - first) / 1500));
      const cut = (values) => values.slice(first, end).filter((_, k) => k % every === 0);
      plot.show([cut(got.t), cut(got.y), cut(got.u)]);
      setTimeout(turn, 66);
    };
    turn();
  }
}

function lower(sorted, value) {
  let low = 0, high = sorted.length;
  while (low < high) { const middle = (low + high) >> 1; if (sorted[middle] < value) low = middle + 1; else high = middle; }
  return low;
}
