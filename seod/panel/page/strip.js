// A strip chart of one axis: each frame draws only the intervals that are new, so that it costs next to nothing.
// Three lanes: y, the relay's input, u. The table of a block holds lowest and highest of u, y and signal.

import { colour, figure, make } from "/static/common.js";

const LANES = [["y", 1], ["e", 2], ["u", 0]]; // name, place in the table
const LANE_PX = 74;
const GAP = 12; // columns cleared in front of what is drawn

export class Strip {
  constructor(name, about, columns) {
    this.about = about;
    this.columns = columns;
    this.table = new Float32Array(6 * columns).fill(NaN);
    this.last = null;
    this.canvas = make("canvas", { width: columns, height: LANES.length * LANE_PX });
    this.canvas.style.height = `${LANES.length * LANE_PX}px`;
    this.context = this.canvas.getContext("2d", { alpha: false, willReadFrequently: true });
    this.scales = LANES.map(() => null);
    this.told = LANES.map(([mark], lane) => {
      const element = make("span", { class: `scale mark-${mark}` });
      element.style.top = `${(100 * lane) / LANES.length + 1}%`;
      return element;
    });
    this.now = make("span", { class: "quiet" });
    const units = { y: about.unit, e: about.signal_unit, u: about.command_unit };
    const marks = LANES.map(([mark]) => make("span", { class: `mark-${mark}` }, `${mark === "e" ? "error" : mark} [${units[mark]}]`));
    this.element = make("div", { class: "strip" }, make("h3", {}, name, ...marks, this.now),
      make("div", { class: "lanes" }, this.canvas, ...this.told));
    this.theme();
  }

  theme() {
    this.ground = colour("ground");
    this.colours = LANES.map(([mark]) => colour(mark));
    this.line = colour("grid");
    this.redraw();
  }

  clear() {
    this.table.fill(NaN);
    this.last = null;
    this.scales = LANES.map(() => null);
    this.redraw();
  }

  // New intervals, the first of number `block.start`.
  add(block) {
    const { columns } = this;
    if (this.last !== null && block.start > this.last + 1) this.wipe(this.last + 1, Math.min(block.start - this.last - 1, columns));
    for (let k = 0; k < block.columns; k++) {
      const place = (block.start + k) % columns;
      for (let row = 0; row < 6; row++) this.table[row * columns + place] = block.table[row * block.columns + k];
    }
    this.last = block.start + block.columns - 1;
    if (this.rescale(block)) this.redraw(); else this.draw(block.start, block.columns);
  }

  // One sweep: all of the screen.
  show(block) {
    this.table.fill(NaN);
    const count = Math.min(block.columns, this.columns);
    for (let row = 0; row < 6; row++) {
      this.table.set(block.table.subarray(row * block.columns, row * block.columns + count), row * this.columns);
    }
    this.last = null;
    this.rescale(block);
    this.redraw();
  }

  wipe(from, count) {
    for (let k = from; k < from + count; k++) {
      for (let row = 0; row < 6; row++) this.table[row * this.columns + (k % this.columns)] = NaN;
    }
  }

  // Whether a scale had to change: it grows at once, and shrinks where it is far too wide after a whole screen.
  rescale(block) {
    let changed = false;
    LANES.forEach(([, place], lane) => {
      let [low, high] = range(block.table, 2 * place * block.columns, 2 * block.columns);
      if (low > high) return;
      const scale = this.scales[lane];
      const whole = this.last === null || this.last % this.columns < block.columns;
      if (scale && low >= scale[0] && high <= scale[1] && !whole) return;
      if (whole && scale) {
        const [a, b] = range(this.table, 2 * place * this.columns, 2 * this.columns);
        low = Math.min(low, a); high = Math.max(high, b);
        if (low >= scale[0] && high <= scale[1] && high - low > 0.4 * (scale[1] - scale[0])) return;
      } else if (scale) { low = Math.min(low, scale[0]); high = Math.max(high, scale[1]); }
      const room = 0.08 * (high - low) || Math.max(1e-9, 0.05 * Math.abs(high));
      this.scales[lane] = [low - room, high + room];
      this.told[lane].textContent = `${figure(low, 3)} … ${figure(high, 3)}`;
      changed = true;
    });
    return changed;
  }

  redraw() {
    this.context.fillStyle = this.ground;
    this.context.fillRect(0, 0, this.columns, this.canvas.height);
    this.draw(0, this.columns, false);
  }

  draw(start, count, gap = true) {
    const { context, columns, table } = this;
    const height = this.canvas.height;
    for (let from = start % columns, rest = count + (gap ? GAP : 0); rest > 0;) {
      const width = Math.min(rest, columns - from);
      context.fillStyle = this.ground;
      context.fillRect(from, 0, width, height);
      context.fillStyle = this.line;
      for (let lane = 1; lane < LANES.length; lane++) context.fillRect(from, lane * LANE_PX, width, 1);
      rest -= width; from = 0;
    }
    for (let lane = 0; lane < LANES.length; lane++) {
      const scale = this.scales[lane];
      if (!scale) continue;
      context.fillStyle = this.colours[lane];
      const low = 2 * LANES[lane][1] * columns, high = low + columns;
      const top = lane * LANE_PX + 2, size = LANE_PX - 4, factor = size / (scale[1] - scale[0]);
      for (let k = start; k < start + count; k++) {
        const place = k % columns, before = (k - 1 + columns) % columns;
        let a = table[low + place], b = table[high + place];
        if (!(a <= b)) continue;
        if (place > 0 && table[low + before] <= table[high + before]) { // joined to what is before it
          a = Math.min(a, table[high + before]); b = Math.max(b, table[low + before]);
        }
        const y = top + (scale[1] - b) * factor;
        context.fillRect(place, y, 1.5, Math.max(1.5, (b - a) * factor));
      }
    }
  }
}

function range(values, from, count) {
  let low = Infinity, high = -Infinity;
  for (let k = from; k < from + count; k++) {
    const value = values[k];
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}
