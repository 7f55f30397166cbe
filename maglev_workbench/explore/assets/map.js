// The gain sets of a sweep as a map to choose from: a click takes the gains of the nearest set.

const VIRIDIS = ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"];
const HEIGHT = 270, EDGE = { left: 56, right: 8, top: 8, bottom: 40 };
const NAMES = { score: "score", peak_sensitivity: "peak |S|", stiffness: "stiffness", damping: "damping" };
const UNITS = { kp: "A/m", ki: "A/m", kd: "A s/m", score: "", peak_sensitivity: "", stiffness: "N/m", damping: "N s/m" };

function colour(share) {
  const at = Math.min(1, Math.max(0, share)) * (VIRIDIS.length - 1), low = Math.min(Math.floor(at), VIRIDIS.length - 2);
  const [a, b] = [VIRIDIS[low], VIRIDIS[low + 1]].map((hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16)));
  return `rgb(${a.map((value, i) => Math.round(value + (at - low) * (b[i] - value))).join()})`;
}

export class SweepMap {
  constructor(parent, data, factor, choose) {
    Object.assign(this, { data, factor, choose, now: null });
    this.element = Object.assign(document.createElement("figure"), { className: "panel", id: "map" });
    this.element.style.margin = 0;
    const head = document.createElement("h2");
    this.shown = Object.assign(document.createElement("select"), { id: "mapped" });
    this.shown.setAttribute("aria-label", "Quantity of the map");
    this.shown.append(...Object.keys(data.values).map((name) => new Option(NAMES[name], name)));
    this.shown.onchange = () => this.draw(this.now);
    this.scale = Object.assign(document.createElement("span"), { className: "scale" });
    head.append("Sweep: ", this.shown, this.scale);
    this.readout = Object.assign(document.createElement("div"), { className: "readout" });
    this.canvas = document.createElement("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "application");
    this.canvas.setAttribute("aria-label", "Map of the sweep; a click or the arrow keys take the gains of a set");
    const note = Object.assign(document.createElement("p"), { className: "note", textContent: data.note });
    this.element.append(head, ...(data.note ? [note] : []), this.readout, this.canvas);
    parent.prepend(this.element);
    this.canvas.addEventListener("click", (event) => this.take(this.nearest(event.offsetX, event.offsetY)));
    this.canvas.addEventListener("mousemove", (event) => this.say(this.nearest(event.offsetX, event.offsetY)));
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.draw(this.now)).observe(this.element);
  }

  size() {
    return { width: Math.max(200, this.element.clientWidth), height: HEIGHT };
  }

  share(name, value) {
    const { low, high } = this.ends[name];
    return this.data.log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  }

  place(gains) {
    const { width, height } = this.size();
    const x = EDGE.left + this.share(this.data.x, gains[this.data.x]) * (width - EDGE.left - EDGE.right);
    return [x, height - EDGE.bottom - this.share(this.data.y, gains[this.data.y]) * (height - EDGE.top - EDGE.bottom)];
  }

  gains(i) {
    return Object.fromEntries(Object.entries(this.data.gains).map(([name, values]) => [name, values[i]]));
  }

  // Of a third swept gain, the sets nearest to the present value are shown.
  slice() {
    const { x, y, gains } = this.data, third = ["kp", "kd", "ki"].find((name) => name !== x && name !== y);
    const all = gains[third].map((_, i) => i), levels = new Set(gains[third]);
    this.grid = new Set(gains[x]).size * new Set(gains[y]).size * levels.size === all.length;
    if (!this.grid || levels.size < 2) return all;
    const far = (value) => Math.abs(value - this.now[third]);
    const level = [...levels].reduce((a, b) => (far(b) < far(a) ? b : a));
    return all.filter((i) => gains[third][i] === level);
  }

  draw(gains) {
    if (!gains) return;
    this.now = gains;
    this.ends = Object.fromEntries([this.data.x, this.data.y].map((name) => {
      const levels = [...new Set(this.data.gains[name])].sort((a, b) => a - b), n = levels.length;
      // Half a step beyond the outermost sets.
      if (this.data.log) {
        const half = Math.sqrt(levels[n - 1] / levels[n - 2]);
        return [name, { low: levels[0] / half, high: levels[n - 1] * half, n }];
      }
      const half = (levels[n - 1] - levels[0]) / (n - 1) / 2;
      return [name, { low: levels[0] - half, high: levels[n - 1] + half, n }];
    }));
    const { width, height } = this.size(), dots = devicePixelRatio, canvas = this.canvas;
    Object.assign(canvas, { width: width * dots, height: height * dots });
    Object.assign(canvas.style, { width: `${width}px`, height: `${height}px`, display: "block" });
    const ctx = canvas.getContext("2d"), css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
    ctx.scale(dots, dots);
    this.members = this.slice();
    const values = this.data.values[this.shown.value];
    const known = this.members.map((i) => values[i]).filter((value) => value !== null).sort((a, b) => a - b);
    const low = known[0], high = known[Math.floor(0.98 * (known.length - 1))] || low;
    this.colours(low, high);
    const wide = (width - EDGE.left - EDGE.right) / this.ends[this.data.x].n, tall = (height - EDGE.top - EDGE.bottom) / this.ends[this.data.y].n;
    for (const i of this.members) {
      const [x, y] = this.place(this.gains(i));
      ctx.fillStyle = values[i] === null ? css("--grid") : colour((values[i] - low) / (high - low || 1));
      ctx.beginPath();
      if (this.grid) ctx.rect(x - wide / 2, y - tall / 2, wide + 0.5, tall + 0.5);
      else ctx.arc(x, y, 4, 0, 7);
      ctx.fill();
    }
    this.axes(ctx, width, height, css);
    const [left, top] = this.place(gains), inside = (value, end) => Math.min(end, Math.max(8, value));
    this.cross(ctx, Math.max(EDGE.left, inside(left, width - EDGE.right)), inside(top, height - EDGE.bottom));
    this.say(this.set);
  }

