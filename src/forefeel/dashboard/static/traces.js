// The points of the charts: those of the last minute, each trace as it came.
import { after, between } from "./layers.js";

const KEPT_S = 62;
const SPARE = 512; // points that are dropped at once

export class Traces {
  constructor() {
    this.clear();
  }

  clear() {
    this.rows = {};
    this.now_s = 0;
  }

  take(traces, now_s) {
    this.now_s = now_s;
    for (const [name, rows] of Object.entries(traces)) {
      const kept = (this.rows[name] ??= []);
      for (const row of rows) kept.push(row);
      const from = after(kept, now_s - KEPT_S);
      if (from > SPARE) kept.splice(0, from);
    }
  }

  between(name, start_s, end_s, bin_s) {
    return between(this.rows[name] ?? [], start_s, end_s, bin_s);
  }
}
