// An instrument in its vessel, in profile. drawVessel(canvas, spec): the same spec gives the same picture. Texts are
// drawn, never parsed; what is null or missing is not known and not drawn. Places along the path are in mm. A spec is JSON:
//   shape_mm: [[x, y], ...] of the instrument, tip last, to scale and in place of the straight profile; null: that one
//   box_mm: [x, y, x, y] where it has been, which is shown where vessel.walls_mm: {mm: [x, y, x, y]} are not known
//   vessel: {instrument_radius_mm, lumen_radius_mm: {mm: radius}, landmarks_mm: {name: mm}, to_scale}; null: a line
//   reach_mm: [least, most] where the instrument has been; what is shown follows from it
//   tip_mm: where the stage reports it, commanded_mm: where the hand wants it
//   predicted_mn, felt_mn: arrows at the commanded tip; measured_mn, late_ms: at the reported one. What resists the
//           way in is positive and points to the left; most_mn, most_felt_mn: force of the longest arrow
//   valve_mn, rub_mn_per_mm: friction at the valve, and along each mm that touches the wall
// Colours are names of custom properties of the style sheet.
import { nice } from "./chart.js";
import { colour, prepare } from "./layers.js";

const MARGIN_PX = 16, TIP_PX = 6, LANE_PX = 18, AXIS_PX = 22, WALL_PX = 8, STEP_PX = 4, THINNEST_PX = 3.5, MARK_MM = 10, STILL_MM = 0.3, LEAST_MM = 20, HATCH_PX = 7, HEAD_PX = 10;
const LINE = { instrument_radius_mm: 1, lumen_radius_mm: {}, landmarks_mm: {}, to_scale: true };
const inMn = (mn, most_mn) => `${mn.toFixed(most_mn < 50 ? 1 : 0).replace("-", "\u2212")} mN`;

export function drawVessel(canvas, spec) {
  const sized = prepare(canvas);
  if (!sized) return;
  const picture = spec.shape_mm ? new Bent(canvas, spec, sized) : new Picture(canvas, spec, sized);
  picture.all();
  const { most_mn, most_felt_mn, late_ms } = spec, late = late_ms === null ? "late" : `${late_ms} ms late`;
  picture.arrow("predicted", "now", spec.predicted_mn, most_mn, spec.commanded_mm, 0);
  // it has a scale of its own where it is scaled for the hand
  picture.arrow("felt", "", spec.felt_mn, most_felt_mn > 3 * most_mn ? most_felt_mn : most_mn, spec.commanded_mm, 1);
  picture.arrow("measured", late, spec.measured_mn, most_mn, spec.tip_mm, 2);
}

/** Draws it again, too, when size or theme change. */
export function showVessel(canvas, spec) {
  new ResizeObserver(() => drawVessel(canvas, spec)).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => drawVessel(canvas, spec));
}

/** As deep as the instrument has been, and ahead of it as much as arrows need. */
function shown({ vessel, reach_mm: [low, high] }) {
  const start = vessel ? 0 : low, known = vessel ? Math.max(0, ...Object.values(vessel.landmarks_mm)) : low;
  const wanted = Math.max(1.7 * (high - start), 1.15 * (known - start), LEAST_MM), step = nice(wanted / 8);
  const max = start + step * Math.ceil(wanted / step - 1e-6);
  return { min: start - 0.14 * (max - start), max };
}

/** In profile along a straight path, across it not to the same scale. */
class Picture {
  constructor(canvas, spec, { pen, width, height }) {
    const vessel = spec.vessel ?? LINE, top = 2 * LANE_PX + 4, bottom = height - AXIS_PX - LANE_PX - 2;
    const lumen = Object.entries(vessel.lumen_radius_mm).map(([mm, radius]) => [Number(mm), radius]).sort((a, b) => a[0] - b[0]);
    pen.lineCap = "round";
    Object.assign(this, { spec, pen, width, height, vessel, lumen, top, bottom, middle: (top + bottom) / 2 });
    this.of = (name) => colour(canvas, name);
    Object.assign(this, shown(spec));
    this.atX = (mm) => ((mm - this.min) / (this.max - this.min)) * width;
    this.scale = (this.middle - top - WALL_PX) / Math.max(2.6 * vessel.instrument_radius_mm, ...lumen.map((row) => row[1]));
    this.shaft = Math.max(THINNEST_PX, vessel.instrument_radius_mm * this.scale);
    this.tip = spec.tip_mm === null ? -Infinity : this.atX(spec.tip_mm);
  }

