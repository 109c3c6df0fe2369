// Speed over the last five minutes with its bounds: one line and one band, whose paths change.
import { niceStep, onWidth, set, svg } from "./live.js";

const HEIGHT = 260;
const [LEFT, RIGHT, TOP, BOTTOM] = [44, 12, 12, 26];
const SPAN_S = 300;
const MOST = 700;
// where nothing came for longer, the line is broken
const GAP_S = 2;
const LEAST_KMH = 10;
const KMH = 3.6;

export class Speeds {
  constructor(node) {
    this.node = node;
    this.points = [];
    this.nowS = null;
    this.still = svg("g", {}, node);
    this.band = svg("path", { class: "band" }, node);
    this.curve = svg("path", { class: "curve" }, node);
    onWidth(node, () => this.draw(true));
  }

  add(points, again) {
    this.points = (again ? [] : this.points).concat(points).slice(-MOST);
    this.draw(false);
  }

  now(seconds) {
    this.nowS = seconds;
    this.draw(false);
  }

  draw(sizeChanged) {
    const width = this.node.clientWidth;
    if (!width || this.nowS === null) return;
    const from = this.nowS - SPAN_S;
    const seen = this.points.filter(([at]) => at >= from);
    const range = rangeOf(seen);
    const key = `${width} ${range}`;
    if (sizeChanged || key !== this.key) this.drawScale(width, range);
    this.key = key;
    const x = (at) => LEFT + ((at - from) / SPAN_S) * (width - LEFT - RIGHT);
    const y = (mps) => TOP + ((range[1] - mps * KMH) / (range[1] - range[0])) * (HEIGHT - TOP - BOTTOM);
    const pieces = piecesOf(seen);
    const line = (piece, i) => piece.map((p, n) => `${n ? "L" : "M"}${x(p[0]).toFixed(1)} ${y(p[i]).toFixed(1)}`).join("");
    set(this.curve, { d: pieces.map((piece) => line(piece, 1)).join("") });
    const bands = pieces.map((piece) => `${line(piece, 3)}${line([...piece].reverse(), 2).replace("M", "L")}z`);
    set(this.band, { d: bands.join("") });
  }

  drawScale(width, [low, high, step]) {
    set(this.node, { viewBox: `0 0 ${width} ${HEIGHT}`, height: HEIGHT });
    this.still.replaceChildren();
    const plotHeight = HEIGHT - TOP - BOTTOM;
    for (let kmh = low; kmh <= high + 1e-6; kmh += step) {
      const y = TOP + ((high - kmh) / (high - low)) * plotHeight;
      svg("line", { class: "grid", x1: LEFT, x2: width - RIGHT, y1: y, y2: y }, this.still);
      svg("text", { class: "label", x: LEFT - 8, y: y + 4, "text-anchor": "end" }, this.still, `${+kmh.toFixed(1)}`);
    }
    const every = width < 420 ? 2 : 1;
    for (let minutes = 0; minutes <= SPAN_S / 60; minutes += 1) {
      if (minutes % every && minutes !== SPAN_S / 60) continue;
      const x = width - RIGHT - (minutes / (SPAN_S / 60)) * (width - LEFT - RIGHT);
      const text = minutes === 0 ? "now" : `${minutes} min`;
      const anchor = minutes === 0 ? "end" : "middle";
      svg("text", { class: "label", x, y: HEIGHT - 6, "text-anchor": anchor }, this.still, text);
    }
  }
}

function piecesOf(points) {
  const pieces = [];
  let last = null;
  for (const point of points) {
    if (last === null || point[0] - last > GAP_S) pieces.push([]);
    pieces[pieces.length - 1].push(point);
    last = point[0];
  }
  return pieces;
}

// whole steps around all bounds, in km/h
function rangeOf(points) {
  let [low, high] = [Infinity, -Infinity];
  for (const [, , least, most] of points) {
    low = Math.min(low, least * KMH);
    high = Math.max(high, most * KMH);
  }
  if (low > high) return [0, LEAST_KMH, LEAST_KMH / 5];
  if (high - low < LEAST_KMH) {
    const middle = (low + high) / 2;
    [low, high] = [middle - LEAST_KMH / 2, middle + LEAST_KMH / 2];
  }
  const step = niceStep(high - low, 5);
  return [Math.floor(low / step) * step, Math.ceil(high / step) * step, step];
}
