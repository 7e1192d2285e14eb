// Quick controls: blur, f-number and focus; and the image of a point of light.

import { frame } from "./api.js";
import { draw } from "./canvas.js";
import { valueOf } from "./panels.js";

let controls = {}, shape = "";

function row(place, label, attributes, input) {
  const root = document.createElement("div");
  root.className = "field";
  const line = document.createElement("div");
  line.className = "line";
  const text = document.createElement("label");
  const output = document.createElement("output");
  const slider = document.createElement("input");
  Object.assign(slider, { type: "range", ...attributes });
  text.htmlFor = slider.id;
  text.textContent = label;
  output.htmlFor = slider.id;
  slider.addEventListener("input", input);
  line.append(text, output);
  root.append(line, slider);
  place.append(root);
  return { slider, output };
}

/** Create the controls for the opened picture. */
export function makeQuick(place, state, change) {
  place.replaceChildren();
  controls = {};
  if (state.kind === "defocus") {
    place.textContent = "The map contains the blur of each pixel, so there is nothing to focus.";
    return;
  }
  if (state.kind === "metric") {
    const stops = { id: "f-number", min: 0, max: 9, step: 0.05 };
    controls.stop = row(place, "f-number", stops, (event) => {
      change({ camera: { f_number: Number((2 ** (event.target.value / 2)).toPrecision(3)) } }, event);
    });
    const range = { id: "focus", min: -2, max: 1.3, step: 0.005 };
    controls.distance = row(place, "Focus", range, (event) => {
      change({ focus: { distance: Number((1 / 10 ** Number(event.target.value)).toPrecision(4)) } }, event);
    });
  } else {
    const maximum = Math.max(60, Math.round(0.1 * state.width));
    controls.blur = row(place, "Blur", { id: "blur", min: 0, max: maximum, step: 0.5 }, (event) => {
      change({ camera: { blur: Number(event.target.value) } }, event);
    });
    controls.value = row(place, "Focus, far to near", { id: "focus", min: 0, max: 1, step: 0.005 }, (event) => {
      change({ focus: { value: Number(event.target.value) } }, event);
    });
  }
}

function set(control, value, text) {
  if (!control || value == null) return;
  if (document.activeElement !== control.slider) control.slider.value = value;
  control.output.textContent = text;
  control.slider.setAttribute("aria-valuetext", text);
}

/** Show the current values, and redraw the aperture image after a change. */
export function showQuick(state, facts) {
  const blur = valueOf(state.settings, "camera.blur", 0), stop = valueOf(state.settings, "camera.f_number");
  set(controls.blur, blur, `${Number(blur).toFixed(1)} pixels`);
  set(controls.value, facts.focus_disparity, facts.focus_disparity?.toFixed(3));
  if (stop) set(controls.stop, 2 * Math.log2(stop), `f/${stop}`);
  if (facts.focus_distance) set(controls.distance, -Math.log10(facts.focus_distance), `${facts.focus_distance.toPrecision(3)} m`);
  const now = JSON.stringify(state.settings?.aperture ?? {});
  if (now !== shape) {
    shape = now;
    frame("aperture").then((image) => draw(document.getElementById("aperture"), image), () => (shape = ""));
  }
}
