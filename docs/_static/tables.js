// Long tables sort by a click on a head, which stays in view; columns of numbers are set to the right.
"use strict";

// a number, its interval and its unit stand on one line, and so do the words for a set of gains
const WHOLE = /[+−-]?\d[\d.,]*(?: %)? \[[^\]]*\](?: (?:points|mm|m|s)\b)?|[+−-]?\d[\d.,]* (?:%|mm|m\/s|m|s|points)(?![\w/])|\(hand-tuned\)/;
for (const cell of document.querySelectorAll(".content td")) {
  const walker = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT);
  const texts = [];
  while (walker.nextNode()) if (!walker.currentNode.parentElement.closest("code")) texts.push(walker.currentNode);
  for (const node of texts) {
    for (let rest = node, found; (found = WHOLE.exec(rest.data)); ) {
      const span = document.createElement("span");
      span.className = "whole";
      const whole = rest.splitText(found.index);
      rest = whole.splitText(found[0].length);
      whole.replaceWith(span);
      span.append(whole);
    }
  }
}

for (const table of document.querySelectorAll(".content table.docutils")) {
  const [head] = table.tHead ? table.tHead.rows : [];
  const body = table.tBodies[0];
  if (!head || !body || body.rows.length < 5) continue;
  const text = (row, k) => (row.cells[k] ? row.cells[k].textContent.trim() : "");
  const number = (told) => { const found = /^[<>+±]?\s*([-−+]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?)/i.exec(told); return found ? Number(found[1].replaceAll(",", "").replace("−", "-")) : null; };
  const first = [...body.rows];
  const figures = first.flatMap((row) => [...row.cells].slice(1)).filter((cell) => number(cell.textContent.trim()) !== null);
  for (const cell of figures) if (cell.textContent.trim().length < 25) cell.classList.add("whole");
  [...head.cells].forEach((cell, k) => {
    const told = first.map((row) => text(row, k)).filter(Boolean);
    if (told.length && told.every((each) => /^[<>+±−-]?\s*\d[\d.,]*(e[-+]?\d+)?\s*(%|\[[^\]]*\]|\([^)]*\))?$/i.test(each))) for (const row of [head, ...first]) if (row.cells[k]) row.cells[k].classList.add("number");
    if (!figures.length || !cell.textContent.trim()) return;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sort";
    button.append(...cell.childNodes);
    cell.append(button);
    button.addEventListener("click", () => {
      const up = cell.getAttribute("aria-sort") !== "ascending";
      for (const each of head.cells) each.removeAttribute("aria-sort");
      cell.setAttribute("aria-sort", up ? "ascending" : "descending");
      const order = (a, b) => {
        const [x, y] = [text(a, k), text(b, k)];
        if (!x || !y) return (x ? 0 : 1) - (y ? 0 : 1);
        const [u, v] = [number(x), number(y)];
        return (up ? 1 : -1) * (u !== null && v !== null ? u - v : u !== null || v !== null ? (u === null) - (v === null) : x.localeCompare(y));
      };
      body.append(...first.slice().sort(order));
    });
  });
  const wrapper = table.closest(".table-wrapper");
  if (wrapper) {
    wrapper.tabIndex = 0;
    wrapper.setAttribute("role", "region");
    wrapper.setAttribute("aria-label", (table.caption && table.caption.textContent.trim()) || "table");
    if (first.length > 15) wrapper.classList.add("long");
  }
}
