// Unpacks the payload and fills the page.

let replay = null;
let drive = null;

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
  for (const each of told.missing) byId("player").append(el("p", { class: "problem" }, each));
  let picks = null;
  // policies get their colours in the order of the first figure that shows them
  for (const chart of told.charts) for (const label of chart.labels || (chart.series || chart.rows || []).map((each) => each.label)) rank(label);
  showCharts(told.charts, (cell) => picks && picks.open(cell));
  showTables(told.tables);
  if (told.demo) byId("summary-title").textContent = "What this is";
  if (!told.episodes.length && !told.demo && !told.missing.length) byId("replay").hidden = true;
  for (const link of document.querySelectorAll("nav a")) link.hidden = byId(link.hash.slice(1)).hidden;
  document.querySelector("nav a").textContent = byId("summary-title").textContent;
  if (!told.episodes.length && !told.demo) return;
  replay = new Replay(told, packed);
  picks = told.demo ? new Draws(replay) : new Picks(replay);
  if (!told.kernels) return;
  if (typeof WebAssembly === "undefined") {
    replay.below.append(el("p", { class: "problem" }, "This browser has no WebAssembly: episodes can be replayed, but nothing can be driven here."));
    return;
  }
  try {
    const slice = ([at, length]) => packed.slice(at, at + length);
    const tables = { ...told.kernels, blobs: told.kernels.blobs.map(slice) };
    drive = new Drive(replay, await Kernels.load(slice(told.kernels.module), tables), Boolean(told.demo));
    if (told.demo) drive.go();
  } catch (error) {
    replay.below.append(el("p", { class: "problem" }, `Nothing can be driven here: ${error.message}.`));
  }
}

const ready = main();
