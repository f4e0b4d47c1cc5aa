// Unpacks the payload and fills the page.

let replay = null;
let drive = null;
let picks = null;

// What the run found, above the picture.
function verdict() {
  return el("div", { class: "verdict", tabindex: "0", role: "region", "aria-label": "results in a sentence" },
    [...document.querySelectorAll("#summary > p:not(.note)")].map((each) => each.cloneNode(true)));
}

// A part of the page; the browser's Back leads from it to the one before.
function showTab(name, enters = Boolean(document.body.dataset.tab)) {
  if (enters && name !== document.body.dataset.tab) history.pushState({ ...history.state, tab: name }, "");
  document.body.dataset.tab = name;
  for (const each of byId("tabs").children) {
    if (each.dataset.to === name) each.setAttribute("aria-current", "page");
    else each.removeAttribute("aria-current");
  }
  window.scrollTo(0, 0);
}

function wireTabs(tabs) {
  const able = tabs.filter(([, , shown]) => shown);
  byId("tabs").append(...able.map(([name, text]) => button(text, () => showTab(name), { "data-to": name })));
  byId("tabs").hidden = false;
  showTab(able[0][0]);
  window.addEventListener("popstate", ({ state }) => showTab((state && state.tab) || able[0][0], false));
}

// What the page opens on, and what its title leads back to.
function opening(demo) {
  if (location.hash && location.hash !== "#replay") history.replaceState(null, "", location.href.split("#")[0]);
  showTab("replay");
  replay.follow(false);
  replay.seek(0);
  drive.share.restore(encodeURIComponent(JSON.stringify(demo.opening)));
  if (!still()) replay.toggle(true);
}

async function main() {
  wireTheme();
  let payload;
  try {
    payload = await readPayload();
  } catch (error) {
    problem(`What this page embeds cannot be read: ${error.message}. The summary and how it was made are below.`);
    return;
  }
  const { told, packed } = payload;
  Object.assign(HULLS, told.hulls);
  Object.assign(BOXES, told.boxes);
  // policies get their colours in the order of the first figure that shows them
  for (const chart of told.charts) for (const label of chart.labels || (chart.series || chart.rows || []).map((each) => each.label)) rank(label);
  showCharts(told.charts, (cell) => picks && picks.open(cell));
  showTables(told.tables);
  const draws = Boolean(el("canvas").getContext("2d"));
  if (!draws) problem("This browser lets the page draw no pictures (canvas 2D is switched off), so no robot is shown here; the rest of the page can be read.");
  const driven = draws && (told.episodes.length || told.demo);
  byId(driven ? "player" : "summary").append(...told.missing.map((each) => el("p", { class: "problem" }, each)));
  wireTabs([["replay", told.demo ? "Simulator" : "Replay and drive", driven], ["summary", told.demo ? "About" : "Results", true],
    ["charts", "Figures", told.charts.length], ["tables", "Tables", told.tables.length], ["made", "How it was made", !told.demo]]);
  if (told.demo) {
    byId("summary-title").textContent = "What this is";
    byId("summary").append(document.querySelector("dl.made"));
    for (const each of document.querySelectorAll("dl.made dd")) if (/^https?:/.test(each.textContent)) each.replaceChildren(el("a", { href: each.textContent }, each.textContent));
    Object.assign(NAMES, told.demo.names);
    byId("title").replaceChildren(el("a", { href: "#", title: "back to the start", on: { click: (event) => { event.preventDefault(); if (drive) opening(told.demo); } } }, byId("title").textContent));
  }
  else if (driven) byId("player").before(verdict());
  if (!driven) return;
  replay = new Replay(told, packed);
  picks = told.demo ? new Draws(replay) : new Picks(replay);
  if (!told.demo && !location.hash) picks.duel(told.duels);
  if (!told.kernels) return;
  if (typeof WebAssembly === "undefined") {
    problem(`This browser has no WebAssembly, so no robot can be driven here; current versions of Chrome, Edge, Firefox and Safari have it. ${told.demo ? "Its scenes can be looked at" : "Recorded episodes can be replayed"}.`);
    return;
  }
  try {
    const slice = ([at, length]) => packed.slice(at, at + length);
    const tables = { ...told.kernels, blobs: told.kernels.blobs.map(slice) };
    drive = new Drive(replay, await Kernels.load(slice(told.kernels.module), tables), Boolean(told.demo));
    if (!restored() && told.demo) opening(told.demo);
  } catch (error) {
    replay.side.prepend(el("p", { class: "problem" }, `Nothing can be driven here: ${error.message}.`));
  }
}

const ready = main();
