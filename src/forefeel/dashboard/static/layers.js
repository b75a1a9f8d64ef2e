// What stands in a chart: lines, bands, bars, points, spans; a clean canvas, the colours of theme.css, rows by x.
const FONT = "12.5px system-ui, -apple-system, \"Segoe UI\", Roboto, \"Noto Sans\", \"DejaVu Sans\", Arial, sans-serif";
const known = new Map();
let ink = null;

/** A clean canvas in pixels of the style sheet: {pen, width, height}; null while it is not shown. */
export function prepare(canvas) {
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
  return { pen, width, height };
}

/** Colours are asked for anew when the theme has changed. */
function themed(canvas) {
  const now = getComputedStyle(canvas).color;
  if (now !== ink) known.clear();
  ink = now;
}

export function colour(canvas, name) {
  if (!known.has(name)) {
    canvas.style.color = `var(--${name})`;
    known.set(name, getComputedStyle(canvas).color);
    canvas.style.color = "";
  }
  return known.get(name);
}

/** From x to pixels. */
export function scale({ min, max, log }, from, to) {
  const of = log ? (value) => Math.log(Math.max(value, 1e-300)) : (value) => value;
  const low = of(min), span = of(max) - low;
  return (value) => from + ((of(value) - low) / span) * (to - from);
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

export function stroke(pen, canvas, line, trace) {
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

export function path(pen, rows, atX, atY) {
  let draws = false;
  for (const [x, value] of rows) {
    if (value === null) { draws = false; continue; }
    if (draws) pen.lineTo(atX(x), atY(value));
    else pen.moveTo(atX(x), atY(value));
    draws = true;
  }
}

export function drawBand(pen, canvas, band, atX, atY) {
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

export function drawBars(pen, canvas, bars, atX, atY, bottom) {
  pen.fillStyle = colour(canvas, bars.colour);
  pen.globalAlpha = bars.alpha ?? 1;
  for (const [from, to, value] of bars.rows) pen.fillRect(atX(from), atY(value), Math.max(1, atX(to) - atX(from) - 1), Math.min(atY(0), bottom) - atY(value));
  pen.globalAlpha = 1;
}

export function dot(pen, x, y, radius) {
  pen.beginPath(); pen.arc(x, y, radius, 0, 7); pen.fill();
}

export function drawPoints(pen, canvas, { colour: name, size, alpha, rows }, atX, atY) {
  pen.fillStyle = colour(canvas, name);
  pen.globalAlpha = alpha ?? 0.4;
  for (const [x, y] of rows) dot(pen, atX(x), atY(y), size ?? 1.4);
  pen.globalAlpha = 1;
}

export function shade(pen, canvas, { from, to, colour: name, alpha, name: words }, box, atX) {
  const left = Math.max(box.left, atX(Math.min(from, to))), right = Math.min(box.right, atX(Math.max(from, to)));
  pen.globalAlpha = alpha ?? 0.2;
  pen.fillStyle = colour(canvas, name);
  pen.fillRect(left, box.top, right - left, box.bottom - box.top);
  pen.globalAlpha = 1;
  if (!words || pen.measureText(words).width + 8 > right - left) return;
  pen.fillStyle = colour(canvas, "ink");
  pen.textAlign = "center"; pen.textBaseline = "middle";
  pen.fillText(words, (left + right) / 2, (box.top + box.bottom) / 2);
}

export function upright(pen, canvas, x, box, name) {
  pen.strokeStyle = colour(canvas, name);
  pen.lineWidth = 1;
  pen.beginPath(); pen.moveTo(Math.round(x) + 0.5, box.top); pen.lineTo(Math.round(x) + 0.5, box.bottom); pen.stroke();
}

/** Of a column, between two rows in a straight line; null in a gap and beyond the ends. */
export function valueAt(rows, x, column = 1) {
  const index = after(rows, x), [before, next] = [rows[index - 1] ?? rows[index], rows[index]];
  if (!before || !next || before[0] > x || before[column] === null || next[column] === null) return null;
  const share = next[0] > before[0] ? (x - before[0]) / (next[0] - before[0]) : 0;
  return before[column] + share * (next[column] - before[column]);
}

/**
 * The rows between two x, and one more at each side, so that lines go on to the edge. Of more than can be seen,
 * the lowest and the highest of each bin; bins are counted from the begin, so that they do not shimmer.
 */
export function between(all, start, end, bin) {
  const rows = all.slice(Math.max(0, after(all, start) - 1), after(all, end) + 1);
  return rows.length * bin > 2 * (end - start) ? thinned(rows, bin) : rows;
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

export function after(rows, x) {
  let low = 0, high = rows.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rows[middle][0] < x) low = middle + 1;
    else high = middle;
  }
  return low;
}
