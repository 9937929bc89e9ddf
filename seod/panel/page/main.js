// The page: which view is seen, what the panel says, and what shows that it says nothing any more.

import { at, figure } from "/static/common.js";
import { Controls } from "/static/controls.js";
import { armEstop } from "/static/estop.js";
import { Cycle } from "/static/cycle.js";
import { Fleet } from "/static/fleet.js";
import { Health } from "/static/health.js";
import { Model } from "/static/model.js";
import { themeChanged } from "/static/plots.js";
import { Recordings } from "/static/recordings.js";
import { RigFile } from "/static/rigfile.js";
import { Scope } from "/static/scope.js";
import { Trends } from "/static/trends.js";
import { Wire, request } from "/static/wire.js";

const SILENT_MS = 700; // the panel speaks every 200 ms

const about = await (await fetch("/api/about")).json();
if (about.error) location.assign("/login");

document.title = `${about.rig}: seod`;
at("rig").textContent = about.rig;
at("simulated").hidden = !about.simulated;
at("logout").hidden = !about.needs_token;

const wire = new Wire(about);
const axis = () => at("axis").value;
const controls = new Controls(wire, about);
const views = {
  scope: new Scope(wire, about), trends: new Trends(wire, about, axis), cycle: new Cycle(wire, about, axis),
  model: new Model(wire, about, axis), health: new Health(wire), recordings: new Recordings(wire, about),
  rigfile: new RigFile(about),
};
if (about.fleet) views.fleet = new Fleet();
else { at("tab-fleet").remove(); at("view-fleet").remove(); }
let heard = 0;
let fault = "";
let estopSaid = "";

function alarm() {
  at("alert").textContent = [estopSaid, fault].filter(Boolean).join(" · ");
  at("alert").hidden = !at("alert").textContent;
}

armEstop(wire, about, (text) => { estopSaid = text; alarm(); });

wire.onBlocks = (blocks) => views.scope.take(blocks);
wire.onOpen = async () => {
  views.scope.begin();
  controls.load();
  const { events } = await wire.ask("events");
  views.health.began(events);
};
wire.onClose = () => look();
wire.hear("panel", (status) => { heard = performance.now(); tell(status); });
wire.hear("estimate", (estimate) => views.trends.advise(estimate));

function badge(element, text, mark) {
  if (element.textContent !== text) element.textContent = text;
  element.className = `badge ${mark}`;
}

function tell(status) {
  const stale = status.stale || !status.gateway;
  document.body.classList.toggle("stale", stale);
  if (!status.gateway) badge(at("link"), "the gateway is gone: it is started again", "bad");
  else if (status.stale) badge(at("link"), `stale: no rows for ${figure(status.rows_age_s, 2)} s`, "bad");
  else badge(at("link"), "live", "ok");
  const states = Object.entries(status.axes);
  const order = ["fault", "exciting", "holding", "armed", "idle"];
  const worst = order.find((state) => states.some(([, each]) => each.state === state)) || "?";
  badge(at("state"), worst, worst === "fault" ? "bad" : worst === "idle" ? "" : "warn");
  const faults = states.filter(([, each]) => each.fault).map(([name, each]) => `${name}: ${each.fault.code}: ${each.fault.why}`);
  fault = [...new Set(faults)].join(" · ");
  at("who").textContent = status.commander.name && !status.commander.you ? `${status.commander.name} commands` : "";
  alarm();
}

// Nothing heard: that is as stale as rows that do not come.
function look() {
  if (performance.now() - heard < SILENT_MS && wire.socket) return;
  document.body.classList.add("stale");
  badge(at("link"), wire.socket ? "stale: the panel is silent" : "stale: the panel is gone, trying again", "bad");
}
setInterval(look, 200);

function choose(name) {
  for (const tab of document.querySelectorAll("nav button")) {
    const chosen = tab.dataset.view === name;
    tab.setAttribute("aria-selected", String(chosen));
    tab.tabIndex = chosen ? 0 : -1;
    at(`view-${tab.dataset.view}`).hidden = !chosen;
  }
  for (const [each, view] of Object.entries(views)) view.show(each === name);
  history.replaceState(null, "", `#${name}`);
}
const tabs = [...document.querySelectorAll("nav button")];
tabs.forEach((tab, number) => {
  tab.onclick = () => choose(tab.dataset.view);
  tab.onkeydown = (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const next = tabs[(number + step + tabs.length) % tabs.length];
    next.focus(); choose(next.dataset.view);
  };
});
choose(views[location.hash.slice(1)] ? location.hash.slice(1) : "scope");

at("theme").onclick = () => {
  const dark = getComputedStyle(document.documentElement).colorScheme === "dark";
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  localStorage.setItem("seod-theme", document.documentElement.dataset.theme);
  themeChanged();
  views.scope.theme();
};
at("logout").onclick = async () => { await request(about, "POST", "/logout"); location.assign("/login"); };
at("axis").addEventListener("change", () => { for (const view of Object.values(views)) if (view.axisChanged) view.axisChanged(); });
