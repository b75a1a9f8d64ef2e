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

  /**
   * The rows between two times, and one more at each side, so that lines go on to the edge. Of more than can be
   * seen, the lowest and the highest of each bin; bins are counted from the begin, so that they do not shimmer.
   */
  between(name, start_s, end_s, bin_s) {
    const kept = this.rows[name] ?? [];
    const rows = kept.slice(Math.max(0, after(kept, start_s) - 1), after(kept, end_s) + 1);
    return rows.length * bin_s > 2 * (end_s - start_s) ? thinned(rows, bin_s) : rows;
  }
}

function thinned(rows, bin_s) {
  const found = [];
  let bin = null, low = null, high = null;
  const close = () => {
    if (low === null) return;
    found.push(...(low === high ? [low] : low[0] < high[0] ? [low, high] : [high, low]));
    low = high = null;
  };
  for (const row of rows) {
    const number = Math.floor(row[0] / bin_s);
    if (number !== bin || row[1] === null) close();
    bin = number;
    if (row[1] === null) found.push(row);
    else {
      if (low === null || row[1] < low[1]) low = row;
      if (high === null || row[1] > high[1]) high = row;
    }
  }
  close();
  return found;
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
