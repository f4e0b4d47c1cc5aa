// Unpacks the payload and fills the page.

let replay = null;

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
  for (const each of told.missing) byId("player").append(el("p", { class: "problem" }, each));
  let picks = null;
  // policies get their colours in the order of the first figure that shows them
  for (const chart of told.charts) for (const label of chart.labels || (chart.series || chart.rows || []).map((each) => each.label)) rank(label);
  showCharts(told.charts, (cell) => picks && picks.open(cell));
  showTables(told.tables);
  if (told.episodes.length) {
    replay = new Replay(told, packed);
    picks = new Picks(replay);
  } else if (!told.missing.length) byId("replay").hidden = true;
}

const ready = main();
