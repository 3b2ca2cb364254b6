// The page: knobs that switch between the table's views, columns that sort, cells with details, commands to copy.
"use strict";

const known = JSON.parse(document.getElementById("views").textContent);
const scoreTable = document.getElementById("scores");
const byId = (id) => document.getElementById(id);

function make(name, attributes = {}, ...content) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...content);
  return node;
}

// Knobs

function setText(id, text) {
  const node = byId(id);
  if (node && node.textContent !== text) node.textContent = text;
}

function showHighlights(view) {
  for (const line of scoreTable.tBodies[0].rows) {
    const row = Number(line.dataset.row);
    known.positions.forEach((position, column) => {
      const cell = line.querySelector(`[data-column="${position}"]`);
      cell.classList.toggle("highlighted", view.highlighted[row].includes(column));
      cell.querySelector(".dagger").textContent = view.lost[row].includes(column) ? known.labels.lost : "";
    });
  }
}

function showNotes(notes) {
  const shown = document.querySelectorAll('#notes [data-kind="highlight"]');
  const fresh = notes.map(([label, text]) =>
    make("div", { "data-kind": "highlight" }, make("dt", {}, label), " ", make("dd", {}, known.texts[text])),
  );
  shown[0].before(...fresh);
  for (const old of shown) old.remove();
}

// Whether a row's scores are seeds or starts decides what the note on seeds may say.
function showSeeds(text) {
  for (const entry of document.querySelectorAll("#notes div")) {
    if (entry.querySelector("dt").textContent === "Seeds") entry.querySelector("dd").textContent = text;
  }
  const limit = document.querySelector('[data-note="Seeds"] .note');
  if (limit) limit.textContent = text;
}

function showPairs(view) {
  for (const line of document.querySelectorAll("[data-pair]")) {
    const counts = view.pairs[Number(line.dataset.pair)];
    line.hidden = counts === null;
    if (counts === null) continue;
    ["better", "worse", "undecided", "untested"].forEach((name, place) => {
      line.querySelector(`[data-count="${name}"]`).textContent = counts[place];
    });
  }
  if (byId("pairs")) byId("pairs").hidden = view.pairs.every((counts) => counts === null);
  setText("pairs-how", known.texts[view.pairsHow]);
}

function apply(form) {
  const [test, scope, correction, alpha] = ["test", "scope", "correction", "alpha"].map((name) => form.elements[name].value);
  const obstacle = known.unavailable[`${test} ${scope}`];
  setText("status", obstacle ? `The test cannot be made: ${obstacle} The table still shows the choice before.` : "");
  if (obstacle) return;
  const view = known.views[`${test} ${scope} ${correction} ${alpha}`];
  showHighlights(view);
  showNotes(view.notes);
  showSeeds(known.texts[view.seeds]);
  showPairs(view);
  for (const name of ["verdict", "how", "design"]) setText(name, known.texts[view[name]]);
  const options = `--test ${test} --scope ${scope} --correction ${correction} --alpha ${alpha}`;
  for (const span of document.querySelectorAll(".knob-options")) span.textContent = options;
}

function startKnobs() {
  const form = byId("knobs");
  const decide = () => apply(form);
  form.hidden = false;
  form.addEventListener("input", decide);
  form.addEventListener("submit", (event) => event.preventDefault());
  // The controls have their first values back only after the event.
  form.addEventListener("reset", () => setTimeout(decide));
}

// Sorting: by a column, the other way round, and back to the order of the table.

function sortKey(line, place, kind) {
  const cell = line.cells[place];
  const text = cell.dataset.value ?? cell.textContent.trim();
  if (kind !== "number") return text;
  const value = Number(text);
  return text === "" || Number.isNaN(value) ? null : value;
}

function compareKeys(one, two) {
  return typeof one === "string" ? one.localeCompare(two, undefined, { numeric: true }) : one - two;
}

function sortTable(table, heading, state) {
  const body = table.tBodies[0];
  const lines = [...body.rows];
  const place = heading.cellIndex;
  const sign = state === "descending" ? -1 : 1;
  const keys = new Map(lines.map((line) => [line, sortKey(line, place, heading.dataset.sort)]));
  lines.sort((one, two) => {
    const [first, second] = [keys.get(one), keys.get(two)];
    const original = Number(one.dataset.place) - Number(two.dataset.place);
    if (state === "none") return original;
    // Rows without a number come last, whichever way round.
    if (first === null || second === null) return (first === null) - (second === null) || original;
    return sign * compareKeys(first, second) || original;
  });
  body.append(...lines);
  table.classList.toggle("sorted", state !== "none");
}

function startSorting(table) {
  [...table.tBodies[0].rows].forEach((line, place) => {
    line.dataset.place = place;
  });
  const headings = [...table.querySelectorAll("th[data-sort]")];
  for (const heading of headings) {
    const button = make("button", { type: "button" });
    button.append(...heading.childNodes);
    heading.append(button);
    heading.setAttribute("aria-sort", "none");
    const order = heading.dataset.sort === "number" ? ["descending", "ascending"] : ["ascending", "descending"];
    const cycle = ["none", ...order];
    button.addEventListener("click", () => {
      const state = cycle[(cycle.indexOf(heading.getAttribute("aria-sort")) + 1) % cycle.length];
      for (const other of headings) other.setAttribute("aria-sort", other === heading ? state : "none");
      sortTable(table, heading, state);
    });
  }
}

