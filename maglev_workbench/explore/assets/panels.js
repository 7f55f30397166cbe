// The diagrams: uPlot draws axes, grid and zoom; the curves of all layers are drawn here, because each has its own x.

const ORDER = ["measured", "identified", "pinned", "now"];
const DASH = { pinned: [6, 4] };
const HEIGHT = 270;
const colours = new Map(); // read once, because the browser would recompute styles at every reading

function css(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return colours.get(name);
}

function floats(text) {
  return new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
}

const decoded = new WeakMap(); // curve -> its arrays, so that a layer that stays is decoded once
function arrays(curve) {
  if (!decoded.has(curve)) decoded.set(curve, Object.fromEntries(Object.entries(curve).map(([key, text]) => [key, floats(text)])));
  return decoded.get(curve);
}

function extent(values, log, found) {
  for (const value of values) {
    if (!Number.isFinite(value) || (log && value <= 0)) continue;
    if (value < found[0]) found[0] = value;
    if (value > found[1]) found[1] = value;
  }
}

function padded([low, high], log) {
  if (!(low <= high)) return log ? [0.1, 10] : [0, 1];
  if (log) return [low / 1.15, high * 1.15];
  const room = (high - low || Math.abs(high) || 1) * 0.06;
  return [low - room, high + room];
}

// The text of a tick; a logarithmic axis has them at 1, 2 and 5 alone.
function tick(value, log) {
  if (value === null || value === undefined) return "";
  if (!value) return "0";
  const size = Math.abs(value), power = Math.floor(Math.log10(size) + 1e-9);
  if (log && ![1, 2, 5].includes(Math.round((size / 10 ** power) * 1e3) / 1e3)) return "";
  return power < -3 || power > 5 ? Number(value.toPrecision(4)).toExponential().replace("e+", "e") : String(Number(value.toPrecision(6)));
}

// Room for the longest tick beside a diagram, px.
function wide(u, ticks) {
  return Math.max(56, 22 + 7 * Math.max(0, ...(ticks || []).map((text) => text.length)));
}

class Diagram {
  constructor(parent, name) {
    this.name = name;
    this.element = document.createElement("figure");
    this.element.className = "panel";
    this.element.style.margin = 0;
    this.title = document.createElement("h2");
    this.readout = document.createElement("div");
    this.readout.className = "readout";
    this.body = document.createElement("div");
    this.element.append(this.title, this.body, this.readout);
    parent.append(this.element);
    this.layers = {};
    this.seen = true;
    new IntersectionObserver(([entry]) => {
      this.seen = entry.isIntersecting;
      if (this.seen && this.stale) this.draw(this.layers);
    }, { rootMargin: "100px" }).observe(this.element);
    new ResizeObserver(() => {
      if (!this.plot) return;
      this.plot.setSize(this.size());
      if (!this.zoomed) this.fit();
    }).observe(this.element);
  }

  size() {
    const width = Math.max(200, this.element.clientWidth);
    return { width, height: HEIGHT };
  }

  spec(spec) {
    if (this.drawn === spec) return;
    this.drawn = spec;
    this.zoomed = false;
    this.title.textContent = spec.title;
    if (this.plot) this.plot.destroy();
    const ink = () => css("--soft"), grid = { stroke: () => css("--grid"), width: 1 }, font = "12px system-ui, sans-serif";
    const axis = { stroke: ink, grid, ticks: grid, font, labelFont: font, labelSize: 18 };
    const values = (log) => (u, splits) => splits.map((value) => tick(value, log));
    const scale = (log) => ({ time: false, auto: false, distr: log ? 3 : 1, range: (u, low, high) => [low, high] });
    this.plot = new uPlot({
      ...this.size(),
      legend: { show: false },
      cursor: { drag: { x: true, y: true, uni: 20 }, points: { show: false }, bind: { dblclick: () => () => { this.zoomed = false; this.fit(); } } },
      scales: { x: scale(spec.xLog), y: scale(spec.yLog) },
      axes: [{ ...axis, label: spec.x, size: 34, values: values(spec.xLog) }, { ...axis, label: spec.y, size: wide, values: values(spec.yLog) }],
      series: [{}, { show: true, paths: () => null, points: { show: false } }],
      hooks: { draw: [() => this.paint()], setSelect: [(u) => { if (u.select.width || u.select.height) this.zoomed = true; }], setCursor: [() => this.read()] },
    }, [[1, 2], [null, null]], this.body);
    this.fit();
  }

  // The axes follow the curves, unless the user has zoomed; a double click ends that.
  fit() {
    const [x, y] = this.drawn.range ? this.square() : this.extents();
    this.plot.batch(() => {
      this.plot.setScale("x", { min: x[0], max: x[1] });
      this.plot.setScale("y", { min: y[0], max: y[1] });
    });
  }

