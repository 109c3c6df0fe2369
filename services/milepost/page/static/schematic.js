// A line as a straight axis, whole or near the train: what stands still is drawn once, what moves changes attributes.
import { niceStep, onWidth, set, svg } from "./live.js";

const MARGIN = 14;
const NEAREST_M = 200;
const TUNNEL_TEXT_PX = 52;
const LETTER_PX = 6.5;
const NAMES_PX = 14;

export class Schematic {
  constructor(node, isWhole) {
    this.node = node;
    this.isWhole = isWhole;
    this.data = null;
    this.train = null;
    this.window = null;
    this.still = svg("g", {}, node);
    this.interval = svg("rect", { class: "interval", rx: 2 }, node);
    this.truth = svg("path", { class: "truth" }, node);
    this.marker = svg("path", { class: "marker" }, node);
    onWidth(node, () => this.draw());
  }

  line(data) {
    this.data = data;
    this.window = null;
    this.draw();
  }

  place(train) {
    const before = this.train;
    this.train = train;
    if (!this.data || train.at == null) return;
    this.heading = before && before.at != null && train.at !== before.at ? Math.sign(train.at - before.at) : (this.heading ?? 0);
    if (!this.fits()) this.draw();
    else this.move();
  }

  fits() {
    if (this.isWhole) return this.window !== null;
    const [from, to] = this.window ?? [0, 0];
    const edge = 0.08 * (to - from);
    const { at } = this.train;
    return this.window !== null && at >= from + edge && at <= to - edge && to - from === 2 * this.reach();
  }

  // half of what is shown around the train: several times its interval
  reach() {
    const wide = Math.max(NEAREST_M, 2 * (this.train.to - this.train.from));
    let reach = NEAREST_M;
    while (reach < wide) reach *= 2;
    return reach;
  }

  x(at) {
    const [from, to] = this.window;
    return MARGIN + ((at - from) / (to - from)) * (this.width - 2 * MARGIN);
  }

  draw() {
    this.width = this.node.clientWidth;
    if (!this.data || !this.width) return;
    if (this.isWhole) {
      this.window = [0, this.data.length_m];
    } else if (this.train && this.train.at != null) {
      const reach = this.reach();
      // most of it lies ahead
      const middle = this.train.at + 0.6 * (this.heading ?? 0) * reach;
      this.window = [middle - reach, middle + reach];
    } else {
      return;
    }
    // near the train there is room for names above its marker anyway
    const names = this.isWhole && this.data.stations.length ? NAMES_PX : 0;
    this.height = (this.isWhole ? 64 : 104) + names;
    this.axisY = (this.isWhole ? 28 : 54) + names;
    set(this.node, { viewBox: `0 0 ${this.width} ${this.height}`, height: this.height });
    this.still.replaceChildren();
    this.drawTunnels();
    const [from, to] = this.window;
    const ends = [Math.max(from, 0), Math.min(to, this.data.length_m)].map((each) => this.x(each));
    svg("line", { class: "rail", x1: ends[0], x2: ends[1], y1: this.axisY, y2: this.axisY }, this.still);
    this.drawBalises();
    this.drawStations();
    this.drawScale();
    this.move();
  }

  drawTunnels() {
    const [low, high] = this.window;
    for (const [from, to] of this.data.tunnels) {
      if (to < low || from > high) continue;
      const x = Math.max(this.x(from), 0);
      const end = Math.min(this.x(to), this.width);
      svg("rect", { class: "tunnel", x, y: this.axisY - 12, width: Math.max(end - x, 2), height: 24 }, this.still);
      const label = { class: "label", x: (x + end) / 2, y: this.axisY - 16, "text-anchor": "middle" };
      if (this.isWhole && end - x > TUNNEL_TEXT_PX) svg("text", label, this.still, "tunnel");
    }
  }

  drawBalises() {
    const [from, to] = this.window;
    const seen = this.data.balises.filter(([, at]) => at >= from && at <= to);
    const apart = (this.width - 2 * MARGIN) / Math.max(seen.length, 1);
    if (apart < 4) return;
    const size = this.isWhole ? 5 : 9;
    const d = seen.map(([, at]) => `M${(this.x(at) - size / 2).toFixed(1)} ${this.axisY - size / 2}h${size}v${size}h-${size}z`);
    svg("path", { class: "balise", d: d.join("") }, this.still);
    if (this.isWhole || apart < 60) return;
    for (const [name, at] of seen) {
      const x = Math.min(Math.max(this.x(at), 24), this.width - 24);
      svg("text", { class: "label", x, y: this.axisY + 22, "text-anchor": "middle" }, this.still, name);
    }
  }

  // a name is left out where it would run into the one before it; pointing at the mark tells it all the same
  drawStations() {
    const [from, to] = this.window;
    let free = 0;
    for (const [name, at] of this.data.stations) {
      if (at < from || at > to) continue;
      const x = this.x(at);
      const mark = svg("circle", { class: "station", cx: x.toFixed(1), cy: this.axisY, r: this.isWhole ? 4.5 : 6.5 }, this.still);
      svg("title", {}, mark, name);
      const half = (name.length * LETTER_PX) / 2;
      const middle = Math.min(Math.max(x, half), this.width - half);
      if (middle - half < free) continue;
      free = middle + half + LETTER_PX;
      const label = { class: "label name", x: middle.toFixed(1), y: 11, "text-anchor": "middle" };
      svg("text", label, this.still, name);
    }
  }

  drawScale() {
    const [from, to] = this.window;
    const step = niceStep(to - from, this.width / (this.isWhole ? 90 : 110));
    const y = this.height - 6;
    const inKm = this.isWhole;
    for (let at = Math.ceil(from / step) * step; at <= to; at += step) {
      if (at < -1e-6 || at > this.data.length_m + 1e-6) continue;
      const x = this.x(at);
      svg("line", { class: "tick", x1: x, x2: x, y1: y - 18, y2: y - 13 }, this.still);
      const anchor = x < 30 ? "start" : x > this.width - 40 ? "end" : "middle";
      const text = inKm ? `${+(at / 1000).toFixed(2)} km` : `${at.toFixed(0)} m`;
      svg("text", { class: "label", x: anchor === "start" ? 2 : anchor === "end" ? this.width - 2 : x, y, "text-anchor": anchor }, this.still, text);
    }
  }

  move() {
    const { at, from, to, truth, fresh } = this.train ?? {};
    const shown = at != null && this.window !== null;
    for (const node of [this.interval, this.marker]) node.toggleAttribute("hidden", !shown);
    this.truth.toggleAttribute("hidden", !shown || truth == null || this.isWhole);
    if (!shown) return;
    this.node.dataset.fresh = fresh;
    const half = this.isWhole ? 7 : 14;
    const x = this.x(at);
    const [left, right] = [this.x(from), this.x(to)].map((each) => Math.min(Math.max(each, 0), this.width));
    const width = Math.max(right - left, 3);
    set(this.interval, { x: Math.min(left, x - 1.5).toFixed(1), y: this.axisY - half, width: width.toFixed(1), height: 2 * half });
    const top = this.axisY - half - 2;
    set(this.marker, { d: `M${x.toFixed(1)} ${top}l-6 -10h12z M${x.toFixed(1)} ${top}v${2 * half + 4}` });
    if (truth != null) {
      const y = this.axisY;
      set(this.truth, { d: `M${this.x(truth).toFixed(1)} ${y - 5}l5 5l-5 5l-5 -5z` });
    }
  }
}
