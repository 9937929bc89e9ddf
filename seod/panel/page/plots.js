// uPlot in our colours.

import { colour } from "/static/common.js";

const all = new Set();

export function axes(names) {
  return names.map((label, number) => ({
    label, scale: number === 0 ? "x" : label, stroke: colour("text"), grid: { stroke: colour("grid"), show: number < 2 },
    ticks: { stroke: colour("grid") }, size: number === 0 ? 42 : 62, side: number === 0 ? 2 : number % 2 ? 3 : 1,
    labelSize: 18, font: "12px system-ui", labelFont: "12px system-ui",
  }));
}

// A plot that fills the width of its place and is drawn anew in another theme: `options()` is asked then.
export class Plot {
  constructor(place, height, options) {
    this.place = place; this.height = height; this.options = options; this.data = null; this.plot = null;
    all.add(this);
    new ResizeObserver(() => this.fit()).observe(place);
  }

  fit() {
    if (this.plot && this.place.clientWidth) this.plot.setSize({ width: this.place.clientWidth, height: this.height });
  }

  show(data, keep = false) {
    this.data = data;
    if (!this.place.clientWidth) return;
    if (this.plot) { this.plot.setData(data, !keep); return; }
    const given = this.options();
    this.plot = new window.uPlot({ width: this.place.clientWidth, height: this.height, ...given }, data, this.place);
  }

  again() {
    if (this.plot) { this.plot.destroy(); this.plot = null; }
    if (this.data) this.show(this.data);
  }

  remove() {
    if (this.plot) this.plot.destroy();
    all.delete(this);
  }
}

export function themeChanged() {
  for (const plot of all) plot.again();
}
