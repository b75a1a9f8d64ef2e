// The page's side of the conversation: ask for what is new, draw it, ask again. Never more than one question is
// open, so a slow page is served less and nothing waits for it. Whatever came from the network is set as text.
import { Charts } from "./charts.js";
import { Traces } from "./traces.js";
import { showCards, field, node, tell } from "./cards.js";

const PERIOD_MS = 31; // of two frames at 60 Hz
const AGAIN_MS = 700;
const WINDOWS_S = [2, 5, 10, 20, 30, 60];

const page = {
  facts: null, axis: null, axes: [], paused: false, window: 3, back_s: 0, at_s: 0, clock_s: 0, offset_ms: 0,
  updates: 0, drawn: 0, lost_ms: null, silence: null,
};
const traces = new Traces();
let charts = null, socket = null, asked_ms = 0, waits = false, dirty = true, frame_ms = 0;
page.traces = traces;
window.forefeel = page; // for who measures it

const replays = () => page.facts?.file != null;
const window_s = () => WINDOWS_S[page.window];

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
  if (page.facts === null) {
    page.facts = answer;
    page.lost_ms = null;
    begin();
    return;
  }
  waits = false;
  page.clock_s = answer.clock_s;
  page.offset_ms = Date.now() - 1e3 * answer.clock_s;
  showAxes(answer.axes, answer.axis);
  showSilence(answer.silence);
  if (answer.axis === null) return;
  if (answer.anew) traces.clear();
  traces.take(answer.traces, answer.now_s);
  showCards(answer.cards, charts, when);
  page.updates += 1;
  dirty = true;
}

function begin() {
  const { cell, file, duration_s } = page.facts;
  tell("connection", "");
  tell("cell", file ?? cell);
  tell("about", file ? `a recording of cell ${cell}` : "");
  traces.clear();
  node("player").hidden = !file;
  field("about").hidden = Boolean(file);
  if (file) {
    node("slider").max = duration_s;
    page.paused = false;
    seek(page.at_s || Math.min(duration_s / 2, window_s()));
  }
  showPaused();
}

function frame(now_ms) {
  requestAnimationFrame(frame);
  const passed_ms = now_ms - frame_ms;
  frame_ms = now_ms;
  if (page.facts && socket?.readyState === WebSocket.OPEN && !waits && now_ms - asked_ms >= PERIOD_MS) ask(now_ms);
  if (replays() && !page.paused) play(Math.min(passed_ms, 1000));
  if (dirty && charts.ready()) {
    dirty = false;
    charts.draw(traces, traces.now_s - page.back_s, window_s());
    page.drawn += 1;
  }
}

function ask(now_ms) {
  if (page.paused && !replays()) return;
  if (replays() && page.paused && page.asked_at_s === page.at_s) return;
  asked_ms = now_ms;
  waits = true;
  page.asked_at_s = page.at_s;
  socket.send(JSON.stringify({ axis: page.axis, at_s: page.at_s, window_s: window_s() }));
}

// --- recordings ---

function play(passed_ms) {
  const { duration_s } = page.facts;
  seek(Math.min(duration_s, page.at_s + passed_ms / 1e3));
  if (page.at_s >= duration_s) pause(true);
}

function seek(at_s) {
  page.at_s = Math.min(Math.max(0, at_s), page.facts.duration_s);
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
  page.window = Math.min(Math.max(0, page.window + by), WINDOWS_S.length - 1);
  page.asked_at_s = null;
  dirty = true;
  showTicks();
}

function move(by_s) {
  if (replays()) seek(page.at_s + by_s);
  else if (page.paused) page.back_s = Math.min(Math.max(0, page.back_s - by_s), 60 - window_s());
  dirty = true;
  showTicks();
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
    ["nearer", () => zoom(-1)], ["farther", () => zoom(1)], ["keys", help],
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

function showSilence(silence) {
  node("silence").hidden = !silence;
  if (!silence) return;
  tell("silence", silence.word);
  tell("silence-since", silence.since_s == null ? "" : `since ${when(silence.since_s)} (for ${silence.for})`);
  tell("silence-where", silence.where ? `listening at ${silence.where}` : "");
}

function showTicks() {
  const step = window_s() / 4;
  const ends = [4, 3, 2, 1, 0].map((index) => {
    const s = index * step + page.back_s;
    return s === 0 ? "now" : `−${s} s`;
  });
  node("ticks").replaceChildren(...ends.map((text) => Object.assign(document.createElement("span"), { textContent: text })));
}

function start() {
  if (!document.querySelector('[data-id="force"] canvas') || !document.querySelector('[data-id="delays"] canvas')) {
    setTimeout(start, 50);
    return;
  }
  charts = new Charts(node("force"), node("delays"));
  listen();
  showTicks();
  connect();
  requestAnimationFrame(frame);
}

start();