  extents() {
    const { xLog, yLog, marks, fitFrom } = this.drawn, x = [Infinity, -Infinity], y = [Infinity, -Infinity];
    for (const layer of ORDER) {
      if (!this.layers[layer]) continue;
      const found = arrays(this.layers[layer]);
      // What is known badly, or lies below the range of interest, does not stretch the axis.
      const counts = (_, i) => found.x[i] >= fitFrom && !(found.high && found.high[i] - found.low[i] > Math.abs(found.y[i]));
      extent(found.x, xLog, x);
      extent(found.y.filter(counts), yLog, y);
    }
    extent(marks.map(([value]) => value), yLog, y);
    return [x[0] < x[1] ? x : padded(x, xLog), padded(y, yLog)];
  }

  // A fixed part of the plane, wider or narrower so that a circle is a circle.
  square() {
    const [[left, right], y] = this.drawn.range, { width, height } = this.plot.bbox;
    const half = ((y[1] - y[0]) / 2) * (height ? width / height : 1), middle = (left + right) / 2;
    return [[middle - half, middle + half], y];
  }

  // Diagrams out of sight are drawn when they come into it, so that those in sight are drawn sooner.
  draw(layers) {
    this.layers = layers;
    this.stale = !this.seen;
    if (this.stale) return;
    if (this.zoomed) this.plot.redraw(false);
    else this.fit();
  }

  paint() {
    const u = this.plot || arguments[0];
    if (!u) return;
    const { ctx, bbox } = u, dots = uPlot.pxRatio || devicePixelRatio;
    const px = (value) => u.valToPos(value, "x", true), py = (value) => u.valToPos(value, "y", true);
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    this.marks(ctx, bbox, px, py, dots);
    for (const layer of ORDER) {
      const curve = this.layers[layer];
      if (!curve) continue;
      ctx.strokeStyle = ctx.fillStyle = css(`--${layer}`);
      ctx.lineWidth = (layer === "now" ? 2 : 1.5) * dots;
      ctx.setLineDash((DASH[layer] || []).map((length) => length * dots));
      const found = arrays(curve);
      if (layer === "now" || layer === "pinned" || this.drawn.joined) this.line(ctx, found, px, py);
      else this.points(ctx, found, px, py, dots);
    }
    ctx.restore();
  }

  line(ctx, { x, y }, px, py) {
    ctx.beginPath();
    let down = false;
    for (let i = 0; i < x.length; i++) {
      if (!Number.isFinite(y[i]) || (this.drawn.yLog && y[i] <= 0)) { down = false; continue; }
      if (down) ctx.lineTo(px(x[i]), py(y[i]));
      else ctx.moveTo(px(x[i]), py(y[i]));
      down = true;
    }
    ctx.stroke();
  }

  points(ctx, { x, y, low, high, from, to }, px, py, dots) {
    const positive = (value) => (this.drawn.yLog && value <= 0 ? 1e-12 : value);
    for (let i = 0; i < x.length; i++) {
      if (!Number.isFinite(y[i]) || (this.drawn.yLog && y[i] <= 0)) continue;
      ctx.beginPath();
      ctx.arc(px(x[i]), py(y[i]), 2 * dots, 0, 7);
      ctx.fill();
      if (from) {
        ctx.beginPath();
        ctx.moveTo(px(from[i]), py(y[i]));
        ctx.lineTo(px(to[i]), py(y[i]));
        ctx.stroke();
      }
      if (!low || !Number.isFinite(low[i]) || !Number.isFinite(high[i])) continue;
      ctx.beginPath();
      ctx.moveTo(px(x[i]), py(positive(low[i])));
      ctx.lineTo(px(x[i]), py(high[i]));
      ctx.stroke();
    }
  }

  marks(ctx, bbox, px, py, dots) {
    ctx.strokeStyle = ctx.fillStyle = css("--soft");
    ctx.lineWidth = dots;
    ctx.setLineDash([4 * dots, 4 * dots]);
    ctx.font = `${11 * dots}px system-ui, sans-serif`;
    ctx.textAlign = "right";
    ctx.textBaseline = "middle";
    for (const [value, label] of this.drawn.marks) {
      ctx.beginPath();
      ctx.moveTo(bbox.left, py(value));
      ctx.lineTo(bbox.left + bbox.width, py(value));
      ctx.stroke();
      if (!label) continue;
      const wide = ctx.measureText(label).width, right = bbox.left + bbox.width - 6 * dots;
      ctx.fillStyle = css("--ground"); // the label interrupts its line, so that neither strikes the other out
      ctx.fillRect(right - wide - 3 * dots, py(value) - 5 * dots, wide + 6 * dots, 10 * dots);
      ctx.fillStyle = css("--soft");
      ctx.fillText(label, right, py(value) + dots / 2);
    }
    if (this.name !== "nyquist") return;
    const circle = (x, y, radius) => {
      ctx.beginPath();
      ctx.ellipse(px(x), py(y), Math.abs(px(radius) - px(0)), Math.abs(py(radius) - py(0)), 0, 0, 7);
      ctx.stroke();
    };
    circle(0, 0, 1);
    for (const limit of this.drawn.circles || []) circle(-1, 0, 1 / limit);
    ctx.setLineDash([]);
    ctx.beginPath();
    ctx.arc(px(-1), py(0), 3 * dots, 0, 7);
    ctx.fill();
  }

