// One train: texts by their fields, tables of sensors, hypotheses and events, and the drawings.
import { copyOf, follow, setStatus } from "./live.js";
import { Plan } from "./plan.js";
import { Schematic } from "./schematic.js";
import { Speeds } from "./speeds.js";

const root = document.getElementById("train");
const head = {};
const texts = new Map();
for (const node of root.querySelectorAll("[data-field]")) texts.set(node.dataset.field, node);
const status = document.getElementById("train-status");
const error = document.getElementById("error");
const lineNote = document.getElementById("line-note");
const planNote = document.getElementById("plan-note");
const units = document.getElementById("units");
const events = document.getElementById("events");
const hypotheses = document.getElementById("hypotheses");
const hypothesesTable = document.getElementById("hypotheses-table");
const noHypotheses = document.getElementById("no-hypotheses");
const noEvents = document.getElementById("no-events");
const whole = new Schematic(document.getElementById("whole"), true);
const near = new Schematic(document.getElementById("near"), false);
const plan = new Plan(document.getElementById("plan"));
const speeds = new Speeds(document.getElementById("speeds"));
const rows = new Map();

function showHead(fields) {
  Object.assign(head, fields);
  for (const [field, value] of Object.entries(fields)) {
    const node = texts.get(field);
    if (node) node.textContent = value;
  }
  if (fields.level !== undefined || fields.word !== undefined) setStatus(status, fields.level, fields.word);
  if (fields.error !== undefined) error.hidden = fields.error === "";
  if (fields.error_level !== undefined) error.dataset.level = fields.error_level;
  // for measurements: from the publication to the page
  if (fields.published_ms != null) root.dataset.publishedMs = fields.published_ms;
  if (fields.excluded !== undefined) texts.get("excluded").dataset.some = fields.excluded !== "none";
  if (fields.doubted !== undefined) texts.get("doubted").dataset.some = fields.doubted !== "none";
  const place = { at: head.at_m, from: head.from_m, to: head.to_m, truth: head.true_m, fresh: head.fresh === 1 };
  for (const drawing of [whole, near, plan]) drawing.place(place);
  if (fields.now_s != null) speeds.now(fields.now_s);
}

function showLine(line) {
  lineNote.textContent = line ? describe(line) : "The page does not know this line: start it with --line FILE.";
  planNote.textContent = line && line.track.length ? "" : "This line has no geometry that the page knows.";
  for (const node of document.querySelectorAll(".of-line")) node.hidden = !line;
  document.getElementById("plan").toggleAttribute("hidden", !(line && line.track.length));
  if (line) for (const drawing of [whole, near, plan]) drawing.line(line);
}

function describe(line) {
  const count = (number, what) => `${number === 0 ? "no" : number} ${what}${number === 1 ? "" : "s"}`;
  return `${(line.length_m / 1000).toFixed(1)} km, ${count(line.balise_count, "balise")}, ${count(line.tunnels.length, "tunnel")}, ${count(line.stations.length, "station")}`;
}

function unitRow(name) {
  const node = copyOf("unit-template");
  node.querySelector("[data-field=unit]").textContent = name;
  const after = [...rows.entries()].filter(([key]) => key.startsWith("unit/") && key > `unit/${name}`).sort()[0];
  units.insertBefore(node, after ? after[1] : null);
  return node;
}

function showUnit(node, fields) {
  for (const field of ["rate", "age", "detail"]) {
    if (fields[field] !== undefined) node.querySelector(`[data-field=${field}]`).textContent = fields[field];
  }
  if (fields.level !== undefined || fields.judgement !== undefined) {
    setStatus(node.querySelector(".status"), fields.level, fields.judgement);
  }
  if (fields.share !== undefined) {
    node.querySelector("[data-field=share]").textContent = fields.share === null ? "–" : fields.share.toFixed(2);
    const bar = node.querySelector(".bar");
    bar.style.setProperty("--share", fields.share ?? 0);
    bar.toggleAttribute("data-none", fields.share === null);
  }
}

// the server numbers them in the order in which they are shown
function hypothesisRow() {
  const node = copyOf("hypothesis-template");
  hypotheses.append(node);
  return node;
}

function showHypothesis(node, fields) {
  for (const field of ["if", "apart_m", "apart_kmh"]) {
    if (fields[field] !== undefined) node.querySelector(`[data-field=${field}]`).textContent = fields[field];
  }
  if (fields.level !== undefined || fields.word !== undefined) setStatus(node.querySelector(".status"), fields.level, fields.word);
}

function eventRow(fields) {
  const node = copyOf("event-template");
  const at = new Date(fields.at_ms);
  const time = node.querySelector("time");
  time.dateTime = at.toISOString();
  time.textContent = at.toLocaleTimeString("en-GB");
  setStatus(node.querySelector(".status"), fields.level, fields.severity);
  node.querySelector("[data-field=unit]").textContent = fields.unit;
  node.querySelector("[data-field=what]").textContent = fields.what;
  node.querySelector("[data-field=text]").textContent = fields.text;
  const action = node.querySelector(".action");
  action.hidden = !fields.action;
  action.querySelector("span").textContent = fields.action;
  // what was held up on its way comes later than it was said
  node.dataset.atMs = fields.at_ms;
  const older = [...events.children].find((each) => Number(each.dataset.atMs) <= fields.at_ms);
  events.insertBefore(node, older ?? null);
  return node;
}

function show(frame) {
  if ("line" in frame) showLine(frame.line);
  for (const [name, fields] of Object.entries(frame.set)) {
    if (name === "head") {
      showHead(fields);
    } else if (name.startsWith("unit/")) {
      if (!rows.has(name)) rows.set(name, unitRow(name.slice(5)));
      showUnit(rows.get(name), fields);
    } else if (name.startsWith("hypothesis/")) {
      if (!rows.has(name)) rows.set(name, hypothesisRow());
      showHypothesis(rows.get(name), fields);
    } else if (!rows.has(name)) {
      rows.set(name, eventRow(fields));
    }
  }
  for (const name of frame.gone) {
    rows.get(name)?.remove();
    rows.delete(name);
  }
  noHypotheses.hidden = hypotheses.childElementCount > 0;
  hypothesesTable.hidden = !noHypotheses.hidden;
  noEvents.hidden = events.childElementCount > 0;
  if (frame.points) speeds.add(frame.points, frame.again);
}

follow(root.dataset.train, show);
