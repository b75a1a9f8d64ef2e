// The charts of the page and the picture of the instrument: which traces stand in which, and which part of their
// values is shown, calmly.
import { draw, nice } from "./chart.js";
import { BIN_PX, interact } from "./interaction.js";
import { ends, valueAt } from "./layers.js";
import { drawVessel } from "./vessel.js";

const CALM_MS = 4000; // so long a smaller range must do before the axis shrinks
const LAG_S = 0.06; // the newest bins are still open
const FRESH_S = 1; // so long the newest value stands where none follows
const DOTTED = [0.1, 5], DASHED = [7, 5];

export class Charts {
  constructor(force, position, picture, wants) {
    Object.assign(this, { force, position, picture, frame: null, hover: null, picked: null });
    Object.assign(this, { vessel: null, friction: {}, late_ms: null, reach_mm: [], box_mm: null, rows: null });
    this.ranges = [new Range(0.05, 5), new Range(0.05, 2), new Range(0.5, 3)];
    const hover = (x, from = null) => {
      this.hover = x;
      this.picked = x === null ? null : from;
      wants.again();
    };
    interact(force, () => this.frame, { ...wants, hover });
  }

  draw(traces, now_s, window_s) {
    const end = now_s - LAG_S, start = end - window_s;
    const bin_s = (window_s * BIN_PX) / Math.max(200, this.force.clientWidth);
    const of = (name) => traces.between(name, start, end, bin_s);
    const millimetres = (rows) => rows.map(([t, v]) => [t, v === null ? null : 1e3 * v]);
    const predicted = of("predicted"), late = of("late");
    const line = (name, colour, rows, more = {}) => ({ name, colour, rows, digits: 3, ...more });
    // one that is scaled for the hand would dwarf the others
    const [most_n, most_felt_n] = this.ranges.map((range) => Math.max(-range.min, range.max));
    const by = most_felt_n > 3 * most_n ? nice(most_felt_n / most_n) : 1;
    const felt = line(by === 1 ? "felt" : `felt / ${by}`, "felt", of("felt").map(([t, v]) => [t, v === null ? null : v / by]), { width: 5, alpha: 0.55 });
    const panels = [
      {
        title: "force at the catheter, N",
        bands: [
          { colour: "late", alpha: 0.13, rows: late.map(([t, held, ahead]) => [t, held, ahead]) },
          { colour: "predicted", alpha: 0.26, rows: predicted.map(([t, , low, high]) => [t, low, high]) },
        ],
        lines: [
          felt,
          line("late", "late", late, { width: 1.8, dash: DASHED, alpha: 0.8 }),
          line("predicted", "predicted", predicted),
          line("measured", "measured", of("measured"), { width: 2.4, dash: DOTTED }),
        ],
      },
      {
        title: "mm", lines: [
          line("commanded", "predicted", millimetres(of("commanded")), { digits: 2 }),
          line("read back", "readback", millimetres(of("readback")), { digits: 2, dash: DASHED }),
        ],
      },
    ];
    this.ranges[1].of([of("felt")]);
    [panels[0].y, panels[1].y] = [this.ranges[0].of(panels[0].lines.map((each) => each.rows)), this.ranges[2].of(panels[1].lines.map((each) => each.rows))];
    if (this.picked !== null) {
      for (const panel of panels) panel.spans = [{ from: this.picked, to: this.hover, colour: "soft" }];
    }
    const back_s = traces.now_s - now_s;
    const ticks = [4, 3, 2, 1, 0].map((quarter) => {
      const s = +((quarter * window_s) / 4 + back_s).toFixed(window_s < 4 ? 2 : 1);
      return [end - (quarter * window_s) / 4, s === 0 ? "now" : `−${s} s`];
    });
    const hover = this.hover !== null && this.hover >= start && this.hover <= end ? this.hover : null;
    const x = { min: start, max: end, ticks };
    this.frame = draw(this.force, { x, panels: panels.slice(0, 1), hover });
    draw(this.position, { x, panels: panels.slice(1), hover });
    this.instrument(traces, hover ?? end);
  }

  /** What the hand had at that moment: force and command of then, and what had been reported of before. */
  instrument(traces, t_s) {
    const at = (name, s, column = 1) => {
      const rows = traces.rows[name] ?? [], newest = rows.at(-1);
      return valueAt(rows, s, column) ?? (newest && s > newest[0] && s < newest[0] + FRESH_S ? newest[column] : null);
    };
    const milli = (value, more = 0) => (value === null ? null : 1e3 * value + more);
    const { vessel, late_ms } = this, reported_s = t_s - (late_ms ?? 0) / 1e3;
    const before_mm = (vessel?.tip_mm ?? 0) - 1e3 * (at("readback", reported_s, 2) ?? 0);
    const tip_mm = milli(at("readback", reported_s), before_mm), commanded_mm = milli(at("commanded", t_s), before_mm);
    const [most_mn, most_felt_mn] = this.ranges.map((range) => 1e3 * Math.max(-range.min, range.max));
    if (this.rows !== traces.rows) Object.assign(this, { rows: traces.rows, reach_mm: [], box_mm: null });
    const reached = [...this.reach_mm, tip_mm, commanded_mm].filter((mm) => mm !== null);
    if (reached.length) this.reach_mm = [Math.min(...reached), Math.max(...reached)];
    const shapes = traces.rows.shape ?? [], shape_mm = (shapes.findLast(([since_s]) => since_s <= reported_s) ?? shapes[0])?.[1] ?? null;
    for (const [x, y] of shape_mm ?? []) {
      const [x0, y0, x1, y1] = this.box_mm ?? [x, y, x, y];
      this.box_mm = [Math.min(x0, x), Math.min(y0, y), Math.max(x1, x), Math.max(y1, y)];
    }
    this.drawn = {
      shape_mm, box_mm: this.box_mm,
      vessel, tip_mm, commanded_mm, late_ms, most_mn, most_felt_mn, ...this.friction, reach_mm: reached.length ? this.reach_mm : [0, 1],
      predicted_mn: milli(at("predicted", t_s)), felt_mn: milli(at("felt", t_s)), measured_mn: milli(at("late", t_s)),
    };
    this.picture.closest(".ff-left").classList.toggle("bent", shape_mm !== null);
    drawVessel(this.picture, this.drawn);
  }
}

/** The range of an axis: grows at once, shrinks only when less has done for a while, and ends at round numbers. */
class Range {
  constructor(least, steps) {
    Object.assign(this, { least, steps, min: null, max: null, interval: 1, small_ms: 0 });
  }

  of(lines) {
    const [low, high] = ends(lines);
    if (low <= high) this.adapt(low, high);
    return { min: this.min ?? -1, max: this.max ?? 1, interval: this.interval };
  }

  adapt(low, high) {
    const now_ms = performance.now(), first = this.min === null;
    const middle = (low + high) / 2, half = Math.max((high - low) / 2, this.least) * 1.06;
    const grows = first || low < this.min || high > this.max;
    if (first || 2 * half > 0.6 * (this.max - this.min)) this.small_ms = now_ms;
    if (!grows && now_ms - this.small_ms < CALM_MS) return;
    this.small_ms = now_ms;
    const keeps = grows && !first;
    this.set(keeps ? Math.min(middle - half, this.min) : middle - half, keeps ? Math.max(middle + half, this.max) : middle + half);
  }

  set(low, high) {
    this.interval = nice((high - low) / this.steps);
    this.min = Math.floor(low / this.interval + 1e-6) * this.interval;
    this.max = Math.ceil(high / this.interval - 1e-6) * this.interval;
  }
}
