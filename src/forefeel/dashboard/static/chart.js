// Charts on a canvas, one panel above the other on one axis of x: live page, replay and all pages of results.
// draw(canvas, spec): the same spec gives the same picture; interaction.js adds hover and zoom. Texts are drawn, never
// parsed. A spec is JSON:
//   x: {min, max, log, ticks: [[x, text]] (else round numbers), unit (of each tick), label}
//   panels: [{weight, title, y: {min, max, interval, log} (else what the lines need), hidesY,
//             lines: [{name, unit, colour, width, dash, alpha, digits, now, free (x goes back), rows: [[x, y]]}],
//             points: [{name, colour, size, alpha, rows: [[x, y]]}],
//             bars: [{name, colour, alpha, rows: [[x0, x1, y]]}],
//             bands: [{name, colour, alpha, rows: [[x, low, high]]}],
//             spans: [{name, colour, alpha, from, to}], rules: [{name, colour, dash, at}] (upright)}]
//   hover: x where the values are read, or null.
// A row whose value is null breaks its line. Colours are names of custom properties of theme.css.
import { colour, dot, drawBand, drawBars, drawPoints, ends, path, prepare, scale, shade, stroke, upright, valueAt } from "./layers.js";

const ROW_PX = 19, FOOT_PX = 19, GAP_PX = 6, RIGHT_PX = 14, SAMPLE_PX = 24;
const SAMPLED = ["lines", "rules", "points", "bars", "bands"];

/** Draws, and gives where things are: {left, right, min, max, log}. */
export function draw(canvas, spec) {
  const prepared = prepare(canvas);
  if (!prepared) return null;
  const { pen, width, height } = prepared;
  const left = spec.panels.every((panel) => panel.hidesY) ? 6 : 54;
  const frame = { left, right: width - RIGHT_PX, min: spec.x.min, max: spec.x.max, log: spec.x.log };
  const legends = spec.panels.map((panel) => arrange(pen, panel, frame, spec.hover));
  const heads = legends.map((legend) => (legend.length ? 1 + Math.max(...legend.map((each) => each.row)) : 0) * ROW_PX);
  const spare = height - FOOT_PX - (spec.x.label ? ROW_PX - 3 : 0) - heads.reduce((sum, each) => sum + each, 0) - GAP_PX * spec.panels.length;
  const weights = spec.panels.reduce((sum, panel) => sum + (panel.weight ?? 1), 0);
  let top = 0;
  spec.panels.forEach((panel, index) => {
    const from = top + heads[index] + GAP_PX;
    const to = from + (spare * (panel.weight ?? 1)) / weights;
    for (const each of legends[index]) legendItem(pen, canvas, each, left, top);
    drawPanel(pen, canvas, panel, { ...frame, top: from, bottom: to }, spec.hover);
    top = to;
  });
  xTicks(pen, canvas, spec, frame, top);
  return frame;
}

export function nice(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return [1, 2, 2.5, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= step * 0.999);
}

/** Title and legend, one after the other, in as many rows as they need. */
function arrange(pen, panel, frame, hover) {
  const items = SAMPLED.flatMap((kind) => (panel[kind] ?? []).filter((each) => each.name || each.unit).map((each) => ({ each, kind })));
  for (const item of items) item.text = said(item, hover == null ? item.each.now : read(item, hover));
  if (panel.title) items.unshift({ text: panel.title });
  const state = hover != null && (panel.spans ?? []).find(({ name, from, to }) => name && from <= hover && hover <= to);
  if (state) items[0].text += `: ${state.name}`;
  let x = 0, row = 0;
  for (const item of items) {
    const needed = item.kind ? SAMPLE_PX + 6 + pen.measureText(widest(item)).width : pen.measureText(item.text).width;
    if (x > 0 && x + needed > frame.right - frame.left) { x = 0; row += 1; }
    Object.assign(item, { x, row });
    x += needed + 16;
  }
  return items;
}

const reads = ({ kind, each }) => (kind === "lines" && !each.free) || kind === "bars";
const widest = (item) => (reads(item) ? said(item, item.each.digits == null ? -0.1234 : -1) : item.each.name);

function said({ each }, value) {
  if (value == null) return each.name;
  return `${each.name} ${each.digits == null ? plain(value) : value.toFixed(each.digits)} ${each.unit ?? ""}`.trim();
}

function read({ kind, each }, x) {
  if (kind === "bars") return each.rows.find(([from, to]) => from <= x && x < to)?.[2] ?? null;
  return kind === "lines" && !each.free ? valueAt(each.rows, x) : null;
}

function plain(value, digits = 4) {
  const size = Math.abs(value);
  return size && (size >= 1e6 || size < 1e-3) ? value.toExponential(digits - 2).replace(/\.?0*e/, "e") : String(+value.toPrecision(digits));
}

function legendItem(pen, canvas, { each, kind, text, x, row }, left, top) {
  const y = top + row * ROW_PX + ROW_PX / 2 + 2, from = left + x;
  if (kind === "lines" || kind === "rules") stroke(pen, canvas, each, () => { pen.moveTo(from, y); pen.lineTo(from + SAMPLE_PX, y); });
  else if (kind) {
    pen.fillStyle = colour(canvas, each.colour);
    pen.globalAlpha = kind === "points" ? 1 : each.alpha ?? 1;
    if (kind === "points") dot(pen, from + SAMPLE_PX / 2, y, 3);
    else pen.fillRect(from, y - 5, SAMPLE_PX, 10);
    pen.globalAlpha = 1;
  }
  pen.fillStyle = colour(canvas, kind ? "ink" : "soft");
  pen.textAlign = "left"; pen.textBaseline = "middle";
  pen.fillText(text, from + (kind ? SAMPLE_PX + 6 : 0), y);
}

