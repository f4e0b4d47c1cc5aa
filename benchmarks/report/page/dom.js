// Elements are made by code and filled with text nodes: what comes from files is never read as HTML.

const SVG = "http://www.w3.org/2000/svg";
const COLOURS = 9;
const DASHES = ["", "7 4", "2 3", "8 3 2 3", "12 3", "4 2", "8 3 2 3 2 3"];

function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes || {})) {
    if (name === "on") for (const [event, run] of Object.entries(value)) node.addEventListener(event, run);
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(name, value);
  }
  for (const child of children.flat(Infinity)) if (child !== null && child !== undefined) node.append(child);
  return node;
}

const el = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children);
const draw = (tag, attributes, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);
const button = (text, click, attributes = {}) => el("button", { type: "button", ...attributes, on: { click } }, text);
const byId = (id) => document.getElementById(id);

function say(text) {
  byId("said").textContent = text;
}

// What has come of something that one waited for: above the button that was pressed, or where that is not seen on top.
function noted(text, { left, right, top, bottom }) {
  const note = el("p", { class: "noted" }, text);
  for (const each of document.querySelectorAll(".noted")) each.remove();
  document.body.append(note);
  const { width, height } = note.getBoundingClientRect();
  const middle = Math.min(Math.max((left + right) / 2, width / 2 + 12), window.innerWidth - width / 2 - 12);
  if (top > height + 16 && bottom <= window.innerHeight) [note.style.left, note.style.top] = [`${middle}px`, `${top - height - 8}px`];
  for (const event of ["pointerdown", "wheel"]) document.addEventListener(event, () => note.remove(), { once: true }); // it is in nobody's way
  setTimeout(() => note.remove(), 8000);
  say(text);
}

function problem(text) {
  const place = byId("problem");
  place.textContent = text;
  place.hidden = false;
}

// A policy has one colour and one dash on the whole page, in the order in which policies come up.
const ranks = new Map();
function rank(label) {
  if (!ranks.has(label)) ranks.set(label, ranks.size);
  return ranks.get(label);
}
const YOURS = 2; // the colour of the hand in the demo, which nobody else has
// From the tenth on colours come again, dashed.
function colourName(label) {
  const nth = (rank(label) - COLOURS) % (COLOURS - 1);
  return `--c${rank(label) < COLOURS ? rank(label) : nth + (nth < YOURS ? 0 : 1)}`;
}
const colourOf = (label) => `var(${colourName(label)})`;
const dashOf = (label, twin = false) => DASHES[(Math.max(Math.floor((rank(label) - 1) / (COLOURS - 1)), 0) + twin) % DASHES.length]; // a second run of it has another

let inks = null;
function ink(name) {
  if (inks === null) {
    const style = getComputedStyle(document.documentElement);
    inks = new Map(["--paper", "--ink", "--faint", "--line", "--edge", "--panel", "--accent", "--think", "--solid", "--path", "--goal", "--fail"]
      .concat([...Array(COLOURS).keys()].map((k) => `--c${k}`)).map((each) => [each, style.getPropertyValue(each).trim()]));
  }
  return inks.get(name);
}

const themed = []; // run when the theme changes
const THEME = "wayfield theme"; // in the browser's storage
function wireTheme() {
  const root = document.documentElement;
  try {
    const kept = localStorage.getItem(THEME);
    if (["light", "dark"].includes(kept)) root.dataset.theme = kept;
  } catch { /* a browser that keeps nothing */ }
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const changed = () => { inks = null; for (const run of themed) run(); };
  dark.addEventListener("change", changed);
  byId("theme").addEventListener("click", () => {
    const now = root.dataset.theme || (dark.matches ? "dark" : "light");
    root.dataset.theme = now === "dark" ? "light" : "dark";
    try {
      localStorage.setItem(THEME, root.dataset.theme);
    } catch { /* as above */ }
    changed();
  });
}

function swatch(label, twin) {
  return draw("svg", { viewBox: "0 0 30 12", class: "swatch", "aria-hidden": "true" },
    draw("line", { x1: 1, y1: 6, x2: 29, y2: 6, stroke: colourOf(label), "stroke-width": 4, "stroke-dasharray": dashOf(label, twin) }));
}

function downloaded(blob, name) {
  const link = el("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// By the name that Python has: what is shown instead, and what it does in a phrase; the payload of the demo tells them.
const NAMES = {};
const OWN = { trained: "", tuned: ", tuned", "hand-tuned": ", hand-tuned", paper: ", paper's gains" };
const FOUND = { tuned: "gains (settings) found by a search", "hand-tuned": "gains (settings) found by a person or an older search", paper: "gains (settings) of its paper" };

// A policy's label as it is shown.
function called(label) {
  if (label === KEYBOARD) return "you";
  const [, base, gains] = label.match(/^(\w+)(?: \((.*)\))?$/) || [];
  return base in NAMES ? `${NAMES[base][0]}${OWN[gains] ?? ""}` : label;
}

// What a policy does, in a phrase; "" of one that nobody describes.
const aboutOf = (label) => {
  const [base, gains = ""] = label.split(" (");
  return [(NAMES[base] || ["", ""])[1], FOUND[gains.slice(0, -1)]].filter(Boolean).join("; ");
};

// Metres in mm: a hundredth is the least that is told.
const millimetres = (value) => (value < 0.01 ? (1000 * value).toFixed(2) : short(1000 * value));
const short = (value, digits = 3) => (value === null || Number.isNaN(value) ? "" : Number(value.toPrecision(digits)).toString());
