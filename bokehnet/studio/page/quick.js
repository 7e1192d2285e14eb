// Quick controls: aperture, blur, focus, range in focus and light of lamps; and the image of a point of light.

import { frame } from "./api.js";
import { draw } from "./canvas.js";
import { focusChange, focusEnds, initialFocus } from "./focus.js";
import { valueOf } from "./panels.js";

let controls = {}, shape = "", latest = { state: null, facts: {} };

const RESET = "Double-click resets.";

function slider(attributes, input) {
  const element = document.createElement("input");
  Object.assign(element, { type: "range", ...attributes });
  element.addEventListener("input", input);
  return element;
}

/** Add a labelled row; a double click on its label calls `reset`. */
function row(place, label, help, sliders, reset) {
  const root = document.createElement("div"), line = document.createElement("div");
  const text = document.createElement("label"), output = document.createElement("output");
  root.className = "field";
  line.className = "line";
  Object.assign(text, { htmlFor: sliders[0].id, textContent: label, title: `${help} ${RESET}` });
  text.addEventListener("dblclick", reset);
  output.htmlFor = sliders[0].id;
  line.append(text, output);
  const track = document.createElement("div");
  track.className = sliders.length > 1 ? "dual" : "single";
  track.append(...sliders);
  root.append(line, track);
  place.append(root);
  return { root, sliders, output };
}

/** Create the controls for the opened picture. */
export function makeQuick(place, state, change, showLight) {
  place.replaceChildren();
  controls = {};
  latest = { state, facts: {} };
  if (state.kind !== "defocus") makeLens(place, state, change);
  else place.append("The map contains the blur of each pixel, so there is nothing to focus.");
  if (!state.photograph) return;
  const light = slider({ id: "light", min: 0, max: 4, step: 0.05 }, (event) =>
    change({ highlights: { threshold: null, gain: null, strength: Number(event.target.value) } }, event));
  controls.light = row(place, "Light of lamps", "Clipped lights are brighter than the photo stores: how much.", [light], (event) =>
    change({ highlights: { threshold: null, gain: null, strength: null } }, event));
  const button = document.createElement("button");
  Object.assign(button, { type: "button", id: "show-light", textContent: "Show lights found", title: "H" });
  button.addEventListener("click", showLight);
  const note = document.createElement("p");
  note.className = "help";
  note.id = "light-note";
  controls.light.root.append(note, button);
}

function makeLens(place, state, change) {
  const relative = state.kind !== "metric";
  const initial = () => ({ camera: { blur: null, strength: null, f_number: null, ...latest.state.initial?.camera } });
  const stops = slider({ id: "f-number", min: -2, max: 10, step: 0.05 }, (event) => {
    const f_number = Number((2 ** (event.target.value / 2)).toPrecision(3));
    change({ camera: relative ? { f_number, blur: null, strength: null } : { f_number } }, event);
  });
  const equivalent = relative ? " As on a full-frame camera with the nearest point at 1 m." : "";
  controls.stop = row(place, "Aperture", `A smaller f-number blurs more.${equivalent}`, [stops], (event) => change(initial(), event));
  if (relative) {
    const maximum = Math.max(60, Math.round(0.16 * Math.max(state.width, state.height))); // twice the default at least
    const blur = slider({ id: "blur", min: 0, max: maximum, step: 0.5 }, (event) =>
      change({ camera: { blur: Number(event.target.value), f_number: null, strength: null } }, event));
    controls.blur = row(place, "Blur", "Radius of a point of light at the nearest point, with the farthest in focus.", [blur], (event) =>
      change(initial(), event));
  }
  const scale = relative ? { min: 0, max: 1, step: 0.005 } : { min: -2, max: 1.3, step: 0.005 };
  const focus = slider({ id: "focus", ...scale }, (event) => {
    const middle = fromSlider(Number(event.target.value)), [far, near] = focusEnds(latest.state, latest.facts) ?? [middle, middle];
    change(shifted(latest.state, far, near, middle), event);
  });
  const reset = (event) => change(initialFocus(latest.state), event);
  controls.focus = row(place, "Focus, far to near", "Where the picture is sharp.", [focus], reset);
  const end = (index, id, name) => {
    const element = slider({ id, ...scale }, (event) => {
      const ends = focusEnds(latest.state, latest.facts) ?? [0, 0];
      ends[index] = fromSlider(Number(event.target.value));
      change(focusChange(latest.state, index ? Math.min(...ends) : ends[0], index ? ends[1] : Math.max(...ends)), event);
    });
    element.setAttribute("aria-label", name);
    return element;
  };
  controls.range = row(
    place, "Sharp from, to", "Both ends of what stays sharp; drag them apart for a deeper subject.",
    [end(0, "focus-far", "Farthest sharp point"), end(1, "focus-near", "Nearest sharp point")], reset,
  );
}

