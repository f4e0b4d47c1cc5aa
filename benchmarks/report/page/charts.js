// Figures as SVG, each with its text alternative: a sentence for the picture, and its numbers as a table.

const WIDTH = 560;

function scale(low, high, from, to, log) {
  const f = log ? Math.log10 : (value) => value;
  const [a, b] = [f(low), f(high)];
  return (value) => from + ((f(value) - a) / (b - a || 1)) * (to - from);
}

function ticks(low, high, log) {
  if (log) {
    const found = [];
    for (let e = Math.floor(Math.log10(low)); e <= Math.ceil(Math.log10(high)); e++) {
      for (const m of Math.log10(high / low) > 2.2 ? [1] : [1, 2, 5]) {
        const value = m * 10 ** e;
        if (value >= low * 0.999 && value <= high * 1.001) found.push(value);
      }
    }
    return found;
  }
  const rough = (high - low) / 5 || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((m) => m * power >= rough) || 10);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(Number((k * step).toPrecision(10)));
  return found;
}

function numbersTable(header, rows) {
  return el("details", {}, el("summary", {}, "The numbers"), el("div", { class: "wide", tabindex: "0" },
    el("table", {}, el("thead", {}, el("tr", {}, header.map((cell) => el("th", { scope: "col" }, cell)))),
      el("tbody", {}, rows.map((row) => el("tr", {}, row.map((cell) => el("td", {}, cell))))))));
}

const campOf = (label) => (label.includes("(trained") ? "var(--c0)" : "var(--c1)");

// Sorted, the best first, in the colour of its camp, for there are more policies than colours; bars begin at zero, on a logarithmic axis there are dots.
function bars({ rows: given, ...rest }) {
  const chart = { ...rest, rows: [...given].sort((a, b) => (rest.most ? b.values[0] - a.values[0] : a.values[0] - b.values[0])) };
  const left = 16 + 7 * Math.min(34, Math.max(...chart.rows.map((row) => row.label.length)));
  const high = 22;
  const height = chart.rows.length * high + 40;
  const at = scale(0, chart.most, left, WIDTH - 58, false);
  const picture = draw("svg", { viewBox: `0 0 ${WIDTH} ${height}`, role: "img", "aria-label":
    `${chart.title}. ${chart.rows.map((row) => `${row.label} ${row.values[0].toFixed(chart.decimals)}`).join("; ")}` });
  for (const tick of ticks(0, chart.most, false)) {
    picture.append(draw("line", { class: "axis", x1: at(tick), x2: at(tick), y1: 4, y2: height - 30 }),
      draw("text", { class: "faint", x: at(tick), y: height - 14, "text-anchor": "middle" }, short(tick)));
  }
  chart.rows.forEach((row, k) => {
    const y = 8 + k * high;
    const [value, a, b] = row.values.length > 1 ? row.values : [row.values[0], row.values[0], row.values[0]];
    picture.append(
      draw("text", { x: left - 6, y: y + 12, "text-anchor": "end" }, row.label.length > 34 ? `${row.label.slice(0, 33)}…` : row.label),
      chart.log ? draw("circle", { cx: at(value), cy: y + 8.5, r: 5, fill: campOf(row.label) })
        : draw("rect", { x: left, y: y + 2, width: Math.max(at(value) - left, 1), height: 13, fill: campOf(row.label) }),
      draw("path", { class: "rule", fill: "none", stroke: b > a ? "var(--ink)" : "none", d: `M${at(a)} ${y + 8.5}H${at(b)}M${at(a)} ${y + 5}v7M${at(b)} ${y + 5}v7` }),
      draw("text", { class: "faint", x: Math.min(at(Math.max(b, value)) + 5, WIDTH - 52), y: y + 12 }, value.toFixed(chart.decimals)));
  });
  const table = numbersTable(["policy", `value (${chart.unit})`, "95 % interval"], chart.rows.map(({ label, values }) =>
    [label, values[0].toFixed(chart.decimals), values.length > 1 ? `${values[1].toFixed(chart.decimals)} to ${values[2].toFixed(chart.decimals)}` : "too few scenarios"]));
  const key = el("p", { class: "note" }, "Blue: controllers. Orange: trained agents. Lines: 95 % intervals.");
  return el("figure", {}, el("figcaption", {}, chart.title), picture, key, table);
}

