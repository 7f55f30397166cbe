// The page of `maglev explore`. It asks the local server for every curve and every sentence; no physics is here.

import { GoalBars } from "./goal.js";
import { buildInputs } from "./inputs.js";
import { SweepMap } from "./map.js";
import { Panels, savePicture } from "./panels.js";

const $ = (id) => document.getElementById(id);
const REST = 80; // ms after the last change until the experiment is simulated
const EMPTY = {};
const start = await (await fetch("start")).json();
const panels = new Panels($("panels"), start.panels);
const layers = { measured: EMPTY, pinned: EMPTY, identified: EMPTY, now: EMPTY };
let state = { gains: {}, effects: {}, axis: 0, units: localStorage.getItem("maglev-units") || "bench" };
let pinned = null;
let past = [];
let inputs;
let resting;
let map;
const goal = new GoalBars($("goal"), start.goal);
goal.units(state.units);

async function ask(name, setting) {
  const sent = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(setting) };
  const answer = await fetch(name, sent);
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

// Only the newest setting is asked for: while an answer is under way, the settings between are skipped.
function newestOnly(name, use) {
  let busy = false, wanted = null;
  return async (setting) => {
    wanted = setting;
    if (busy) return;
    busy = true;
    try {
      while (wanted) {
        const asked = wanted;
        wanted = null;
        const answer = await ask(name, asked);
        if (!wanted || name === "curves") use(answer, asked);
      }
      closed(false);
    } catch (error) {
      closed(error);
    } finally {
      busy = false;
    }
  };
}

function closed(error) {
  if (!error) return;
  say({ error: error instanceof TypeError ? "The server does not answer: start maglev explore again." : error.message });
}

function say(answer) {
  $("error").hidden = !answer.error;
  $("error").textContent = answer.error || "";
}

function show(element, words, first) {
  const text = JSON.stringify(words);
  if (element.dataset.words === text) return;
  element.dataset.words = text;
  element.replaceChildren(...(words || []).flatMap((word, i) => {
    const line = document.createElement(i === 0 && first ? "p" : "span");
    line.textContent = word.text;
    line.className = word.kind;
    return [line, " "];
  }));
}

const askCurves = newestOnly("curves", (answer) => {
  say(answer);
  document.body.classList.toggle("refused", Boolean(answer.error)); // what is shown belongs to the setting before
  if (answer.error) {
    clearTimeout(resting);
    show($("identified"), [{ text: "All else on this page is still that of the last setting that was accepted.", kind: "plain" }], false);
    return;
  }
  show($("answer"), answer.words, true);
  layers.now = answer.curves;
  goal.show("now", answer.goal);
  panels.draw(layers, state.units);
  document.body.dataset.drawn = Number(document.body.dataset.drawn || 0) + 1;
});
const askExperiment = newestOnly("experiment", (answer, asked) => {
  if (JSON.stringify(asked) !== JSON.stringify(state)) return; // it belongs to a setting that has gone
  layers.identified = answer.curves || EMPTY;
  const words = answer.error ? [{ text: `No experiment: ${answer.error}`, kind: "bad" }] : answer.words;
  show($("identified"), words, false);
  panels.draw(layers, state.units);
  document.body.dataset.identified = Number(document.body.dataset.identified || 0) + 1;
  if (!answer.error) askTest(asked);
});
const askTest = newestOnly("test", (answer, asked) => {
  if (JSON.stringify(asked) !== JSON.stringify(state)) return;
  document.body.dataset.tested = Number(document.body.dataset.tested || 0) + 1;
  if (answer.error) return say(answer);
  goal.show("identified", answer.goal);
  layers.identified = { ...layers.identified, ...answer.curves };
  panels.draw(layers, state.units);
});
const askPinned = newestOnly("curves", (answer) => {
  layers.pinned = pinned && !answer.error ? answer.curves : EMPTY;
  panels.draw(layers, state.units);
});

function changed() {
  if (layers.identified !== EMPTY) {
    layers.identified = EMPTY; // it belongs to the setting before
    goal.show("identified", []);
    show($("identified"), [{ text: "The experiment is under way; the first with a new kind of effect takes some seconds.", kind: "plain" }], false);
  }
  $("text").hidden = true; // it would say what was before
  map?.draw(state.gains);
  showDiagnosed();
  askCurves({ ...state });
  clearTimeout(resting);
  resting = setTimeout(() => askExperiment({ ...state }), REST);
}

// `settled`: the hand has let go, so that undo goes back to what was before.
function moved(settled) {
  const next = inputs.read();
  if (settled) remember();
  state = { ...state, ...next };
  changed();
}

let remembered = null;
function remember() {
  const now = JSON.stringify(inputs.read());
  if (remembered !== null && remembered !== now) past.push(remembered);
  if (past.length > 200) past.shift();
  remembered = now;
  $("undo").disabled = !past.length;
}

function put(setting) {
  inputs.write(setting);
  remembered = JSON.stringify(inputs.read());
  state = { ...state, ...inputs.read() };
  changed();
}

