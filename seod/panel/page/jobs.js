// Work that takes long: a diagnosis, a frequency response. It runs beside all else, at low priority.

import { figure, make } from "/static/common.js";
import { request } from "/static/wire.js";

const LOOK_MS = 400;

// Start a job and show how far it is; resolves with its answer.
export async function work(about, place, body) {
  const { job } = await request(about, "POST", "/api/jobs", body);
  const bar = make("progress", { max: 1, value: 0, "aria-label": "How far it is" });
  const step = make("p", { class: "quiet", role: "status" }, "it begins");
  const cancel = make("button", { type: "button" }, "Cancel");
  cancel.onclick = () => request(about, "DELETE", `/api/jobs/${job}`);
  place.replaceChildren(make("div", { class: "row" }, cancel), bar, step);
  for (;;) {
    await new Promise((resolve) => { setTimeout(resolve, LOOK_MS); });
    const state = await (await fetch(`/api/jobs/${job}`)).json();
    bar.value = state.part || 0;
    step.textContent = `${state.step || "it begins"} (${figure(100 * (state.part || 0), 2)} %, ${figure(state.seconds, 3)} s)`;
    if (state.state === "running") continue;
    place.replaceChildren();
    if (state.state === "failed") throw new Error(state.error);
    return { ...state, job };
  }
}

// A diagnosis in words and figures.
export function showDiagnosis(place, state) {
  const d = state.answer;
  const words = { clean: "The model misses nothing.", effects: "The model misses something.", unexplained: "The model misses something that none of the causes explains." };
  const base = (name, each) => make("tr", {}, make("th", { scope: "row" }, name),
    ...["K_L", "omega_n", "zeta"].map((key) => make("td", { class: "number" }, figure(each?.[key]?.value ?? each?.[key]))),
    make("td", { class: "number" }, each?.holdout_nrmse === undefined ? "–" : `${figure(100 * each.holdout_nrmse, 3)} %`));
  const rows = [base("baseline", d.baseline)];
  if (d.extended) rows.push(base("extended", d.extended));
  const effects = (d.effects || []).map((effect) => make("li", {}, make("strong", {}, effect.name.replaceAll("_", " ")), ": ",
    Object.entries(effect.parameters).map(([name, p]) =>
      `${name} ${figure(p.value)}${p.unit && p.unit !== "1" ? ` ${p.unit}` : ""} [${(p.ci95 || []).map((v) => figure(v)).join(", ")}]`).join("; "),
    effect.indistinguishable_from?.length ? `; cannot be told from ${effect.indistinguishable_from.join(", ")}` : ""));
  place.replaceChildren(
    make("p", { id: "verdict" }, make("strong", {}, words[d.verdict] || d.verdict)),
    make("table", {}, make("tr", {}, ...["", "K_L", "omega_n [rad/s]", "zeta", "held-out error"].map((each) => make("th", {}, each))), ...rows),
    make("ul", {}, ...effects),
    d.next_experiment ? make("p", {}, `Next experiment: ${d.next_experiment.input}: ${d.next_experiment.reason}`) : null,
    make("p", {}, ...(state.files || []).flatMap((name) => [
      make("a", { href: `/api/jobs/${state.job}/files/${name}`, download: name === "report.html" ? undefined : name, target: "_blank" }, name), "  "])),
  );
}
