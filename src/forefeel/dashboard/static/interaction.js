// What hand and mouse do to a chart.
import { draw } from "./chart.js";
import { between, scale } from "./layers.js";

export const BIN_PX = 2.5;

/** Calls back with what hand and mouse want: hover(x or null), zoom(factor, x), select(x0, x1), reset(); the wheel
 *  scrolls the page where scrolls(event) says so. */
export function interact(canvas, place, wants) {
  const fingers = new Map();
  let pressed = null, spread = null;
  const x = (event) => {
    const frame = place();
    const share = (event.clientX - canvas.getBoundingClientRect().left - frame.left) / (frame.right - frame.left);
    return atShare(frame, Math.min(Math.max(share, 0), 1));
  };
  const apart = () => { const [a, b] = [...fingers.values()]; return Math.max(10, Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY)); };
  const on = (name, act) => canvas.addEventListener(name, (event) => place() && act(event), { passive: false });
  on("wheel", (event) => { if (wants.scrolls?.(event)) return; event.preventDefault(); wants.zoom(Math.exp(Math.sign(event.deltaY) * 0.2), x(event)); });
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
    const from = pressed, to = x(event), { left, right } = place(), atX = scale(place(), left, right);
    pressed = null;
    if (name === "pointerup" && from !== null && Math.abs(atX(to) - atX(from)) > 8) wants.select(Math.min(from, to), Math.max(from, to));
    wants.hover(null);
  });
  on("pointerleave", () => { if (pressed === null) wants.hover(null); });
  on("dblclick", () => wants.reset());
}

/** Draws, and draws again on hover, zoom and a change of size or theme. The wheel alone scrolls until one has zoomed. */
export function show(canvas, spec) {
  const { log } = spec.x, of = log ? Math.log : (x) => x, back = log ? Math.exp : (x) => x;
  const whole = [of(spec.x.min), of(spec.x.max)];
  let seen = whole, hover = null, picked = null, place = null;
  const again = () => {
    const x = { ...spec.x, min: back(seen[0]), max: back(seen[1]) };
    const bin = log ? 0 : ((x.max - x.min) * BIN_PX) / Math.max(200, canvas.clientWidth);
    const near = (layers = []) => layers.map((each) => (each.free || log ? each : { ...each, rows: between(each.rows, x.min, x.max, bin) }));
    const panels = spec.panels.map((panel) => ({
      ...panel, lines: near(panel.lines), bands: near(panel.bands), y: seen === whole ? panel.y : panel.y && { log: panel.y.log },
      spans: [...(panel.spans ?? []), ...(picked === null ? [] : [{ from: picked, to: hover, colour: "soft" }])],
    }));
    place = draw(canvas, { x, panels, hover });
  };
  const look = (low, high) => {
    seen = low <= whole[0] && high >= whole[1] ? whole : [Math.max(low, whole[0]), Math.min(high, whole[1])];
    again();
  };
  interact(canvas, () => place, {
    hover: (x, from = null) => { hover = x; picked = x === null ? null : from; again(); },
    zoom: (factor, x) => look(of(x) - (of(x) - seen[0]) * factor, of(x) + (seen[1] - of(x)) * factor),
    select: (from, to) => look(of(from), of(to)),
    reset: () => look(...whole),
    scrolls: (event) => seen === whole && !event.ctrlKey,
  });
  new ResizeObserver(again).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
}

const atShare = ({ min, max, log }, share) => (log ? min * (max / min) ** share : min + share * (max - min));