$("undo").onclick = () => {
  if (!past.length) return;
  const before = JSON.parse(past.pop());
  $("undo").disabled = !past.length;
  put(before);
};
$("reset").onclick = () => choose(inputs.first);
document.addEventListener("keydown", (event) => {
  const text = event.target.matches('input[type="number"], textarea');
  if (event.key === "z" && (event.ctrlKey || event.metaKey) && !event.shiftKey && !text) {
    event.preventDefault();
    $("undo").click();
  }
});
$("pin").onclick = () => { pinned = inputs.read(); $("unpin").disabled = false; legend(); askPinned({ ...state, ...pinned }); };
$("unpin").onclick = () => { pinned = null; layers.pinned = EMPTY; $("unpin").disabled = true; legend(); panels.draw(layers, state.units); };
// Gains and effects that a button, the map or a switch puts; Undo takes them back.
function choose(setting) {
  past.push(remembered);
  $("undo").disabled = false;
  put({ ...inputs.read(), ...setting });
}

// The effects that a diagnosis found, each with a switch; their sliders keep what was found.
const switches = new Map();
for (const [name, values] of Object.entries(start.diagnosed)) {
  const label = document.createElement("label");
  const tick = Object.assign(document.createElement("input"), { type: "checkbox", id: `found-${name}` });
  const specs = start.effects.find((one) => one.name === name)?.inputs || [];
  const sizes = Object.entries(values).map(([key, value]) => {
    const { title, unit } = specs.find((one) => one.name === key) || { title: key.replaceAll("_", " "), unit: "" };
    return `${title} ${Number(value.toPrecision(3))} ${unit}`.trim();
  });
  label.append(tick, ` ${name.replaceAll("_", " ")}`);
  label.append(Object.assign(document.createElement("span"), { className: "note", textContent: ` (${sizes.slice(0, 4).join(", ")})` }));
  label.title = "as found, in SI";
  $("diagnosed").append(label);
  switches.set(name, tick);
  tick.addEventListener("change", () => {
    const { [name]: _, ...others } = inputs.read().effects;
    choose({ effects: tick.checked ? { ...others, [name]: values } : others });
  });
}
$("diagnosed").hidden = !switches.size;
function showDiagnosed() {
  for (const [name, tick] of switches) tick.checked = name in state.effects;
}

$("units").value = state.units;
$("units").onchange = () => {
  const now = inputs.read();
  state.units = $("units").value;
  localStorage.setItem("maglev-units", state.units);
  inputs.units(start.units[state.units]);
  goal.units(state.units);
  put(now);
  others();
};
$("axis").onchange = () => {
  state = { ...state, axis: Number($("axis").value) };
  build();
  others();
};
$("recording").onchange = () => measured();
$("take").onclick = () => {
  const one = start.recordings.find((r) => r.name === $("recording").value);
  if (one && one.gains) choose({ gains: one.gains });
};

function others() {
  if (pinned) askPinned({ ...state, ...pinned });
  measured();
}

async function measured() {
  if (!start.recordings.length) return;
  const found = await ask("measured", state);
  const one = (found.recordings || []).find((r) => r.name === $("recording").value);
  const entry = start.recordings.find((r) => r.name === $("recording").value);
  $("take").disabled = !entry || !entry.gains;
  layers.measured = one ? one.curves : EMPTY;
  panels.draw(layers, state.units);
}

$("copy").onclick = async () => {
  const found = await ask("copies", state);
  if (found.error) return say(found);
  $("text").hidden = false;
  $("text").value = found[$("copied").value];
  $("text").select();
  try { await navigator.clipboard.writeText($("text").value); } catch { /* the text is there, selected */ }
};
$("copied").onchange = () => { if (!$("text").hidden) $("copy").click(); };
$("csv").onclick = async () => {
  const found = await ask("csv", state);
  if (found.error) return say(found);
  save(new Blob([found.csv], { type: "text/csv" }), `${start.rig}.csv`);
};
$("png").onclick = async () => {
  const words = [`${start.title}: ${$("answer").innerText}`, $("identified").innerText, inputs.words()];
  save(await savePicture(panels, words, layersShown()), `${start.rig}.png`);
};

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Layers and what they are called.
function layersShown() {
  const rows = [["now", "this setting, linear model"], ["identified", "its experiment, simulated with noise (95 %)"]];
  if (pinned) rows.push(["pinned", "pinned"]);
  if (start.recordings.length) rows.push(["measured", "recorded (95 %)"]);
  return rows;
}

function legend() {
  $("legend").replaceChildren(...layersShown().flatMap(([layer, words]) => {
    const key = document.createElement("span");
    key.className = "key";
    key.style.borderColor = `var(--${layer})`;
    return [key, words];
  }));
}

function build() {
  inputs = buildInputs($("inputs"), start, state.axis, moved);
  inputs.units(start.units[state.units]);
  const own = start.recordings.filter((r) => r.axis === state.axis);
  $("recording").replaceChildren(...own.map((r) => new Option(r.name, r.name)));
  past = [];
  $("undo").disabled = true;
  put(inputs.first);
}

document.title = `${start.title} – maglev explore`;
$("rig").textContent = start.title;
$("axes").hidden = !start.axes.length;
$("axis").replaceChildren(...start.axes.map((name, i) => new Option(name, i)));
$("recordings").hidden = !start.recordings.length;
if (start.map) map = new SweepMap($("panels"), start.map, (unit) => start.units[state.units][unit], (gains) => choose({ gains: { ...inputs.read().gains, ...gains } }));
build();
legend();
measured();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { panels.recolour(); map?.draw(state.gains); });