  all() {
    const { spec, middle, width, vessel: { landmarks_mm: { valve } } } = this;
    if (spec.vessel) this.walls();
    else this.line([[0, middle], [width, middle]], "line", 1.5);
    this.axis();
    if (spec.tip_mm !== null) this.instrument();
    if (spec.commanded_mm !== null) this.commanded(this.atX(spec.commanded_mm));
    if (valve !== undefined) this.valve(this.atX(valve));
  }

  /** Where an arrow of that lane meets the instrument whose tip is at mm. */
  anchor(mm, lane) { return [this.atX(mm), this.middle + (lane < 2 ? -this.shaft : this.shaft)]; }

  line(points, name, width, { alpha = 1, dash = [], fill = "" } = {}) {
    const { pen } = this;
    Object.assign(pen, { strokeStyle: this.of(name), lineWidth: width, globalAlpha: alpha });
    pen.setLineDash(dash);
    pen.beginPath();
    for (const [x, y] of points) pen.lineTo(x, y);
    if (fill) Object.assign(pen, { fillStyle: fill.addColorStop ? fill : this.of(fill) }).fill();
    if (width) pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }

  /** Colours across the path, from the one edge over the middle to the other. */
  across(half, edge, middle) {
    const shade = this.pen.createLinearGradient(0, this.middle - half, 0, this.middle + half);
    for (const [at, name] of [[0, edge], [0.42, middle], [1, edge]]) shade.addColorStop(at, this.of(name));
    return shade;
  }

  /** Radius in mm of the lumen at an x in px that nothing touches. */
  free(x) {
    const mm = this.min + (x / this.width) * (this.max - this.min), next = this.lumen.findIndex((row) => row[0] >= mm);
    if (next <= 0) return this.lumen.at(next)[1];
    const [[x0, r0], [x1, r1]] = [this.lumen[next - 1], this.lumen[next]], share = (mm - x0) / (x1 - x0);
    return r0 + (r1 - r0) * share * share * (3 - 2 * share);
  }

  touches(x) { return x >= this.atX(this.lumen[0][0]) && x <= this.tip && this.free(x) <= this.vessel.instrument_radius_mm; }

  /** The wall gives way where the instrument is. */
  walls() {
    const { lumen, middle, shaft } = this, rows = [];
    const end = Math.min(this.width + STEP_PX, this.atX(lumen.at(-1)[0]));
    for (let x = Math.max(-STEP_PX, this.atX(lumen[0][0])); x <= end; x += STEP_PX) {
      const ahead = Math.max(0, x - this.tip) / (3 * shaft), free = this.free(x) * this.scale;
      rows.push([x, ahead < 1 ? Math.max(free, shaft * (1 - ahead * ahead)) : free]);
    }
    const side = (sign, more = 0) => rows.map(([x, radius]) => [x, middle + sign * (radius + more)]);
    this.line([...side(-1), ...side(1).reverse()], "wall", 0, { fill: this.across(middle - this.top, "lumen-edge", "lumen") });
    for (const sign of [-1, 1]) {
      for (const width of [4, WALL_PX]) this.line(side(sign, width / 2), "tissue", width, { alpha: 0.4 });
      this.line(side(sign), "wall", 1.6);
      this.line(side(sign).filter(([x]) => this.touches(x)), "touch", 3);
    }
  }

  axis() {
    const { pen, spec, vessel, width, min, max } = this, y = this.height - AXIS_PX + 2, step = nice((max - min) / Math.max(3, width / 90)), taken = [];
    Object.assign(pen, { textBaseline: "top", textAlign: "center" });
    const notes = [spec.rub_mn_per_mm == null || !spec.vessel ? "" : `shaft ${spec.rub_mn_per_mm.toPrecision(2)} mN per mm`, vessel.to_scale ? "" : "across not to scale"];
    const note = notes.filter((each) => each).slice(width < 600 ? -1 : 0).join(" · ");
    const write = (mm, text, name) => {
      const half = pen.measureText(text).width / 2, x = Math.min(Math.max(this.atX(mm), half + 2), width - half - 2);
      if (mm < min || mm > max || taken.some(([from, to]) => x + half > from - 8 && x - half < to + 8)) return;
      taken.push([x - half, x + half]);
      Object.assign(pen, { fillStyle: this.of(name) }).fillText(text, x, y + 5);
      if (text !== note) this.line([[this.atX(mm), y], [this.atX(mm), y + 3]], name, 1);
    };
    for (const [name, mm] of Object.entries(vessel.landmarks_mm)) {
      if (name !== "valve") this.line([[this.atX(mm), this.top - 2], [this.atX(mm), y]], "soft", 1, { dash: [1, 4] });
      write(mm, name === "valve" && spec.valve_mn != null ? `valve ${inMn(spec.valve_mn, 100)}` : name, "ink");
    }
    write(max, note, "soft");
    for (let mm = Math.ceil(min / step) * step; mm <= max; mm += step) if (mm >= 0 || !spec.vessel) write(mm, `${+mm.toFixed(3)} mm`, "soft");
  }