/** Return changes that move the range in focus, with its depth, to another middle. */
export function shifted(state, far, near, middle) {
  if (state.kind === "metric") {
    const factor = middle / Math.max((far + near) / 2, 1e-9);
    return focusChange(state, far * factor, near * factor);
  }
  const half = (near - far) / 2, inside = Math.min(Math.max(middle, half), 1 - half);
  return half ? focusChange(state, inside - half, inside + half) : focusChange(state, middle, middle);
}

const isMetric = () => latest.state.kind === "metric";
const fromSlider = (value) => (isMetric() ? 10 ** value / 1000 : value);
const toSlider = (disparity) => (isMetric() ? Math.log10(Math.max(1000 * disparity, 1e-3)) : disparity);
const words = (disparity) => (isMetric() ? `${(1 / (1000 * disparity)).toPrecision(3)} m` : disparity.toFixed(3));

/** Return where the picture is sharp, in words. */
export function sharpWords() {
  const ends = focusEnds(latest.state, latest.facts);
  if (!ends) return "where the map says";
  return ends[0] === ends[1] ? `at ${words(ends[1])}` : `from ${ends.map(words).join(" to ")}`;
}

function set(control, values, text) {
  if (!control) return;
  control.sliders.forEach((element, index) => {
    if (document.activeElement !== element || !held) element.value = values[index];
    element.setAttribute("aria-valuetext", text);
  });
  control.output.textContent = text;
}

// A slider that is dragged is ahead of the previews that arrive.
let held = false;
addEventListener("pointerdown", (event) => (held = event.target.type === "range"), true);
for (const end of ["pointerup", "pointercancel", "blur"]) addEventListener(end, () => (held = false), true);

/** Show the current values, and redraw the aperture image after a change. */
export function showQuick(state, facts) {
  latest = { state, facts };
  const metric = state.kind === "metric", { blur, f_number } = facts.equivalents ?? {};
  const stop = metric ? valueOf(state.settings, "camera.f_number") : f_number;
  if (stop) set(controls.stop, [2 * Math.log2(stop)], `f/${Number(stop.toPrecision(2))}`);
  if (blur != null) set(controls.blur, [blur], `${blur.toFixed(1)} pixels`);
  const ends = focusEnds(state, facts);
  if (ends) {
    const middle = metric && ends[0] === ends[1] ? ends[1] : (ends[0] + ends[1]) / 2;
    set(controls.focus, [toSlider(middle)], words(middle));
    set(controls.range, ends.map(toSlider), ends[0] === ends[1] ? "one plane" : ends.map(words).join(" to "));
  }
  const strength = valueOf(state.settings, "highlights.strength", 1);
  set(controls.light, [strength], valueOf(state.settings, "highlights.threshold", "auto") === "auto" ? `${Number(strength).toFixed(2)}×` : "off");
  const now = JSON.stringify(state.settings?.aperture ?? {});
  if (now !== shape) {
    shape = now;
    frame("aperture").then((image) => draw(document.getElementById("aperture"), image), () => (shape = ""));
  }
}

/** Show what the estimate of light has found. */
export function showLightNote(job) {
  const note = document.getElementById("light-note");
  if (!note) return;
  const none = "No clipped lights found.";
  note.textContent = { running: "Looking for lights …", done: job.note || none, failed: job.error }[job.state] ?? "";
  document.getElementById("show-light").disabled = job.state !== "done" || !job.note;
}
