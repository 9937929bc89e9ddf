// All rigs at the broker: state, newest estimate, trend, whether a rig has left its model.

import { at, figure, make, withSd } from "/static/common.js";

const EVERY_MS = 2000;
const HEADS = ["rig", "axis", "state", "zeta", "omega_n [rad/s]", "zeta since", "model", "heard"];
const SVG = "http://www.w3.org/2000/svg";

function spark(values) {
  const svg = document.createElementNS(SVG, "svg"), line = document.createElementNS(SVG, "polyline");
  const low = Math.min(...values), span = Math.max(...values) - low || 1, last = Math.max(1, values.length - 1);
  svg.setAttribute("viewBox", "0 0 100 20");
  svg.setAttribute("preserveAspectRatio", "none");
  svg.setAttribute("class", "spark");
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", values.length ? `zeta from ${figure(values[0])} to ${figure(values.at(-1))}` : "no trend");
  line.setAttribute("points", values.map((v, k) => `${((100 * k) / last).toFixed(1)},${(19 - (18 * (v - low)) / span).toFixed(1)}`).join(" "));
  svg.append(line);
  return svg;
}

function row(each) {
  const live = each.standing === "live", state = live ? each.state || "?" : each.standing;
  const bad = state === "fault" || state === "dead";
  const fault = live && each.fault ? `${state}: ${each.fault.code}` : state;
  const model = each.left_model === null ? "–" : each.left_model ? "left" : "fits";
  return make("tr", {}, make("th", { scope: "row" }, each.rig), make("td", {}, each.axis),
    make("td", { class: bad ? "bad" : live ? "" : "warn" }, fault),
    make("td", { class: "number" }, withSd(each.zeta, each.zeta_sd)), make("td", { class: "number" }, withSd(each.omega_n, each.omega_n_sd)),
    make("td", {}, spark(each.trend)), make("td", { class: each.left_model ? "bad" : "" }, model),
    make("td", { class: "number" }, each.silent_s === null ? "–" : `${figure(Math.round(each.silent_s))} s ago`));
}

export class Fleet {
  constructor() {
    this.visible = false;
    setInterval(() => this.list(), EVERY_MS);
  }

  show(visible) { this.visible = visible; if (visible) this.list(); }

  async list() {
    if (!this.visible) return;
    let got;
    try { got = await (await fetch("/api/fleet")).json(); } catch { return; } // the badge above tells that the panel is gone
    at("fleet-said").textContent = got.error || got.broker;
    if (got.error) return;
    at("fleet").replaceChildren(make("thead", {}, make("tr", {}, ...HEADS.map((name) => make("th", { scope: "col" }, name)))),
      make("tbody", {}, ...got.rows.map(row)));
  }
}
