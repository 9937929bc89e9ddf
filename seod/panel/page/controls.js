// What commands the rig: settings, start, stop, reset, and who may do so. The e-stop has its own file.

import { at, figure, make, withSd } from "/static/common.js";

const LABELS = {
  e_a: "e_a", hysteresis: "Hysteresis", bias: "Bias", K_L: "K_L", reference: "Reference", two_phase: "Two phases",
  trim: "Trim the bias", method: "Estimator",
};
const METHODS = ["wave", "exact", "peaks"];

export class Controls {
  constructor(wire, about) {
    this.wire = wire; this.about = about;
    this.fields = new Map();
    this.edited = new Set();
    at("axis").append(...Object.keys(about.axes).map((name) => make("option", {}, name)));
    at("axis").onchange = () => { this.edited.clear(); this.load(); };
    at("take").onclick = () => this.try(() => wire.ask("take"), "you command now");
    at("release").onclick = () => this.try(() => wire.ask("release"), "you command no longer");
    for (const op of ["start", "stop", "reset"]) {
      at(op).onclick = () => this.try(() => wire.ask(op, this.which()), `${op}: done`);
    }
    at("settings").onsubmit = (event) => { event.preventDefault(); this.set(); };
    if (about.command) for (const id of ["start", "stop", "reset"]) at(id).disabled = false; // the page begins with none
    wire.hear("event", (event) => {
      if (event.event === "changed" && event.axis === this.axis) this.fill(event.values);
    });
    wire.hear("estimate", (estimate) => { if (estimate.axis === this.axis) this.tell(estimate); });
    wire.hear("panel", (status) => this.status(status));
    if (about.dead_man) setInterval(() => this.hold(), 250 * about.dead_man);
  }

  get axis() { return at("axis").value; }

  which() { return at("all").checked ? {} : { axis: this.axis }; }

  async try(what, done) {
    const said = at("said");
    try {
      await what();
      said.textContent = done; said.className = "ok";
    } catch (error) { said.textContent = error.message; said.className = "bad"; }
  }

  // The settings in force, and the newest estimate.
  async load() {
    if (this.loading) return;
    this.loading = true;
    try {
      const got = await this.wire.ask("get", { axis: this.axis });
      this.units = got.units;
      this.build(got.settings);
      if (got.estimate) this.tell(got.estimate);
    } catch (error) { at("said").textContent = error.message; } finally { this.loading = false; }
  }

  build(settings) {
    this.fields.clear();
    const rows = [];
    for (const [name, value] of Object.entries(settings)) {
      const unit = this.units[name] ? ` [${this.units[name]}]` : "";
      const input = this.field(name, value);
      input.id = `set-${name}`; input.oninput = input.onchange = () => this.edited.add(name);
      input.disabled = !this.about.command;
      this.fields.set(name, input);
      rows.push(make("label", { for: input.id }, (LABELS[name] || name) + unit), input);
    }
    rows.push(make("button", { type: "submit", id: "set", disabled: !this.about.command }, "Set"));
    at("settings").replaceChildren(...rows);
  }

  field(name, value) {
    if (typeof value === "boolean") return make("input", { type: "checkbox", checked: value });
    if (name === "method") return make("select", {}, ...METHODS.map((each) => make("option", { selected: each === value }, each)));
    return make("input", { type: "text", inputMode: "decimal", value: value === null ? "" : figure(value, 6) });
  }

  fill(values) {
    for (const [name, value] of Object.entries(values)) {
      const input = this.fields.get(name);
      if (!input || this.edited.has(name)) continue;
      if (input.type === "checkbox") input.checked = value; else input.value = typeof value === "number" ? figure(value, 6) : value ?? "";
    }
  }

  set() {
    const params = { axis: this.axis };
    for (const name of this.edited) {
      const input = this.fields.get(name);
      const text = input.value.trim().replace(",", ".");
      params[name] = input.type === "checkbox" ? input.checked : name === "method" ? input.value : Number(text);
      if (text === "" || Number.isNaN(params[name])) {
        at("said").textContent = `${name}: must be a number`; at("said").className = "bad";
        return;
      }
    }
    this.try(async () => {
      const answer = await this.wire.ask("set", params);
      this.edited.clear();
      this.fill(answer.settings);
    }, "set");
  }

  status(status) {
    const { name, you } = status.commander;
    this.you = you;
    if (status.reaches_gateway && !this.fields.size) this.load();
    at("commander").textContent = you ? "You command." : name ? `${name} commands.` : "Nobody commands.";
    at("take").disabled = you || !this.about.command;
    at("release").disabled = !you;
  }

  // The dead man's switch: a page that hangs, or goes, lets the rig go.
  hold() {
    if (this.you) this.wire.ask("keepalive").catch(() => {});
  }

  tell(estimate) {
    const rows = [
      ["zeta", withSd(estimate.zeta, estimate.zeta_sd)],
      ["omega_n", `${withSd(estimate.omega_n, estimate.omega_n_sd)} rad/s`],
      ["K_L", withSd(estimate.K_L, estimate.K_L_sd)],
      ["limit cycle", `${figure(estimate.frequency)} rad/s, ${figure(estimate.amplitude)} ${this.about.axes[this.axis].signal_unit}`],
      ["quality", estimate.quality],
    ];
    const list = make("dl", {}, ...rows.flatMap(([name, value]) => [make("dt", {}, name), make("dd", { id: `now-${name}` }, value)]));
    at("estimate").replaceChildren(make("h2", {}, "Estimate, ± 95 %"), list, make("p", { class: "quiet" }, estimate.advice || ""));
  }
}
