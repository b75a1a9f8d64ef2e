// Line charts on a canvas, one above the other on one axis of x. draw(canvas, spec): the same spec gives the same
// picture; nothing is kept but what interact() needs. Texts are drawn, never parsed. A spec is JSON:
//   x: {min, max, ticks: [[x, text]] (else round numbers), unit}
//   panels: [{weight, title, y: {min, max, interval} (else what the lines need), hidesY,
//             bands: [{colour, alpha, rows: [[x, low, high]]}], bars: {colour, rows: [[x0, x1, y]]},
//             lines: [{name, colour, width, dash, alpha, digits, now, rows: [[x, y]]}],
//             spans: [{from, to, colour}]}]
//   hover: x where the values are read, or null.
// A row whose value is null breaks its line. Colours are names of custom properties of the style sheet.
const FONT = "12.5px system-ui, -apple-system, \"Segoe UI\", Roboto, \"Noto Sans\", \"DejaVu Sans\", Arial, sans-serif";
const ROW_PX = 19, FOOT_PX = 19, GAP_PX = 6, RIGHT_PX = 14;
const known = new Map();
let ink = null;

/** Draws, and gives where things are: {left, right, min, max}. */
export function draw(canvas, spec) {
  const width = canvas.clientWidth, height = canvas.clientHeight, ratio = devicePixelRatio || 1;
  if (!width || !height) return null;
  const [across, down] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== across || canvas.height !== down) Object.assign(canvas, { width: across, height: down });
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  themed(canvas);
  pen.font = FONT;
  pen.lineJoin = "round";
  const left = spec.panels.every((panel) => panel.hidesY) ? 6 : 46;
  const frame = { left, right: width - RIGHT_PX, min: spec.x.min, max: spec.x.max };
  const legends = spec.panels.map((panel) => arrange(pen, panel, frame, spec.hover));
  const heads = legends.map((legend) => (legend.length ? 1 + Math.max(...legend.map((each) => each.row)) : 0) * ROW_PX);
  const spare = height - FOOT_PX - heads.reduce((sum, each) => sum + each, 0) - GAP_PX * spec.panels.length;
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

/** Calls back with what hand and mouse want: hover(x or null), zoom(factor, x), select(x0, x1), reset(). */
export function interact(canvas, place, wants) {
  const fingers = new Map();
  let pressed = null, spread = null;
  const x = (event) => {
    const frame = place();
    const share = (event.clientX - canvas.getBoundingClientRect().left - frame.left) / (frame.right - frame.left);
    return frame.min + Math.min(Math.max(share, 0), 1) * (frame.max - frame.min);
  };
  const apart = () => { const [a, b] = [...fingers.values()]; return Math.max(10, Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY)); };
  const on = (name, act) => canvas.addEventListener(name, (event) => place() && act(event), { passive: false });
  on("wheel", (event) => { event.preventDefault(); wants.zoom(Math.exp(Math.sign(event.deltaY) * 0.2), x(event)); });
  on("pointerdown", (event) => {
    fingers.set(event.pointerId, event);
    if (event.pointerType === "mouse" && event.button === 0) { pressed = x(event); canvas.setPointerCapture(event.pointerId); }
    if (fingers.size === 2) spread = apart();
    wants.hover(x(event));
  });
  on("pointermove", (event) => {
    if (fingers.has(event.pointerId)) fingers.set(event.pointerId, event);
    if (fingers.size === 2) { const now = apart(); wants.zoom(spread / now, x(event)); spread = now; }
    else wants.hover(x(event), pressed);
  });
  for (const name of ["pointerup", "pointercancel"]) on(name, (event) => {
    fingers.delete(event.pointerId);
    const from = pressed, to = x(event), { left, right, min, max } = place();
    pressed = null;
    if (name === "pointerup" && from !== null && Math.abs(to - from) > (8 * (max - min)) / (right - left)) wants.select(Math.min(from, to), Math.max(from, to));
    wants.hover(null);
  });
  on("pointerleave", () => { if (pressed === null) wants.hover(null); });
  on("dblclick", () => wants.reset());
}

export function nice(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return [1, 2, 2.5, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= step * 0.999);
}