// The speed-accuracy front, and success over the levels of disturbance: curves with intervals.
function curves(chart) {
  const height = 380;
  const points = chart.series.flatMap((series) => series.points);
  const levels = chart.levels || null;
  const ys = points.flatMap((point) => [point.low, point.high]);
  const [low, high] = levels ? [0, 100] : chart.log ? [0.8 * Math.min(...ys.filter((y) => y > 0)), 1.2 * Math.max(...ys)] : [0, 1.05 * Math.max(...ys)];
  const xs = points.map((point) => point.x);
  const x = scale(levels ? -0.2 : Math.min(...xs) - 0.05, levels ? levels.length - 0.8 : Math.max(...xs) + 0.05, 56, WIDTH - 12, false);
  const y = scale(low, high, height - 44, 10, chart.log);
  const at = (value) => y(chart.log ? Math.max(value, low) : value);
  const picture = draw("svg", { viewBox: `0 0 ${WIDTH} ${height}`, role: "img",
    "aria-label": `${chart.title}: ${chart.y} over ${chart.x}, ${chart.series.length} curves; the numbers are below.` });
  for (const tick of ticks(low, high, chart.log)) {
    picture.append(draw("line", { class: "axis", x1: 56, x2: WIDTH - 12, y1: y(tick), y2: y(tick) }),
      draw("text", { class: "faint", x: 50, y: y(tick) + 4, "text-anchor": "end" }, short(tick)));
  }
  const below = levels ? levels.map((name, k) => [k, name]) : ticks(Math.min(...xs), Math.max(...xs), false).map((tick) => [tick, short(tick)]);
  for (const [tick, text] of below) picture.append(draw("text", { class: "faint", x: x(tick), y: height - 24, "text-anchor": "middle" }, text));
  picture.append(draw("text", { x: (WIDTH + 44) / 2, y: height - 6, "text-anchor": "middle" }, chart.x),
    draw("text", { x: 12, y: height / 2, "text-anchor": "middle", transform: `rotate(-90 12 ${height / 2})` }, chart.y));
  chart.series.forEach((series) => {
    const shift = levels ? 4 * (rank(series.label) % 7) - 12 : 0;
    const place = series.points.map((point) => `${x(point.x) + shift} ${at(point.y)}`);
    const colour = colourOf(series.label);
    picture.append(draw("polyline", { points: place.join(" "), fill: "none", stroke: colour, "stroke-width": 2, "stroke-dasharray": dashOf(series.label) }));
    for (const point of series.points) {
      picture.append(draw("line", { x1: x(point.x) + shift, x2: x(point.x) + shift, y1: at(point.low), y2: at(point.high), stroke: colour, opacity: 0.6 }),
        draw("circle", { cx: x(point.x) + shift, cy: at(point.y), r: 4, fill: point.lost ? "var(--paper)" : colour, stroke: colour, "stroke-width": 2 },
          draw("title", {}, `${series.label}, target ${point.asked}: ${short(point.y)} [${short(point.low)}, ${short(point.high)}]${levels ? "" : ` at ${short(point.x)} m/s`}${point.lost ? ", a run failed" : ""}`)));
    }
  });
  const legend = el("ul", { class: "legend" }, chart.series.map(({ label }) => el("li", {}, swatch(label), label)));
  const note = chart.kind === "front" ? el("p", { class: "note" }, "Down and to the right is better. Hollow: a run failed at that speed.") : null;
  const table = numbersTable(["policy", levels ? "level" : "target speed (m/s)", chart.x, chart.y, "95 % interval"], chart.series.flatMap(({ label, points: own }) =>
    own.map((point) => [label, String(point.asked), levels ? "" : short(point.x), short(point.y), `${short(point.low)} to ${short(point.high)}`])));
  return el("figure", {}, el("figcaption", {}, chart.title), picture, legend, note, table);
}

function duels(chart) {
  const shade = (often) => {
    const part = Math.round(200 * Math.abs(often - 0.5));
    return `background: color-mix(in srgb, var(${often > 0.5 ? "--cold" : "--warm"}) ${part}%, var(--panel))`;
  };
  const head = el("tr", {}, el("th", {}), chart.labels.map((label) => el("th", { scope: "col" }, el("span", {}, label))));
  const rows = chart.cells.map((cells, i) => el("tr", {}, el("th", { scope: "row" }, chart.labels[i]), cells.map((often, j) => {
    if (often === null) return el("td", {}, el("span", {}, "–"));
    const title = `${chart.labels[i]} against ${chart.labels[j]}: better in ${(100 * often).toFixed(0)} %`;
    return el("td", {}, el("span", { style: shade(often), title }, (100 * often).toFixed(0)));
  })));
  return el("figure", { class: "full-width" }, el("figcaption", {}, chart.title),
    el("div", { class: "wide", tabindex: "0", role: "region", "aria-label": chart.title },
      el("table", { class: "duels" }, el("thead", {}, head), el("tbody", {}, rows))),
    el("p", { class: "note" }, "Per cent of the scenarios in which the policy of the line does better than that of the column, equal ones counted half. A share is no verdict: those are in the table of pairs."));
}

function showCharts(charts, open) {
  const kinds = { bars, duels, front: curves, ladder: curves, heat: (chart) => heat(chart, open) };
  const place = byId("figures");
  for (const kind of ["front", "ladder", "bars", "duels", "heat"]) {
    for (const chart of charts) if (chart.kind === kind) place.append(kinds[kind](chart));
  }
  if (!charts.length) byId("charts").hidden = true;
}