// Cells

function placeNear(panel, cell) {
  const gap = 8;
  const box = cell.getBoundingClientRect();
  const { offsetWidth: width, offsetHeight: height } = panel;
  const fits = box.bottom + gap + height <= window.innerHeight || box.top < height + gap;
  const top = fits ? box.bottom + gap : box.top - gap - height;
  const left = box.left + box.width / 2 - width / 2;
  panel.style.top = `${Math.max(gap, Math.min(top, window.innerHeight - height - gap))}px`;
  panel.style.left = `${Math.max(gap, Math.min(left, document.documentElement.clientWidth - width - gap))}px`;
}

function startCells() {
  const panel = byId("details");
  let shown = null;
  const hide = () => {
    if (shown) shown.classList.remove("chosen");
    shown = null;
    panel.hidden = true;
  };
  const show = (cell) => {
    if (cell === shown) return;
    hide();
    const details = byId(`cell-${cell.parentNode.dataset.row}-${cell.dataset.column}`);
    if (!details) return;
    panel.replaceChildren(details.content.cloneNode(true));
    shown = cell;
    cell.classList.add("chosen");
    panel.hidden = false;
    placeNear(panel, cell);
  };
  const cellOf = (event) => event.target.closest?.("td[data-column]");
  const body = scoreTable.tBodies[0];
  body.addEventListener("pointerover", (event) => {
    const cell = cellOf(event);
    if (event.pointerType !== "touch" && cell) show(cell);
  });
  body.addEventListener("pointerleave", (event) => {
    if (event.pointerType !== "touch" && !body.contains(document.activeElement)) hide();
  });
  body.addEventListener("click", (event) => {
    const cell = cellOf(event);
    if (cell) show(cell);
  });
  body.addEventListener("focusin", (event) => {
    const cell = cellOf(event);
    if (cell) show(cell);
  });
  body.addEventListener("focusout", (event) => {
    if (!body.contains(event.relatedTarget)) hide();
  });
  document.addEventListener("pointerdown", (event) => {
    if (!body.contains(event.target) && !panel.contains(event.target)) hide();
  });
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape") hide();
  });
  // Moving the focus may scroll the page: the panel stays with its cell for as long as that is in sight.
  const follow = () => {
    if (!shown) return;
    const { top, bottom } = shown.getBoundingClientRect();
    if (bottom < 0 || top > window.innerHeight) hide();
    else placeNear(panel, shown);
  };
  window.addEventListener("scroll", follow, { passive: true });
  window.addEventListener("resize", follow, { passive: true });
  byId("scores-scroll").addEventListener("scroll", follow, { passive: true });
  startArrows(body);
  document.querySelector(".hint").hidden = false;
}

// One cell of the table is a tab stop; arrow keys move it.
function startArrows(body) {
  const cells = (line) => [...line.querySelectorAll("td[data-column]")];
  for (const line of body.rows) for (const cell of cells(line)) cell.tabIndex = -1;
  const first = cells(body.rows[0])[0];
  first.tabIndex = 0;
  let stop = first;
  const moveTo = (cell) => {
    stop.tabIndex = -1;
    stop = cell;
    stop.tabIndex = 0;
  };
  body.addEventListener("focusin", (event) => {
    if (event.target.matches("td[data-column]")) moveTo(event.target);
  });
  body.addEventListener("keydown", (event) => {
    const move = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
    if (!move || !event.target.matches("td[data-column]")) return;
    const lines = [...body.rows];
    const line = lines[lines.indexOf(event.target.parentNode) + move[0]];
    const target = line && cells(line)[cells(event.target.parentNode).indexOf(event.target) + move[1]];
    event.preventDefault();
    if (target) target.focus();
  });
}

// A link to something folded away unfolds it, in browsers that do not do so themselves.
function startLinks() {
  document.addEventListener("click", (event) => {
    const link = event.target.closest?.('a[href^="#"]');
    if (!link) return;
    for (let node = byId(link.hash.slice(1)); node; node = node.parentElement) {
      if (node instanceof HTMLDetailsElement) node.open = true;
    }
  });
}

// Copying

function startCopying() {
  for (const command of document.querySelectorAll(".command")) {
    const button = make("button", { type: "button", class: "copy" }, "Copy");
    button.addEventListener("click", async () => {
      const code = command.querySelector("code");
      try {
        await navigator.clipboard.writeText(code.textContent);
        button.textContent = "Copied";
      } catch {
        // Where a page from disk may not write to the clipboard, the text is selected for the reader to copy.
        window.getSelection().selectAllChildren(code);
        button.textContent = "Selected";
      }
      setTimeout(() => {
        button.textContent = "Copy";
      }, 2000);
    });
    command.before(make("div", { class: "copying" }, button));
  }
}

startKnobs();
for (const table of document.querySelectorAll("table.sortable")) startSorting(table);
startCells();
startLinks();
startCopying();
