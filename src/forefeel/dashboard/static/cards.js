// Cards, lights and lists. Everything is set as text.
const MARKS = { good: "●", busy: "◐", warn: "▲", bad: "✖", off: "○" };
const KNOWN = { well: "●", roughly: "◐", "not yet": "○", fixed: "■" };
const LEVELS = Object.keys(MARKS);

export const node = (name) => document.querySelector(`[data-id="${name}"]`);
export const field = (name) => document.querySelector(`[data-field="${name}"]`);

export function tell(name, text) {
  const found = field(name);
  if (found.textContent !== text) found.textContent = text;
}

/** `when`: a time of the server in words; `goTo`: shows that time in the charts. */
export function showCards(cards, charts, when, goTo) {
  const show = {
    numbers: (card) => { charts.late_ms = card.delay === "–" ? null : Number(card.delay); showNumbers(card); },
    banner: showBanner,
    gain: showGain,
    standing: showLights,
    watch: (card) => showWatch(card, when),
    energy: showEnergy,
    delay: (words) => tell("delay-words", words),
    model: (card) => { charts.friction = card.friction; showModel(card); },
    loops: showLoops,
    counted: (words) => tell("counted", words),
    events: (card) => showEvents(card, when, goTo),
  };
  for (const [name, card] of Object.entries(cards)) show[name](card);
}

function showNumbers(card) {
  for (const name of ["felt", "predicted", "measured", "delay"]) tell(name, card[name]);
  tell("band", card.band);
  tell("age", card.age);
  tell("limited", card.limited ? "▲ limited" : "");
}

export function showBanner(card) {
  node("banner").hidden = !card.head;
  tell("banner", card.head);
  tell("banner-more", card.more);
}

function showGain(card) {
  level(node("gain"), card.level);
  tell("gain-name", card.name);
  tell("gain", card.error);
  tell("gain-more", card.more);
}

function showLights(lights) {
  node("lights").replaceChildren(...lights.map(({ name, level, word, more }) => {
    const light = made("div", `ff-light ${level}`);
    light.dataset.light = name;
    light.title = more;
    const words = made("span", "word");
    words.append(made("small", "", name), word);
    light.append(made("span", "mark", MARKS[level]), words, made("span", "more", more));
    return light;
  }));
}

function showWatch(card, when) {
  level(node("watch"), card.level);
  node("watch").querySelector(".mark").textContent = MARKS[card.level];
  tell("watch-word", card.word);
  tell("watch-since", card.since_s === null ? "" : `since ${when(card.since_s)}`);
  tell("watch-signs", card.signs);
  tell("watch-next", card.next);
}

function showEnergy(card) {
  mark("energy-mark", card.level);
  tell("energy", card.value);
  tell("energy-words", card.words);
}

function showModel(card) {
  const rows = card.parameters.map(({ name, value, deviation, unit, known }) => row([
    cell(name, "name"), cell(value, "n"), cell(`± ${deviation}`, "n"), cell(unit, "unit"),
    knownCell(known),
  ]));
  node("parameters").replaceChildren(...rows);
  tell("statements", card.statements.join(" · "));
  tell("model-foot", card.foot);
}

function knownCell(known) {
  const found = cell(KNOWN[known], `n ff-known ${known.replace(" ", "-")}`);
  found.append(made("span", "", ` ${known}`));
  found.title = known;
  return found;
}

function showLoops(loops) {
  mark("loops-mark", ["bad", "warn", "good"].find((each) => loops.some((loop) => loop.level === each)) ?? "off");
  const head = row(["", "median", "99 %", "most", "missed"].map((text, index) => cell(text, index ? "n" : "", "th")));
  node("loops").replaceChildren(head, ...loops.map((loop) => {
    const who = cell("", loop.level);
    who.append(made("span", "mark", MARKS[loop.level]), `${loop.who} ${loop.word}`);
    return row([who, ...[loop.p50, loop.p99, loop.max, loop.missed].map((text) => cell(text, "n"))]);
  }));
}

function showEvents(events, when, goTo) {
  const rows = events.map((event) => {
    const text = cell("", event.level);
    text.append(made("span", "mark", MARKS[event.level]), event.text);
    const line = row([cell(when(event.heard_s), "time"), cell(event.who, "who"), text]);
    line.className = "ff-event";
    line.addEventListener("click", () => goTo(event.heard_s));
    return line;
  });
  node("events").replaceChildren(...(rows.length ? rows : [row([cell("none since this page's server listens")])]));
}

function mark(name, of) {
  tell(name, MARKS[of]);
  field(name).className = `mark ${of}`;
}

function level(element, name) {
  element.classList.remove(...LEVELS);
  element.classList.add(name);
}

function made(tag, classes = "", text = "") {
  const found = document.createElement(tag);
  if (classes) found.className = classes;
  if (text) found.textContent = text;
  return found;
}

const cell = (text, classes = "", tag = "td") => made(tag, classes, text);

function row(cells) {
  const found = made("tr");
  found.append(...cells);
  return found;
}