  /** The shaft with a mark every 10 mm from its tip, hatched where it touches and is known to rub, against its motion. */
  instrument() {
    const { pen, middle, shaft, tip, spec } = this, body = this.body(tip), across = (x, inset = 0) => [[x, middle - shaft + inset], [x, middle + shaft - inset]];
    pen.save();
    pen.clip(body);
    Object.assign(pen, { fillStyle: this.across(shaft, "shaft-edge", "shaft") }).fill(body);
    for (let mm = spec.tip_mm - MARK_MM; mm > this.min; mm -= MARK_MM) this.line(across(this.atX(mm)), "shaft-edge", 2.5);
    const alpha = Math.min(0.9, 0.4 + Math.abs(spec.rub_mn_per_mm * spec.tip_mm) / spec.most_mn);
    const ahead_mm = (spec.commanded_mm ?? spec.tip_mm) - spec.tip_mm, lean = Math.abs(ahead_mm) < STILL_MM ? 0 : 4 * Math.sign(ahead_mm);
    for (let x = tip - 1.5 * shaft; spec.vessel && spec.rub_mn_per_mm != null && x > 0; x -= HATCH_PX) {
      if (this.touches(x)) this.line([[x + lean, middle - shaft], [x, middle], [x + lean, middle + shaft]], "rub", 1.3, { alpha });
    }
    pen.restore();
    Object.assign(pen, { strokeStyle: this.of("shaft-edge"), lineWidth: 1 }).stroke(body);
    this.line(across(tip - 0.9 * shaft, 1.5), "readback", 4);
  }

  /** Its outline, with the tip at x. */
  body(x, from = -4) {
    const { middle, shaft } = this, path = new Path2D();
    path.moveTo(from, middle - shaft);
    path.arc(x - shaft, middle, shaft, -Math.PI / 2, Math.PI / 2);
    path.lineTo(from, middle + shaft);
    return path;
  }

  /** A thin ghost of the tip, ahead of what is reported or behind it. */
  commanded(x) {
    const { pen, tip, shaft } = this;
    Object.assign(pen, { strokeStyle: this.of("predicted"), lineWidth: 1.6 }).setLineDash([4, 4]);
    pen.stroke(this.body(x, x > tip ? Math.max(0, tip - shaft) : x - 2 * shaft));
    pen.setLineDash([]);
  }

  /** Two seals that hold the shaft. */
  valve(x) {
    const { shaft, spec } = this, outer = (this.middle - this.top) * 0.85;
    for (const sign of [-1, 1]) {
      const seal = [[-13, outer], [-3, shaft], [3, shaft], [13, outer]].map(([dx, dy]) => [x + dx, this.middle + sign * dy]);
      this.line(seal, "wall", 1.6, { fill: "tissue" });
      this.line(seal.slice(1, 3), spec.valve_mn == null ? "wall" : "touch", 3);
    }
  }

  arrow(hue, more, mn, most_mn, at_mm, lane) {
    if (mn === null || at_mm === null) return;
    const { pen, width } = this, ghost = lane === 2, [x, end] = this.anchor(at_mm, lane), y = lane < 2 ? 11 + lane * LANE_PX : this.bottom + LANE_PX / 2 + 2;
    const long = Math.min(1, Math.abs(mn) / most_mn) * Math.min(150, width / 5), head = Math.min(HEAD_PX, long), sign = Math.sign(mn);
    const [tail, point] = mn >= 0 ? [x + long, x] : [x, x + long];
    this.line([[x, y], [x, end]], hue, 1, { alpha: 0.55, dash: [1, 3] });
    this.line([[tail, y], [point + sign * head * 0.6, y]], hue, ghost ? 3.2 : 4.5, ghost ? { dash: [0.1, 6.5] } : {});
    const corners = [[0, 0], [head, -0.6 * head], [head, 0.6 * head], [0, 0]].map(([dx, dy]) => [point + sign * dx, y + dy]);
    this.line(corners, hue, 1.6, ghost ? {} : { fill: hue });
    const value = inMn(mn, most_mn), right = Math.max(tail, point) + 9, left = x - 9;
    Object.assign(pen, { textAlign: "left", textBaseline: "middle", fillStyle: this.of("ink") });
    const name = hue === "felt" ? "felt by the hand" : hue;
    for (const text of [`${name} ${value}${more ? `, ${more}` : ""}`, `${name} ${value}`, value]) {
      const wide = pen.measureText(text).width, at = right + wide <= width ? right : left >= wide ? left - wide : null;
      if (at !== null) { pen.fillText(text, at, y); return; }
    }
  }
}

