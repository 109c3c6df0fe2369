// The table of all trains: a row is made once, then only its texts change.
import { copyOf, follow, setStatus } from "./live.js";

const FLEET = "#fleet";
const TEXTS = ["line", "position", "speed", "width", "age", "note"];
const body = document.getElementById("trains");
const summary = document.getElementById("summary");
const leftOut = document.getElementById("left-out");
const rows = new Map();

function rowOf(name) {
  let row = rows.get(name);
  if (row) return row;
  const node = copyOf("train-template");
  const link = node.querySelector("a");
  link.textContent = name;
  link.href = `/train/${encodeURIComponent(name)}`;
  row = { node, status: node.querySelector(".status"), texts: {} };
  for (const field of TEXTS) row.texts[field] = node.querySelector(`[data-field="${field}"]`);
  node.addEventListener("click", () => link.click());
  link.addEventListener("click", (event) => event.stopPropagation());
  rows.set(name, row);
  const after = [...rows.keys()].filter((each) => each > name).sort()[0];
  body.insertBefore(node, after ? rows.get(after).node : null);
  return row;
}

function show(frame) {
  for (const [name, fields] of Object.entries(frame.set)) {
    if (name === FLEET) {
      if (fields.summary !== undefined) summary.textContent = fields.summary;
      if (fields.left_out !== undefined) leftOut.textContent = fields.left_out;
      continue;
    }
    const row = rowOf(name);
    for (const field of TEXTS) if (fields[field] !== undefined) row.texts[field].textContent = fields[field];
    if (fields.level !== undefined || fields.word !== undefined) setStatus(row.status, fields.level, fields.word);
    if (fields.status !== undefined) row.node.dataset.status = fields.status;
  }
  for (const name of frame.gone) {
    rows.get(name)?.node.remove();
    rows.delete(name);
  }
}

// up and down move between trains, Enter opens one
body.addEventListener("keydown", (event) => {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!step) return;
  const links = [...body.querySelectorAll("a")];
  const next = links[links.indexOf(document.activeElement) + step];
  if (next) {
    next.focus();
    event.preventDefault();
  }
});

follow("", show);
