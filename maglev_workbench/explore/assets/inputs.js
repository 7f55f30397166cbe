// Sliders with number fields for gains and effects. Values are SI; the unit system only changes what the fields show.

const POSITIONS = 1000; // of a slider

function digits(value) {
  return Number(value.toPrecision(4));
}

class Row {
  constructor(spec, moved) {
    this.spec = spec;
    this.value = spec.value;
    this.element = document.createElement("div");
    this.element.className = "input";
    this.label = document.createElement("label");
    this.slider = Object.assign(document.createElement("input"), { type: "range", min: 0, max: POSITIONS, step: 1 });
    this.field = Object.assign(document.createElement("input"), { type: "number", step: "any" });
    this.field.id = `field-${spec.id}`;
    this.slider.id = `slider-${spec.id}`;
    this.label.htmlFor = this.slider.id;
    this.element.append(this.label, this.slider, this.field);
    this.slider.addEventListener("input", () => {
      this.value = this.fromPosition(Number(this.slider.value));
      this.showField();
      moved(false);
    });
    this.slider.addEventListener("change", () => moved(true));
    this.field.addEventListener("change", () => {
      if (this.field.value === "" || !Number.isFinite(this.field.valueAsNumber)) return this.showField();
      this.value = Number((this.field.valueAsNumber / this.factor).toPrecision(12));
      this.showSlider();
      moved(true);
    });
    this.units([1, spec.unit]);
  }

  fromPosition(position) {
    const { low, high, log } = this.spec, share = position / POSITIONS;
    return digits(log ? low * (high / low) ** share : low + (high - low) * share);
  }

  toPosition(value) {
    const { low, high, log } = this.spec;
    if (log && value <= 0) return 0;
    const share = log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    return Math.round(POSITIONS * Math.min(1, Math.max(0, share)));
  }

  units([factor, unit]) {
    this.factor = factor;
    this.label.textContent = `${this.spec.title}${unit ? `, ${unit}` : ""}`;
    this.field.setAttribute("aria-label", `${this.spec.title}${unit ? ` in ${unit}` : ""}`);
    this.unit = unit;
    this.set(this.value);
  }

  set(value) {
    this.value = value;
    this.showSlider();
    this.showField();
  }

  showSlider() {
    this.slider.value = this.toPosition(this.value);
    this.slider.setAttribute("aria-valuetext", `${digits(this.value * this.factor)} ${this.unit}`);
  }

  showField() {
    const text = String(Number((this.value * this.factor).toPrecision(5))); // what fits; the value itself is kept
    this.field.value = text.length > 8 ? Number(Number(text).toPrecision(3)).toExponential() : text;
    this.slider.setAttribute("aria-valuetext", `${digits(this.value * this.factor)} ${this.unit}`);
  }
}

function group(title, open) {
  const element = document.createElement("details");
  const head = document.createElement("summary");
  head.textContent = title;
  element.append(head);
  element.open = open;
  return element;
}

// The form's rows; `read` gives gains and effects that are on, `write` puts them.
export function buildInputs(form, start, axis, moved) {
  form.onsubmit = (event) => event.preventDefault();
  form.replaceChildren();
  const rows = [];
  const make = (spec, id) => {
    const row = new Row({ ...spec, id }, moved);
    rows.push(row);
    return row;
  };
  const gains = group("Gains", true);
  const ofGains = start.gains[axis].map((spec) => make({ ...spec, title: spec.name === spec.title ? spec.title : `${spec.title} ${spec.name}` }, spec.name));
  gains.append(...ofGains.map((row) => row.element));
  if (!ofGains.length) gains.append("This controller has no gains to move.");
  form.append(gains);
  const effects = {};
  const blocks = [...new Set(start.effects.map((e) => e.block))];
  for (const block of blocks) {
    const own = start.effects.filter((e) => e.block === block);
    const box = group(`Effects: ${block}`, own.some((e) => e.on) || own.some((e) => e.name === "delay"));
    for (const one of own) {
      const element = document.createElement("div");
      element.className = "effect";
      element.title = one.source;
      const label = document.createElement("label");
      const tick = Object.assign(document.createElement("input"), { type: "checkbox", checked: one.on, id: `on-${one.name}` });
      label.append(tick, ` ${one.name.replaceAll("_", " ")}${one.linear ? "" : " (nonlinear: the experiment counts)"}`);
      const parts = one.inputs.map((spec) => make(spec, `${one.name}-${spec.name}`));
      const inside = document.createElement("div");
      inside.append(...parts.map((row) => row.element));
      inside.hidden = !one.on;
      tick.addEventListener("change", () => { inside.hidden = !tick.checked; moved(true); });
      element.append(label, inside);
      box.append(element);
      effects[one.name] = { tick, parts, inside };
    }
    form.append(box);
  }
  // What a diagnosis found and has no sliders, such as a free correction, is there as it was found or not at all.
  for (const [name, fixed] of Object.entries(start.diagnosed))
    if (!(name in effects)) effects[name] = { tick: { checked: true }, parts: [], inside: {}, fixed };
  const read = () => ({
    gains: Object.fromEntries(ofGains.map((row) => [row.spec.name, row.value])),
    effects: Object.fromEntries(Object.entries(effects).filter(([, e]) => e.tick.checked).map(([name, e]) => [
      name, e.fixed || Object.fromEntries(e.parts.map((row) => [row.spec.name, row.value])),
    ])),
  });
  const write = (setting) => {
    for (const row of ofGains) if (row.spec.name in setting.gains) row.set(setting.gains[row.spec.name]);
    for (const [name, e] of Object.entries(effects)) {
      e.tick.checked = name in setting.effects;
      e.inside.hidden = !e.tick.checked;
      for (const row of e.parts) if (e.tick.checked && row.spec.name in setting.effects[name]) row.set(setting.effects[name][row.spec.name]);
    }
  };
  // Gains and effects that are on, as the fields show them.
  const words = () => {
    const part = (row) => `${row.spec.name.replaceAll("_", " ")} ${row.field.value} ${row.unit}`.trim();
    const on = Object.entries(effects).filter(([, e]) => e.tick.checked);
    return [...ofGains.map(part), ...on.map(([name, e]) => `${name.replaceAll("_", " ")} (${e.parts.map(part).join(", ")})`)].join("; ");
  };
  const units = (table) => { for (const row of rows) row.units(table[row.spec.unit]); };
  return { read, write, units, words, first: read() };
}