  // What the darkest and the lightest colour stand for.
  colours(low, high) {
    const bar = document.createElement("i"), quantity = this.shown.value;
    bar.style.background = `linear-gradient(to right, ${VIRIDIS.join()})`;
    const [factor, unit] = this.factor(UNITS[quantity]), text = (value) => Number((value * factor).toPrecision(3));
    this.scale.replaceChildren(...(low !== undefined ? [text(low), bar, `${text(high)} ${unit}`] : []));
  }

  axes(ctx, width, height, css) {
    ctx.fillStyle = css("--soft");
    ctx.font = "12px system-ui, sans-serif";
    const written = (name, value) => Number((value * this.factor(UNITS[name])[0]).toPrecision(3));
    const label = (name) => `${name}, ${this.factor(UNITS[name])[1]}`;
    const { x, y } = this.data;
    ctx.textAlign = "center"; ctx.fillText(label(x), (EDGE.left + width) / 2, height - 8);
    // At the levels of the sweep, as many as there is room for.
    for (const value of this.levels(x, 5)) ctx.fillText(written(x, value), this.place({ [x]: value, [y]: this.ends[y].low })[0], height - 24);
    ctx.textAlign = "right";
    for (const value of this.levels(y, 6)) ctx.fillText(written(y, value), EDGE.left - 4, this.place({ [x]: this.ends[x].low, [y]: value })[1] + 4);
    ctx.save(); ctx.translate(14, height / 2); ctx.rotate(-Math.PI / 2); ctx.textAlign = "center"; ctx.fillText(label(y), 0, 0); ctx.restore();
  }

  // Levels of a gain, spread over its axis.
  levels(name, most) {
    const all = [...new Set(this.data.gains[name])].sort((a, b) => a - b);
    const share = (value) => this.share(name, value), found = [];
    for (let i = 0; i < most; i++) {
      const wanted = (i + 0.5) / most;
      found.push(all.reduce((a, b) => (Math.abs(share(b) - wanted) < Math.abs(share(a) - wanted) ? b : a)));
    }
    return [...new Set(found)];
  }

  // Where the present gains lie, visible on every colour; at the edge where they lie beyond it.
  cross(ctx, x, y) {
    for (const [stroke, width] of [["#000", 5], ["#fff", 2]]) {
      Object.assign(ctx, { strokeStyle: stroke, lineWidth: width });
      ctx.beginPath();
      ctx.moveTo(x - 8, y); ctx.lineTo(x + 8, y); ctx.moveTo(x, y - 8); ctx.lineTo(x, y + 8);
      ctx.stroke();
    }
  }

  nearest(x, y, counts = () => true) {
    let best, least = Infinity;
    for (const i of this.members) {
      const at = this.place(this.gains(i)), far = (at[0] - x) ** 2 + (at[1] - y) ** 2;
      if (far < least && counts(at)) { least = far; best = i; }
    }
    return best;
  }

  key(event) {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!way) return;
    event.preventDefault();
    const [x, y] = this.place(this.now);
    const ahead = (at) => (at[0] - x) * way[0] + (at[1] - y) * way[1];
    const aside = (at) => Math.abs((at[0] - x) * way[1]) + Math.abs((at[1] - y) * way[0]);
    this.take(this.nearest(x, y, (at) => ahead(at) > 1 && aside(at) <= ahead(at)));
  }

  take(i) {
    if (i === undefined) return;
    this.set = i;
    this.choose(this.gains(i));
  }

  say(i) {
    if (i === undefined) { this.readout.textContent = "Click a set to take its gains."; return; }
    const part = (name, value) => `${NAMES[name] || name} ${Number((value * this.factor(UNITS[name])[0]).toPrecision(4))} ${this.factor(UNITS[name])[1]}`.trim();
    const gains = ["kp", "ki", "kd"].map((name) => part(name, this.data.gains[name][i]));
    const value = this.data.values[this.shown.value][i];
    this.readout.textContent = `${gains.join(", ")}: ${value === null ? "does not hold the rotor" : part(this.shown.value, value)}`;
  }
}
