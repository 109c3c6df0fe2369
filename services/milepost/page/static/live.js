// Asks for the next frame when the last one has been shown: a slow or hidden browser asks less, and nobody waits for it.
const EVERY_MS = 100;
const SILENT_MS = 2000;
const AGAIN_MS = 1000;
const UNKNOWN = "unknown";

export function follow(train, show) {
  const notice = document.getElementById("link");
  const path = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live?train=${encodeURIComponent(train)}`;
  let socket = null;
  let asked = 0;
  let heard = performance.now();

  function ask() {
    if (socket && socket.readyState === WebSocket.OPEN) {
      asked = performance.now();
      socket.send("more");
    }
  }

  function open() {
    const opened = new WebSocket(path);
    socket = opened;
    heard = performance.now();
    opened.onopen = ask;
    opened.onmessage = (message) => {
      if (socket !== opened) return;
      heard = performance.now();
      told(false);
      show(JSON.parse(message.data));
      // a hidden page is not drawn, and so does not ask
      setTimeout(() => requestAnimationFrame(ask), Math.max(0, EVERY_MS - (performance.now() - asked)));
    };
    opened.onclose = () => {
      if (socket !== opened) return;
      socket = null;
      told(true);
      setTimeout(open, AGAIN_MS);
    };
  }

  function told(lost) {
    if (lost && notice.hidden) {
      for (const node of document.querySelectorAll("[data-figure]")) node.textContent = UNKNOWN;
      // the severity of a past event stays true without the server
      for (const node of document.querySelectorAll(".status[data-level]:not([data-past])")) setStatus(node, "idle", UNKNOWN);
      document.body.dataset.link = "lost";
    }
    if (!lost && !notice.hidden) document.body.dataset.link = "there";
    notice.hidden = !lost;
  }

  setInterval(() => {
    if (document.visibilityState === "visible" && socket && performance.now() - heard > SILENT_MS) {
      const silent = socket;
      socket = null;
      silent.onclose = null;
      silent.close();
      told(true);
      setTimeout(open, AGAIN_MS);
    }
  }, 500);
  document.addEventListener("visibilitychange", () => {
    heard = performance.now();
  });
  open();
}

// a word, its colour and its shape: never the colour alone
export function setStatus(node, level, word) {
  if (level !== undefined) {
    node.dataset.level = level;
    node.querySelector("use").setAttribute("href", `#sign-${level}`);
  }
  if (word !== undefined) node.querySelector(".word").textContent = word;
}

export function statusNode() {
  return copyOf("status-template");
}

export function copyOf(template) {
  return document.getElementById(template).content.firstElementChild.cloneNode(true);
}

const SVG = "http://www.w3.org/2000/svg";

export function svg(name, attributes, parent, text) {
  const node = document.createElementNS(SVG, name);
  set(node, attributes);
  if (text !== undefined) node.textContent = text;
  if (parent) parent.appendChild(node);
  return node;
}

export function set(node, attributes) {
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
}

// steps of 1, 2 or 5 times a power of ten, about so many of them
export function niceStep(span, count) {
  const rough = span / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  for (const factor of [1, 2, 5]) if (rough <= factor * power) return factor * power;
  return 10 * power;
}

export function onWidth(node, changed) {
  new ResizeObserver(() => {
    if (node.clientWidth > 0) changed();
  }).observe(node);
}
