// Draws: ECharts makes lines, axes and shapes; which part of the values is shown is decided here, calmly.
const CALM_MS = 4000; // so long a smaller range must do before the axis shrinks
const BAND = "rgba(86, 180, 233, 0.26)";
const BAR = "#56b4e9";
const BIN_PX = 2.5;
const LAG_S = 0.06; // the newest bins are still open

export class Charts {
  constructor(force, delays) {
    this.elements = [force, delays];
    this.ranges = [new Range(0.05, 5), new Range(0.05, 2), new Range(0.5, 2)];
    this.band = [];
    this.known = null;
  }

  /** ECharts of an element that NiceGUI made. */
  chart(index) {
    return window.getElement?.(Number(this.elements[index].id.slice(1)))?.chart;
  }

  ready() {
    return Boolean(this.chart(0) && this.chart(1));
  }

  draw(traces, now_s, window_s) {
    const end = now_s - LAG_S, start = end - window_s;
    const bin_s = (window_s * BIN_PX) / Math.max(200, this.elements[0].clientWidth);
    const of = (name) => traces.between(name, start, end, bin_s);
    const millimetres = (rows) => rows.map(([t, v]) => [t, v === null ? null : 1e3 * v]);
    this.band = of("predicted");
    const predicted = this.band.map(([t, v]) => [t, v]);
    const measured = of("measured"), felt = of("felt");
    const commanded = millimetres(of("commanded")), readback = millimetres(of("readback"));
    const shown = [[predicted, measured], [felt], [commanded, readback]];
    const yAxis = shown.map((lines, index) => this.ranges[index].of(lines));
    const [low, high] = [yAxis[0].min, yAxis[0].max];
    this.chart(0).setOption({
      xAxis: [0, 1, 2].map(() => ({ min: start, max: end })),
      yAxis,
      series: [
        { id: "band", data: [[end, 0]], renderItem: (_, api) => bandShape(api, this.band, start, end, low, high) },
        { id: "predicted", data: predicted }, { id: "measured", data: measured }, { id: "felt", data: felt },
        { id: "commanded", data: commanded }, { id: "readback", data: readback },
      ],
    }, { lazyUpdate: true, silent: true });
  }

  delays({ edges_ms, counts }) {
    const bars = counts.map((count, index) => [edges_ms[index], edges_ms[index + 1], count]);
    this.chart(1)?.setOption({
      xAxis: bars.length ? { min: edges_ms[0], max: edges_ms.at(-1), axisLabel: { formatter: (v) => `${Math.round(10 * v) / 10}` } } : {},
      yAxis: { max: Math.max(1, ...counts) },
      series: [{ id: "delays", data: bars, encode: { x: [0, 1], y: 2 }, renderItem: barShape }],
    });
  }
}

function barShape(_, api) {
  const [left, top] = api.coord([api.value(0), api.value(2)]);
  const [right, bottom] = api.coord([api.value(1), 0]);
  return { type: "rect", shape: { x: left, y: top, width: Math.max(1, right - left - 1), height: bottom - top }, style: { fill: BAR } };
}

/** The 95 % band as one shape per piece without a gap, kept within the chart. */
function bandShape(api, rows, start, end, low, high) {
  const pieces = [];
  let piece = null;
  for (const [t, force, below, above] of rows) {
    if (force === null || below === null || above === null) { piece = null; continue; }
    if (!piece) pieces.push((piece = []));
    piece.push([Math.min(Math.max(t, start), end), Math.max(below, low), Math.min(above, high)]);
  }
  return {
    type: "group",
    children: pieces.filter((each) => each.length > 1).map((each) => ({
      type: "polygon",
      shape: { points: [...each.map(([t, , above]) => api.coord([t, above])), ...each.reverse().map(([t, below]) => api.coord([t, below]))] },
      style: { fill: BAND },
    })),
  };
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

function ends(lines) {
  let low = Infinity, high = -Infinity;
  for (const line of lines) for (const [, value] of line) {
    if (value === null) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}

function nice(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return [1, 2, 2.5, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= step * 0.999);
}
