// The track from above: drawn once to fit, the train and its interval on it moved by attributes.
import { niceStep, onWidth, set, svg } from "./live.js";

const HEIGHT = 260;
const MARGIN = 22;

export class Plan {
  constructor(node) {
    this.node = node;
    this.track = [];
    this.train = null;
    this.rail = svg("path", { class: "rail" }, node);
    this.interval = svg("path", { class: "stretch" }, node);
    this.dot = svg("circle", { class: "dot", r: 6 }, node);
    this.still = svg("g", {}, node);
    onWidth(node, () => this.draw());
  }

  line(data) {
    this.track = data.track;
    this.draw();
  }

  place(train) {
    this.train = train;
    this.move();
  }

  draw() {
    const width = this.node.clientWidth;
    if (!this.track.length || !width) return;
    set(this.node, { viewBox: `0 0 ${width} ${HEIGHT}`, height: HEIGHT });
    const east = this.track.map((point) => point[1]);
    const north = this.track.map((point) => point[2]);
    const [west, south] = [Math.min(...east), Math.min(...north)];
    const [wide, high] = [Math.max(...east) - west, Math.max(...north) - south];
    this.scale = Math.min((width - 2 * MARGIN) / Math.max(wide, 1), (HEIGHT - 2 * MARGIN) / Math.max(high, 1));
    const left = (width - wide * this.scale) / 2;
    const bottom = HEIGHT - (HEIGHT - high * this.scale) / 2;
    this.points = this.track.map(([at, e, n]) => [at, left + (e - west) * this.scale, bottom - (n - south) * this.scale]);
    set(this.rail, { d: pathOf(this.points.map(([, x, y]) => [x, y])) });
    this.still.replaceChildren();
    svg("path", { class: "tick", d: `M${width - 20} 34V12m-5 7l5 -8l5 8` }, this.still);
    svg("text", { class: "label", x: width - 20, y: 48, "text-anchor": "middle" }, this.still, "north");
    const metres = niceStep(width / this.scale, 6);
    const length = metres * this.scale;
    svg("path", { class: "tick", d: `M8 ${HEIGHT - 16}v6h${length.toFixed(1)}v-6` }, this.still);
    const text = metres >= 1000 ? `${metres / 1000} km` : `${metres} m`;
    svg("text", { class: "label", x: 14 + length, y: HEIGHT - 9 }, this.still, text);
    this.move();
  }

  at(position) {
    let low = 0;
    let high = this.points.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.points[middle][0] <= position) low = middle;
      else high = middle;
    }
    const [a, b] = [this.points[low], this.points[high]];
    const part = Math.min(Math.max((position - a[0]) / (b[0] - a[0] || 1), 0), 1);
    return [a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2])];
  }

  move() {
    const { at, from, to, fresh } = this.train ?? {};
    const shown = at != null && this.points;
    for (const node of [this.interval, this.dot]) node.toggleAttribute("hidden", !shown);
    if (!shown) return;
    this.node.dataset.fresh = fresh;
    const between = this.points.filter(([s]) => s > from && s < to).map(([, x, y]) => [x, y]);
    set(this.interval, { d: pathOf([this.at(from), ...between, this.at(to)]) });
    const [x, y] = this.at(at);
    set(this.dot, { cx: x.toFixed(1), cy: y.toFixed(1) });
  }
}

function pathOf(points) {
  return points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
}
