// The requirements of the goal as bars: how much of each limit is used, by the linear model and by the experiment.

const END = 1.5; // times the limit, where a bar ends
const LAYERS = ["now", "identified"];

export class GoalBars {
  constructor(element, { text, requirements }) {
    this.head = document.createElement("summary");
    this.rows = new Map();
    const list = document.createElement("div");
    list.className = "bars";
    for (const { name, words } of requirements) {
      const row = Object.assign(document.createElement("div"), { className: "bar" });
      const label = document.createElement("span");
      const ground = Object.assign(document.createElement("div"), { className: "ground" });
      const value = Object.assign(document.createElement("span"), { className: "value" });
      const lines = Object.fromEntries(LAYERS.map((layer) => {
        const line = Object.assign(document.createElement("div"), { className: "used" });
        line.style.background = `var(--${layer})`;
        ground.append(line);
        return [layer, line];
      }));
      ground.append(Object.assign(document.createElement("div"), { className: "limit" }));
      row.append(label, ground, value);
      list.append(row);
      this.rows.set(name, { row, label, words, lines, value, found: {} });
    }
    element.title = text;
    element.open = innerWidth > 760;
    element.replaceChildren(this.head, list);
    this.units("bench");
  }

  units(system) {
    for (const { label, words } of this.rows.values()) label.textContent = words[system];
    this.words();
  }

  // `bars` of one layer; a quantity that it does not have is unknown there.
  show(layer, bars) {
    for (const [name, { lines, found }] of this.rows) {
      found[layer] = bars.find((bar) => bar.name === name);
      lines[layer].style.width = found[layer] ? `${(Math.min(found[layer].share, END) / END) * 100}%` : 0;
    }
    this.words();
  }

  words() {
    let met = 0, known = 0;
    for (const { row, value, found } of this.rows.values()) {
      const last = found.identified || found.now;
      row.dataset.met = last ? (last.met ? "met" : "missed") : "open";
      value.textContent = last ? `${last.met ? "met" : "missed"}: ${last.value}` : "by the experiment";
      known += last ? 1 : 0;
      met += last && last.met ? 1 : 0;
    }
    const open = this.rows.size - known;
    this.head.textContent = `Goal: ${met} of ${this.rows.size} requirements met${open ? `, ${open} not known yet` : ""}`;
  }
}