function drawPanel(pen, canvas, panel, box, hover) {
  const y = panel.y?.min == null ? fitted(panel, box) : panel.y;
  const atX = scale(box, box.left, box.right), atY = scale(y, box.bottom, box.top);
  if (!panel.hidesY) yTicks(pen, canvas, { interval: nice((y.max - y.min) / (panel.steps ?? 4)), ...y }, box, atY);
  pen.save();
  pen.beginPath();
  pen.rect(box.left, box.top - 1, box.right - box.left, box.bottom - box.top + 2);
  pen.clip();
  for (const span of panel.spans ?? []) shade(pen, canvas, span, box, atX);
  for (const band of panel.bands ?? []) drawBand(pen, canvas, band, atX, atY);
  for (const bars of panel.bars ?? []) drawBars(pen, canvas, bars, atX, atY, box.bottom);
  for (const cloud of panel.points ?? []) drawPoints(pen, canvas, cloud, atX, atY);
  for (const { at, ...line } of panel.rules ?? []) stroke(pen, canvas, line, () => { pen.moveTo(atX(at), box.top); pen.lineTo(atX(at), box.bottom); });
  for (const line of panel.lines ?? []) stroke(pen, canvas, line, () => path(pen, line.rows, atX, atY));
  if (hover != null) readOut(pen, canvas, panel, hover, box, atX, atY);
  pen.restore();
}

/** The range of what is seen. */
function fitted(panel, { min: from, max: to }) {
  const layers = [...(panel.lines ?? []), ...(panel.points ?? [])].map(({ rows }) => rows.filter(([x]) => from <= x && x <= to));
  const bars = (panel.bars ?? []).map(({ rows }) => [[0, panel.y?.log ? null : 0], ...rows.map(([, , value]) => [0, value])]);
  const [low, high] = ends([...layers, ...bars]), log = panel.y?.log;
  if (!(low <= high)) return { min: -1, max: 1, interval: 1 };
  if (log) return { min: low / 1.3, max: high * 1.3, log };
  const interval = nice(Math.max(high - low, 1e-9) / (panel.steps ?? 4));
  return { min: Math.floor(low / interval) * interval, max: Math.ceil(high / interval) * interval, interval };
}

/** Round values within a range. */
function marks({ min, max, interval, log }) {
  const found = [];
  if (log) {
    const decades = Math.log10(max / min), factors = decades < 2.5 ? [1, 2, 5] : [1];
    for (let power = Math.floor(Math.log10(min)); power <= Math.log10(max); power += Math.max(1, Math.floor(decades / 6))) {
      found.push(...factors.map((factor) => factor * 10 ** power).filter((value) => value >= min * 0.999 && value <= max * 1.001));
    }
  } else if (interval > 0) {
    for (let index = Math.ceil(min / interval - 1e-6); index * interval <= max + 1e-6 * interval; index += 1) found.push(index * interval);
  }
  return found;
}

function yTicks(pen, canvas, y, box, atY) {
  pen.textAlign = "right"; pen.textBaseline = "middle";
  const { interval, log } = y;
  let digits = 0, above = Infinity;
  while (!log && digits < 9 && Math.abs(interval * 10 ** digits - Math.round(interval * 10 ** digits)) > 1e-6) digits += 1;
  for (const value of marks(y)) {
    const at = Math.round(atY(value)) + 0.5;
    pen.strokeStyle = colour(canvas, "line");
    pen.lineWidth = 1;
    pen.beginPath(); pen.moveTo(box.left, at); pen.lineTo(box.right, at); pen.stroke();
    if (above - at < 13) continue;
    above = at;
    pen.fillStyle = colour(canvas, "soft");
    pen.fillText(log ? plain(value) : value.toFixed(digits), box.left - 7, at);
  }
}

function xTicks(pen, canvas, { x, hover }, frame, top) {
  const { left, right } = frame, atX = scale(frame, left, right);
  const text = (value, digits) => `${plain(value, digits)}${x.unit ? ` ${x.unit}` : ""}`;
  const ticks = x.ticks ?? marks({ ...x, interval: nice((x.max - x.min) / Math.max(2, (right - left) / 80)) }).map((value) => [value, text(value, 6)]);
  pen.fillStyle = colour(canvas, "soft");
  pen.textBaseline = "top"; pen.textAlign = "center";
  const write = (at, words) => {
    const half = pen.measureText(words).width / 2, place = Math.min(Math.max(at, half), right + RIGHT_PX - half);
    pen.fillText(words, place, top + 5);
    return [place - half, 2 * half];
  };
  for (const [at, words] of ticks) write(atX(at), words);
  if (x.label) pen.fillText(x.label, (left + right) / 2, top + FOOT_PX + 2);
  if (hover == null || x.ticks) return;
  const words = text(hover, 4), half = pen.measureText(words).width / 2 + 12;
  pen.fillStyle = colour(canvas, "card");
  pen.fillRect(Math.min(Math.max(atX(hover), half), right + RIGHT_PX - half) - half, top + 3, 2 * half, FOOT_PX - 3);
  pen.fillStyle = colour(canvas, "ink");
  write(atX(hover), words);
}

function readOut(pen, canvas, panel, hover, box, atX, atY) {
  upright(pen, canvas, atX(hover), box, "soft");
  for (const line of panel.lines ?? []) {
    const value = line.free ? null : valueAt(line.rows, hover);
    if (value === null) continue;
    pen.fillStyle = colour(canvas, line.colour);
    dot(pen, atX(hover), atY(value), 3.5);
  }
}
