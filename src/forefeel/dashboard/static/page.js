// The page's side of the conversation: ask for what is new, draw it, ask again. Never more than one question is
// open, so a slow page is served less and nothing waits for it. Whatever came from the network is set as text.
import { Charts } from "./charts.js";
import { Traces } from "./traces.js";
import { showBanner, showCards, field, node, tell } from "./cards.js";

const PERIOD_MS = 31; // of two frames at 60 Hz
const AGAIN_MS = 700, STILL_MS = 1000;
const WINDOWS_S = [2, 5, 10, 20, 30, 60];
const SHORTEST_S = 0.2, KEPT_S = 60;
const THEME = "forefeel-theme";

const page = {
  facts: null, axis: null, axes: [], paused: false, window_s: 20, back_s: 0, at_s: 0, clock_s: 0, offset_ms: 0,
  updates: 0, drawn: 0, lost_ms: null, silence: null,
};
const traces = new Traces();
let charts = null, socket = null, asked_ms = 0, waits = false, dirty = true, frame_ms = 0;
page.traces = traces;
window.forefeel = page; // for who measures it

const replays = () => page.facts?.file != null;

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/conversation`);
  socket.onmessage = (event) => take(JSON.parse(event.data));
  socket.onclose = (event) => {
    page.lost_ms ??= Date.now();
    socket = null; waits = false; page.facts = null;
    const why = event.reason ? ` (${event.reason})` : "";
    tell("connection", `▲ no connection to the dashboard since ${clock(page.lost_ms)}${why}; tries again`);
    setTimeout(connect, AGAIN_MS);
  };
}

function take(answer) {
  waits = false;
  if (answer.facts) {
    page.at_s = page.facts ? 0 : page.at_s;
    page.facts = answer.facts;
    page.lost_ms = null;
    begin();
    return;
  }
  page.clock_s = answer.clock_s;
  page.offset_ms = Date.now() - 1e3 * answer.clock_s;
  showAxes(answer.axes, answer.axis);
  showSilence(answer.silence);
  document.body.classList.toggle("waits", answer.axis === null);
  if (answer.axis === null) return;
  if (answer.anew) traces.clear();
  traces.take(answer.traces, answer.now_s);
  charts.vessel = page.facts.vessel?.axis === answer.axis ? page.facts.vessel : null;
  showCards(answer.cards, charts, when, goTo);
  page.updates += 1;
  dirty = true;
}

function begin() {
  const { cell, file, duration_s, first_s, scene } = page.facts;
  tell("connection", "");
  showScene(scene);
  tell("cell", file ?? cell);
  tell("about", file ? `a recording of cell ${cell}` : "");
  traces.clear();
  node("stop").hidden = Boolean(file);
  node("player").hidden = !file;
  page.paused = false;
  field("about").hidden = Boolean(file);
  if (file) {
    node("slider").max = duration_s;
    seek(page.at_s || first_s);
  }
  showPaused();
}

function frame(now_ms) {
  requestAnimationFrame(frame);
  const passed_ms = now_ms - frame_ms;
  frame_ms = now_ms;
  if (page.facts && socket?.readyState === WebSocket.OPEN && !waits && now_ms - asked_ms >= PERIOD_MS) ask(now_ms);
  if (replays() && !page.paused) play(Math.min(passed_ms, 1000));
  if (dirty) {
    dirty = false;
    charts.draw(traces, traces.now_s - page.back_s, page.window_s);
    page.drawn += 1;
  }
}

function ask(now_ms) {
  if (page.paused && !replays()) return;
  // a recording that stands asks, too: another scene may have begun
  if (replays() && page.paused && page.asked_at_s === page.at_s && now_ms - asked_ms < STILL_MS) return;
  asked_ms = now_ms;
  waits = true;
  page.asked_at_s = page.at_s;
  const seen_s = Math.min(Math.max(1, page.window_s + page.back_s), KEPT_S);
  socket.send(JSON.stringify({ axis: page.axis, at_s: page.at_s, window_s: seen_s }));
}

// --- recordings ---

function play(passed_ms) {
  const { duration_s } = page.facts;
  seek(Math.min(duration_s, page.at_s + passed_ms / 1e3));
  if (page.at_s >= duration_s) pause(true);
}

function seek(at_s) {
  page.at_s = Math.min(Math.max(0, at_s), page.facts.duration_s);
  page.back_s = 0;
  node("slider").value = page.at_s;
  tell("place", `${elapsed(page.at_s)} / ${elapsed(page.facts.duration_s)}`);
}

// --- what the hand does ---

function pause(wanted) {
  page.paused = wanted;
  if (!wanted) page.back_s = 0;
  if (!wanted && replays() && page.at_s >= page.facts.duration_s) seek(0);
  page.asked_at_s = null;
  dirty = true;
  showPaused();
}

function showPaused() {
  const live = !replays();
  node("pause").setAttribute("aria-pressed", page.paused);
  node("pause").textContent = page.paused ? "▶" : "❚❚";
  node("play").textContent = page.paused ? "▶" : "❚❚";
  node("paused").hidden = !(page.paused && live);
}

function zoom(by) {
  const next = by > 0 ? WINDOWS_S.find((each) => each > page.window_s) : WINDOWS_S.findLast((each) => each < page.window_s);
  look(next ?? page.window_s, page.back_s);
}

/** Shows `window_s` seconds up to `back_s` before now. */
function look(window_s, back_s) {
  page.window_s = Math.min(Math.max(SHORTEST_S, window_s), KEPT_S);
  page.back_s = Math.min(Math.max(0, back_s), KEPT_S - page.window_s);
  page.asked_at_s = null;
  dirty = true;
}

const wants = {
  again: () => { dirty = true; },
  reset: () => { look(20, 0); if (!replays()) pause(false); },
  select: (from, to) => { pause(true); look(to - from, page.back_s + charts.frame.max - to); },
  zoom: (factor, at) => {
    const next_s = Math.min(Math.max(SHORTEST_S, page.window_s * factor), KEPT_S);
    const moved_s = (charts.frame.max - at) * (next_s / page.window_s - 1);
    look(next_s, page.paused ? page.back_s - moved_s : 0);
  },
};

function move(by_s) {
  if (replays()) seek(page.at_s + by_s);
  else if (page.paused) look(page.window_s, page.back_s - by_s);
  dirty = true;
}

/** To a moment of the server's clock, with what came after it. */
function goTo(server_s) {
  pause(true);
  if (replays()) seek(server_s - page.facts.zero_s + page.window_s / 4);
  else look(page.window_s, page.clock_s - server_s - page.window_s / 4);
}

function nextAxis() {
  const index = page.axes.indexOf(page.axis);
  choose(page.axes[(index + 1) % page.axes.length]);
}

function choose(axis) {
  page.axis = axis ?? null;
  page.asked_at_s = null;
}

const KEYS = {
  " ": () => pause(!page.paused),
  "+": () => zoom(-1), "=": () => zoom(-1), "-": () => zoom(1),
  ArrowLeft: (event) => move(event.shiftKey ? -10 : -1),
  ArrowRight: (event) => move(event.shiftKey ? 10 : 1),
  Home: () => replays() && seek(0),
  End: () => replays() && seek(page.facts.duration_s),
  a: nextAxis,
  "?": () => help(),
};

function help() {
  const box = node("help");
  if (box.open) box.close();
  else box.showModal();
}

/** Asks nothing. What it says itself stands until the slave's own word comes. */
async function stop() {
  node("stop").setAttribute("aria-busy", true);
  let why = "";
  try {
    const answer = await fetch("stop", { method: "POST" });
    const { heard, running } = answer.ok ? await answer.json() : {};
    if (!answer.ok) why = `the dashboard answered ${answer.status}`;
    else if (!heard) why = "no axis is heard";
    else if (running.length) why = `sent for 2 s, and not shown by ${running.join(", ")}`;
  } catch {
    why = "no connection to the dashboard";
  }
  node("stop").setAttribute("aria-busy", false);
  if (why) showBanner({ head: `The stop is not confirmed: ${why}`, more: "Use the handle's button or the slave's own switch" });
}

/** Dark or light: as the system has it, until somebody chose. */
function showTheme(name) {
  if (name) document.documentElement.dataset.theme = name;
  dirty = true;
}

/** A browser that may keep nothing refuses with an error. */
function stored(act) {
  try { return act(localStorage); } catch { return null; }
}

function changeTheme() {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  const next = (document.documentElement.dataset.theme ?? dark) === "dark" ? "light" : "dark";
  showTheme(next);
  stored((storage) => storage.setItem(THEME, next));
}

function listen() {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const act = KEYS[event.key];
    if (!act) return;
    event.preventDefault();
    act(event);
  });
  for (const [name, act] of [
    ["pause", () => pause(!page.paused)], ["play", () => pause(!page.paused)],
    ["keys", help], ["theme", changeTheme], ["stop", stop],
  ]) node(name).addEventListener("click", (event) => { act(); event.currentTarget.blur(); });
  node("help").addEventListener("click", () => node("help").close());
  node("axis").addEventListener("change", (event) => { choose(event.target.value); event.target.blur(); });
  node("slider").addEventListener("input", (event) => { pause(true); seek(Number(event.target.value)); });
}

// --- words ---

const two = (number) => String(Math.floor(number)).padStart(2, "0");
const elapsed = (s) => `${Math.floor(s / 60)}:${two(s % 60)}.${Math.floor((s % 1) * 10)}`;
const clock = (ms) => new Date(ms).toTimeString().slice(0, 8);

/** A time of the server's clock for people: of the day, or since the begin of a recording. */
function when(server_s) {
  if (replays()) return elapsed(Math.max(0, server_s - page.facts.zero_s));
  return clock(1e3 * server_s + page.offset_ms);
}

function showAxes(axes, axis) {
  if (axes.join("\n") !== page.axes.join("\n")) {
    page.axes = axes;
    node("axis").replaceChildren(...axes.map((name) => new Option(name, name)));
  }
  node("axis").hidden = axes.length < 1;
  if (node("axis").value !== axis) node("axis").value = axis;
  page.axis ??= axis;
}

/** What goes on, and where its results are. */
function showScene({ head, pages }) {
  node("scene").hidden = !head && !pages.length;
  tell("scene", head);
  document.title = head ? `forefeel: ${head}` : "forefeel";
  node("pages").replaceChildren(...pages.map((words) => {
    const link = document.createElement("a");
    Object.assign(link, { href: `results/${encodeURIComponent(words)}`, textContent: words, target: "_blank" });
    return link;
  }));
}

function showSilence(silence) {
  node("silence").hidden = !silence;
  if (!silence) return;
  tell("silence", silence.word);
  tell("silence-since", silence.since_s == null ? "" : `since ${when(silence.since_s)} (for ${silence.for})`);
  tell("silence-where", silence.where ? `listening at ${silence.where}` : "");
}

page.charts = charts = new Charts(node("force"), node("position"), node("picture"), wants);
const resized = new ResizeObserver(() => { dirty = true; });
for (const name of ["force", "position"]) resized.observe(node(name));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { dirty = true; });
showTheme(stored((storage) => storage.getItem(THEME)));
listen();
connect();
requestAnimationFrame(frame);