/** As it is bent, seen from above its plane, with the same scale along both axes. */
class Bent extends Picture {
  constructor(canvas, spec, sized) {
    super(canvas, spec, sized);
    const rows = Object.entries(this.vessel.walls_mm ?? {}).map(([mm, ends]) => [Number(mm), ...ends]).sort((a, b) => a[0] - b[0]);
    const points = rows.length ? rows.flatMap(([, ...ends]) => [ends.slice(0, 2), ends.slice(2)]) : [spec.box_mm.slice(0, 2), spec.box_mm.slice(2)];
    const [[x0, x1], [y0, y1]] = [0, 1].map((axis) => points.map((point) => point[axis])).map((each) => [Math.min(...each), Math.max(...each)]);
    const { width, top, bottom } = this;
    this.per_mm = Math.min((width - 2 * MARGIN_PX) / Math.max(x1 - x0, 1), (bottom - top) / Math.max(y1 - y0, 1));
    this.at = ([x, y]) => [width / 2 + (x - (x0 + x1) / 2) * this.per_mm, (top + bottom) / 2 - (y - (y0 + y1) / 2) * this.per_mm];
    this.wire = spec.shape_mm.map(this.at);
    this.rows = rows.map(([mm, ...ends]) => [mm, this.at(ends), this.at(ends.slice(2))]);
  }

  all() {
    const { spec, wire, rows } = this, [left, right] = [1, 2].map((side) => rows.map((row) => row[side]));
    this.line([...left, ...right.toReversed()], "lumen", 0, { fill: "lumen" });
    for (const wall of [left, right]) this.line(wall, "wall", 1.6);
    this.rule();
    if (spec.tip_mm === null) return;
    const wide = Math.max(THINNEST_PX, 2 * (spec.vessel?.instrument_radius_mm ?? 0) * this.per_mm), tip = wire.at(-1), before = wire.at(-2) ?? tip;
    const long = Math.hypot(tip[0] - before[0], tip[1] - before[1]) || 1, end = tip.map((each, axis) => each - (TIP_PX / long) * (each - before[axis]));
    this.line(wire, "shaft-edge", wide + 2);
    this.line(wire, "shaft", wide);
    this.line([end, tip], "readback", wide + 1);
    if (spec.commanded_mm !== null && rows.length) this.ghost(spec.commanded_mm);
  }

  /** On the middle of the vessel, from there where the wire is reported to there where the hand wants it. */
  ghost(commanded_mm) {
    const [from, to] = [this.spec.tip_mm, commanded_mm].toSorted((a, b) => a - b), inside = this.rows.map((row) => row[0]).filter((mm) => mm > from && mm < to);
    this.line([from, ...inside, to].map((mm) => this.middleAt(mm)), "predicted", 1.6, { dash: [3, 4] });
  }

  middleAt(mm) {
    const { rows } = this, i = Math.max(1, rows.findIndex((row) => row[0] >= mm)), [[mm0, a, b], [mm1, c, d]] = [rows[i - 1], rows[i]];
    const share = (mm - mm0) / (mm1 - mm0);
    return [0, 1].map((axis) => ((1 - share) * (a[axis] + b[axis]) + share * (c[axis] + d[axis])) / 2);
  }

  /** At the tip; what is as new as the hand where that is by now. */
  anchor(mm, lane) { return lane < 2 && this.rows.length ? this.middleAt(mm) : this.wire.at(-1); }

  /** 10 mm, in the lower left corner. */
  rule() {
    const { pen } = this, y = this.height - 8, long = MARK_MM * this.per_mm;
    this.line([[8, y - 4], [8, y], [8 + long, y], [8 + long, y - 4]], "soft", 1.2);
    Object.assign(pen, { textAlign: "left", textBaseline: "bottom", fillStyle: this.of("soft") }).fillText(`${MARK_MM} mm`, 14 + long, y + 3);
  }
}
