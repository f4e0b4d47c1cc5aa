// The full tables: sorted by any column, copied as Markdown, LaTeX or CSV.

const FORMATS = {
  Markdown: ({ header, rows }) => {
    const line = (cells) => `| ${cells.map((cell) => cell.replaceAll("|", "\\|")).join(" | ")} |`;
    return [line(header), `|${header.map(() => "---|").join("")}`, ...rows.map(line)].join("\n") + "\n";
  },
  LaTeX: ({ title, header, rows }) => {
    const special = { "\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}" };
    const safe = (cell) => cell.replace(/[\\~^&%$#_{}]/g, (mark) => special[mark] || `\\${mark}`);
    const line = (cells) => `${cells.map(safe).join(" & ")} \\\\`;
    return [`% ${title}`, `\\begin{tabular}{${"l".repeat(header.length)}}`, "\\toprule", line(header), "\\midrule",
      ...rows.map(line), "\\bottomrule", "\\end{tabular}"].join("\n") + "\n";
  },
  CSV: ({ header, rows }) => {
    const line = (cells) => cells.map((cell) => (/[",\n]/.test(cell) ? `"${cell.replaceAll('"', '""')}"` : cell)).join(",");
    return [header, ...rows].map(line).join("\n") + "\n";
  },
};

async function copied(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const place = el("textarea", { class: "hidden" });
    place.value = text;
    document.body.append(place);
    place.select();
    const done = document.execCommand("copy");
    place.remove();
    return done;
  }
}

// Numbers by their first number, text by its letters; empty cells come last either way.
function comparer(column, sign) {
  const key = (row) => {
    const found = /^\s*[<>+]?\s*([-+]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?)/i.exec(row[column]);
    return found ? Number(found[1].replaceAll(",", "")) : null;
  };
  return (a, b) => {
    if (!a[column] || !b[column]) return (a[column] ? 0 : 1) - (b[column] ? 0 : 1);
    const [x, y] = [key(a), key(b)];
    if (x !== null && y !== null) return sign * (x - y);
    if (x !== null || y !== null) return x !== null ? -1 : 1;
    return sign * a[column].localeCompare(b[column]);
  };
}

function fullTable(table) {
  let rows = table.rows;
  const numeric = table.header.map((_, k) => table.rows.every((row) => !row[k] || /^\s*[<>+±−-]?\s*[\d.]/.test(row[k])));
  const body = el("tbody");
  const show = () => body.replaceChildren(...rows.map((row) => el("tr", {}, row.map((cell, k) => el("td", { class: numeric[k] && "number" }, cell)))));
  const heads = table.header.map((name, column) => {
    const head = el("th", { scope: "col", class: numeric[column] && "number" }, el("button", { type: "button", on: { click: () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      for (const each of heads) each.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      rows = [...table.rows].sort(comparer(column, up ? 1 : -1));
      show();
      say(`sorted by ${name}, ${up ? "ascending" : "descending"}`);
    } } }, name));
    return head;
  });
  show();
  const buttons = Object.entries(FORMATS).map(([name, write]) => el("button", { type: "button", on: { click: async () => {
    say(await copied(write({ ...table, rows })) ? `${table.title}: copied as ${name}` : "the browser does not let the page copy");
  } } }, name));
  return el("details", { class: "table" }, el("summary", {}, table.title),
    el("div", { class: "copy" }, "copy as", buttons),
    el("div", { class: "wide full", tabindex: "0", role: "region", "aria-label": table.title },
      el("table", {}, el("thead", {}, el("tr", {}, heads)), body)),
    el("p", { class: "note" }, table.note));
}

function showTables(tables) {
  byId("full").append(...tables.map(fullTable));
  if (tables.length) byId("full").firstElementChild.open = true;
  else byId("tables").hidden = true;
}
