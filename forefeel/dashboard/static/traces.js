// The points of the charts: those of the last minute, each trace as it came.
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

  /** The rows between two times, and one more at each side, so that lines go on to the edge. */
  between(name, start_s, end_s) {
    const kept = this.rows[name] ?? [];
    return kept.slice(Math.max(0, after(kept, start_s) - 1), after(kept, end_s) + 1);
  }
}

function after(rows, t_s) {
  let low = 0, high = rows.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rows[middle][0] < t_s) low = middle + 1;
    else high = middle;
  }
  return low;
}