export function ends(lines) {
  let low = Infinity, high = -Infinity;
  for (const rows of lines) for (const [, value] of rows) {
    if (value === null) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}

/** Colours are asked for anew when the theme has changed. */
function themed(canvas) {
  const now = getComputedStyle(canvas).color;
  if (now !== ink) known.clear();
  ink = now;
}

function colour(canvas, name) {
  if (!known.has(name)) {
    canvas.style.color = `var(--${name})`;
    known.set(name, getComputedStyle(canvas).color);
    canvas.style.color = "";
  }
  return known.get(name);
}

/** Title and legend, one after the other, in as many rows as they need. */
function arrange(pen, panel, frame, hover) {
  const items = (panel.lines ?? []).filter((line) => line.name).map((line) => ({ line, text: said(line, hover) }));
  if (panel.title) items.unshift({ text: panel.title });
  let x = 0, row = 0;
  for (const item of items) {
    const sample = item.line ? 30 : 0;
    const needed = sample + pen.measureText(item.line ? widest(item.line) : item.text).width;
    if (x > 0 && x + needed > frame.right - frame.left) { x = 0; row += 1; }
    Object.assign(item, { x, row });
    x += needed + 16;
  }
  return items;
}

const shown = (line, value) => `${line.name} ${value.toFixed(line.digits ?? 3)}`;
const widest = (line) => shown(line, -1);

function said(line, hover) {
  const value = hover == null ? line.now : valueAt(line.rows, hover);
  return value == null ? line.name : shown(line, value);
}

function legendItem(pen, canvas, { line, text, x, row }, left, top) {
  const y = top + row * ROW_PX + ROW_PX / 2 + 2;
  if (line) stroke(pen, canvas, line, () => { pen.moveTo(left + x, y); pen.lineTo(left + x + 24, y); });
  pen.fillStyle = colour(canvas, line ? "ink" : "soft");
  pen.textAlign = "left"; pen.textBaseline = "middle";
  pen.fillText(text, left + x + (line ? 30 : 0), y);
}

function drawPanel(pen, canvas, panel, box, hover) {
  const y = panel.y ?? fitted(panel);
  const atX = (x) => box.left + ((x - box.min) / (box.max - box.min)) * (box.right - box.left);
  const atY = (value) => box.bottom - ((value - y.min) / (y.max - y.min)) * (box.bottom - box.top);
  if (!panel.hidesY) yTicks(pen, canvas, y, box, atY);
  pen.save();
  pen.beginPath();
  pen.rect(box.left, box.top - 1, box.right - box.left, box.bottom - box.top + 2);
  pen.clip();
  for (const band of panel.bands ?? []) drawBand(pen, canvas, band, atX, atY);
  if (panel.bars) drawBars(pen, canvas, panel.bars, atX, atY);
  for (const line of panel.lines ?? []) stroke(pen, canvas, line, () => path(pen, line.rows, atX, atY));
  for (const span of panel.spans ?? []) shade(pen, canvas, span, box, atX);
  if (hover != null) readOut(pen, canvas, panel, hover, box, atX, atY);
  pen.restore();
}

function fitted(panel) {
  const [low, high] = ends([...(panel.lines ?? []).map((line) => line.rows), (panel.bars?.rows ?? []).map(([, , value]) => [0, value]), ...(panel.bars ? [[[0, 0]]] : [])]);
  if (!(low <= high)) return { min: -1, max: 1, interval: 1 };
  const interval = nice(Math.max(high - low, 1e-9) / (panel.steps ?? 4));
  return { min: Math.floor(low / interval) * interval, max: Math.ceil(high / interval) * interval, interval };
}

function yTicks(pen, canvas, { min, max, interval }, box, atY) {
  pen.textAlign = "right"; pen.textBaseline = "middle";
  const digits = Math.max(0, -Math.floor(Math.log10(interval) + 1e-9) + (String(interval).includes("25") ? 1 : 0));
  let above = Infinity;
  for (let index = 0; index <= Math.round((max - min) / interval); index += 1) {
    const value = min + index * interval, y = Math.round(atY(value)) + 0.5;
    pen.strokeStyle = colour(canvas, "line");
    pen.lineWidth = 1;
    pen.beginPath(); pen.moveTo(box.left, y); pen.lineTo(box.right, y); pen.stroke();
    if (above - y < 13) continue;
    above = y;
    pen.fillStyle = colour(canvas, "soft");
    pen.fillText(value.toFixed(digits), box.left - 7, y);
  }
}

function xTicks(pen, canvas, { x }, frame, top) {
  const ticks = x.ticks ?? roundTicks(x, Math.max(2, (frame.right - frame.left) / 80));
  pen.fillStyle = colour(canvas, "soft");
  pen.textBaseline = "top";
  for (const [at, text] of ticks) {
    const place = frame.left + ((at - x.min) / (x.max - x.min)) * (frame.right - frame.left);
    const half = pen.measureText(text).width / 2;
    pen.textAlign = "center";
    pen.fillText(text, Math.min(Math.max(place, half), frame.right + RIGHT_PX - half), top + 5);
  }
}

function roundTicks({ min, max, unit }, most) {
  const step = nice((max - min) / most), found = [];
  if (!(step > 0)) return found;
  for (let value = Math.ceil(min / step) * step; value <= max + 1e-9; value += step) found.push([value, `${+value.toPrecision(6)}${unit ? ` ${unit}` : ""}`]);
  return found;
}

function stroke(pen, canvas, line, trace) {
  pen.beginPath();
  trace();
  pen.globalAlpha = line.alpha ?? 1;
  pen.strokeStyle = colour(canvas, line.colour);
  pen.lineWidth = line.width ?? 2;
  pen.lineCap = line.dash?.[0] < 1 ? "round" : "butt";
  pen.setLineDash(line.dash ?? []);
  pen.stroke();
  pen.setLineDash([]);
  pen.globalAlpha = 1;
}

function path(pen, rows, atX, atY) {
  let draws = false;
  for (const [x, value] of rows) {
    if (value === null) { draws = false; continue; }
    if (draws) pen.lineTo(atX(x), atY(value));
    else pen.moveTo(atX(x), atY(value));
    draws = true;
  }
}

function drawBand(pen, canvas, band, atX, atY) {
  pen.fillStyle = colour(canvas, band.colour);
  pen.globalAlpha = band.alpha ?? 0.25;
  let piece = [];
  const close = () => {
    if (piece.length > 1) {
      pen.beginPath();
      for (const [x, , high] of piece) pen.lineTo(atX(x), atY(high));
      for (const [x, low] of piece.reverse()) pen.lineTo(atX(x), atY(low));
      pen.fill();
    }
    piece = [];
  };
  for (const row of band.rows) {
    if (row[1] == null || row[2] == null) close();
    else piece.push(row);
  }
  close();
  pen.globalAlpha = 1;
}

function drawBars(pen, canvas, bars, atX, atY) {
  pen.fillStyle = colour(canvas, bars.colour);
  for (const [from, to, value] of bars.rows) pen.fillRect(atX(from), atY(value), Math.max(1, atX(to) - atX(from) - 1), atY(0) - atY(value));
}

function readOut(pen, canvas, panel, hover, box, atX, atY) {
  rule(pen, canvas, atX(hover), box, "soft");
  for (const line of panel.lines ?? []) {
    const value = valueAt(line.rows, hover);
    if (value === null) continue;
    pen.fillStyle = colour(canvas, line.colour);
    pen.beginPath(); pen.arc(atX(hover), atY(value), 3.5, 0, 7); pen.fill();
  }
}

function shade(pen, canvas, { from, to, colour: name }, box, atX) {
  pen.globalAlpha = 0.2;
  pen.fillStyle = colour(canvas, name);
  pen.fillRect(atX(Math.min(from, to)), box.top, Math.abs(atX(to) - atX(from)), box.bottom - box.top);
  pen.globalAlpha = 1;
}

function rule(pen, canvas, x, box, name) {
  pen.strokeStyle = colour(canvas, name);
  pen.lineWidth = 1;
  pen.beginPath(); pen.moveTo(Math.round(x) + 0.5, box.top); pen.lineTo(Math.round(x) + 0.5, box.bottom); pen.stroke();
}

/** Between two rows in a straight line; null in a gap and beyond the ends. */
function valueAt(rows, x) {
  let low = 0, high = rows.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rows[middle][0] <= x) low = middle + 1;
    else high = middle;
  }
  const [before, after] = [rows[low - 1], rows[low]];
  if (!before || !after || before[1] === null || after[1] === null) return null;
  const share = after[0] > before[0] ? (x - before[0]) / (after[0] - before[0]) : 0;
  return before[1] + share * (after[1] - before[1]);
}
