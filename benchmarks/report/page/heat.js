// Families and tiers as a heat map; a cell opens its episodes.

// Viridis in eight steps: dark is low, and the order stays in every common colour blindness.
const VIRIDIS = ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"];

function heat(chart, open) {
  const [low, high] = chart.ends;
  const share = ([won, count, cost]) => {
    if (!count || (chart.by_cost && cost === null)) return null;
    if (!chart.by_cost) return (won / count - low) / (high - low);
    const part = Math.log(Math.max(cost, low) / low) / Math.log(high / low);
    return 1 - Math.min(part, 1); // light is better in both
  };
  const cell = (label, [kind, name], value) => {
    const [won, count, cost] = value;
    if (!count) return el("td", {});
    const part = share(value);
    const step = part === null ? -1 : Math.min(VIRIDIS.length - 1, Math.floor(part * VIRIDIS.length));
    const style = step < 0 ? "background: var(--panel); color: var(--fail)" : `background: ${VIRIDIS[step]}; color: ${step > 3 ? "#000" : "#fff"}`;
    const text = chart.by_cost ? (cost === null ? "×" : (cost * chart.factor).toFixed(chart.decimals) + (won < count ? "·" : "")) : (100 * won / count).toFixed(0);
    const title = `${label}, ${kind} ${name}: ${won} of ${count} succeed${cost === null ? "" : `, cost of the successes ${short(cost)}`}; open its episodes`;
    return el("td", { class: kind }, button(text, () => open({ contest: chart.contest, robot: chart.robot, kind, name, policy: label }), { tabindex: -1, style, title, "aria-label": title }));
  };
  const head = el("tr", {}, el("th", {}), chart.columns.map(([kind, name]) => el("th", { scope: "col", class: kind }, el("span", {}, name))));
  const rows = chart.cells.map((cells, i) => el("tr", {}, el("th", { scope: "row" }, chart.labels[i]),
    cells.map((value, j) => cell(chart.labels[i], chart.columns[j], value))));
  const table = el("table", { class: "heat" }, el("thead", {}, head), el("tbody", {}, rows));
  byArrows(table);
  const reading = chart.by_cost ? " × none succeeds, · some fail." : "";
  return el("figure", { class: "full-width" }, el("figcaption", {}, chart.title),
    el("div", { class: "wide", tabindex: "0", role: "region", "aria-label": chart.title }, table),
    el("p", { class: "note" }, `${chart.what}; light is better.${reading} A cell opens its episodes in the replay.`));
}

// One stop of the tab key: arrows go from cell to cell, Home and End to the ends of a row.
function byArrows(table) {
  const first = table.querySelector("button");
  if (first) first.tabIndex = 0;
  const move = (from, row, column, by) => {
    for (let r = row, c = column; table.rows[r] && table.rows[r].cells[c]; r += by[0], c += by[1]) {
      const button = table.rows[r].cells[c].querySelector("button");
      if (!button) continue;
      [from.tabIndex, button.tabIndex] = [-1, 0];
      button.focus();
      return;
    }
  };
  table.addEventListener("keydown", (event) => {
    const cell = event.target.closest("td");
    const keys = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
    if (!cell) return;
    const [row, column, width] = [cell.parentNode.rowIndex, cell.cellIndex, cell.parentNode.cells.length];
    if (keys[event.key]) move(event.target, row + keys[event.key][0], column + keys[event.key][1], keys[event.key]);
    else if (event.key === "Home") move(event.target, row, 1, [0, 1]);
    else if (event.key === "End") move(event.target, row, width - 1, [0, -1]);
    else return;
    event.preventDefault();
  });
}