  // What the curve has nearest to the pointer.
  read() {
    const u = this.plot, now = this.layers.now || (this.drawn.joined && this.layers.identified);
    if (!u || !now || u.cursor.left < 0) { this.readout.textContent = ""; return; }
    const { x, y } = arrays(now);
    let best = -1, least = Infinity;
    for (let i = 0; i < x.length; i++) {
      const dx = u.valToPos(x[i], "x") - u.cursor.left, dy = u.valToPos(y[i], "y") - u.cursor.top;
      const far = this.name === "nyquist" ? dx * dx + dy * dy : dx * dx;
      if (far < least) { least = far; best = i; }
    }
    const text = (value) => Number(value.toPrecision(4));
    this.readout.textContent = best < 0 ? "" : `${this.drawn.x}: ${text(x[best])}   ${this.drawn.y}: ${text(y[best])}`;
  }
}

export class Panels {
  constructor(parent, specs) {
    this.specs = specs;
    this.diagrams = Object.keys(Object.values(specs)[0]).map((name) => new Diagram(parent, name));
  }

  draw(layers, units) {
    for (const diagram of this.diagrams) {
      const own = {};
      for (const layer of ORDER) if (layers[layer][diagram.name]) own[layer] = layers[layer][diagram.name];
      diagram.layers = own;
      diagram.spec(this.specs[units][diagram.name]);
      diagram.draw(own);
    }
  }

  recolour() {
    colours.clear();
    for (const diagram of this.diagrams) if (diagram.plot) diagram.plot.redraw();
  }
}

// All diagrams as one picture, two beside each other, below the words and the names of the layers.
export async function savePicture(panels, words, rows) {
  for (const diagram of panels.diagrams) Object.assign(diagram, { seen: true }).draw(diagram.layers);
  await new Promise(requestAnimationFrame);
  const sources = panels.diagrams.map((d) => d.plot.ctx.canvas), dots = devicePixelRatio, title = 24 * dots;
  const width = Math.max(...sources.map((c) => c.width)), height = Math.max(...sources.map((c) => c.height)) + title;
  const picture = document.createElement("canvas");
  picture.width = 2 * width;
  const ctx = picture.getContext("2d"), font = `${13 * dots}px system-ui, sans-serif`;
  ctx.font = font;
  const lines = words.filter(Boolean).flatMap((text) => wrapped(ctx, text.replaceAll("\n", " "), picture.width - 24 * dots));
  const head = (34 + 18 * lines.length) * dots;
  picture.height = head + Math.ceil(sources.length / 2) * height; // which forgets the font
  ctx.fillStyle = css("--ground");
  ctx.fillRect(0, 0, picture.width, picture.height);
  ctx.fillStyle = css("--ink");
  ctx.font = font;
  lines.forEach((line, i) => ctx.fillText(line, 12 * dots, (22 + 18 * i) * dots));
  let at = 12 * dots;
  for (const [layer, name] of rows) {
    ctx.fillStyle = css(`--${layer}`);
    ctx.fillRect(at, head - 20 * dots, 22 * dots, 3 * dots);
    ctx.fillStyle = css("--ink");
    ctx.fillText(name, at + 28 * dots, head - 14 * dots);
    at += 44 * dots + ctx.measureText(name).width;
  }
  sources.forEach((source, i) => {
    const x = (i % 2) * width, y = head + Math.floor(i / 2) * height;
    ctx.fillText(panels.diagrams[i].drawn.title, x + 12 * dots, y + 16 * dots);
    ctx.drawImage(source, x, y + title);
  });
  return new Promise((resolve) => picture.toBlob(resolve, "image/png"));
}

function wrapped(ctx, text, width) {
  const lines = [""];
  for (const word of text.split(" ")) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (ctx.measureText(longer).width > width && lines.at(-1)) lines.push(word);
    else lines[lines.length - 1] = longer;
  }
  return lines;
}
