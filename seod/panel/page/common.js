// Small things that several views need.

export const at = (id) => document.getElementById(id);

export function make(tag, fields = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(fields)) {
    if (name === "class") element.className = value;
    else if (name.includes("-") || name === "for") element.setAttribute(name, value);
    else element[name] = value;
  }
  element.append(...children.filter((each) => each !== null && each !== undefined));
  return element;
}

export function figure(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return Number(value.toPrecision(digits)).toString();
}

export function withSd(value, sd, digits = 4) {
  return sd === null || sd === undefined ? figure(value, digits) : `${figure(value, digits)} ± ${figure(1.96 * sd, 2)}`;
}

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export const QUALITIES = {
  ok: "ok", settling: "accent", no_oscillation: "quiet", asymmetric: "warn", nonlinear: "warn", noisy: "warn",
  saturated: "warn", stale: "quiet", out_of_range: "warn", fault: "bad",
};

// A table of two columns; rows are [name, value].
export function fill(table, rows) {
  table.replaceChildren(...rows.map(([name, value]) =>
    make("tr", {}, make("th", { scope: "row" }, name), make("td", { class: "number" }, value))));
}
