// Presets as thumbnails of the picture, rendered while the studio is idle; the server keeps them per picture.

import { frame } from "./api.js";
import { draw } from "./canvas.js";

const PAUSE = 700; // ms without changes before the thumbnails are rendered again

const canvases = new Map();
let turn = 0, timer = 0, drawn = new Set(), fresh = true;

/** Create a button for each preset. */
export function showPresets(place, presets, apply) {
  for (const { name, description } of [{ name: "", description: "No preset" }, ...presets]) {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", title: description });
    button.dataset.preset = name;
    button.setAttribute("role", "option");
    button.setAttribute("aria-selected", "false");
    const canvas = document.createElement("canvas"), label = document.createElement("span");
    canvas.setAttribute("aria-hidden", "true");
    label.textContent = name.replaceAll("-", " ") || "none";
    button.append(canvas, label);
    button.addEventListener("click", (event) => {
      selectPreset(name);
      apply(name, event);
    });
    place.append(button);
    canvases.set(name, canvas);
  }
}

/** Mark the button of the selected preset. */
export function selectPreset(name) {
  for (const [each, canvas] of canvases) canvas.parentElement.setAttribute("aria-selected", String(each === name));
}

/** Clear all thumbnails, which show another picture. */
export function clearPresets() {
  stopPresets();
  fresh = true;
  delete document.body.dataset.presets;
  for (const canvas of canvases.values()) canvas.width = canvas.width;
}

/** Stop rendering thumbnails in favour of the picture itself. */
export function stopPresets() {
  turn += 1;
  clearTimeout(timer);
}

/** Render all thumbnails, one after the other: at once for a new picture, else after a pause without changes. */
export function refreshPresets() {
  stopPresets();
  const current = turn;
  timer = setTimeout(async () => {
    drawn = new Set();
    for (const [name, canvas] of canvases) {
      if (current !== turn) return;
      try {
        const thumbnail = await frame("thumbnail", { preset: name });
        if (current !== turn) return;
        canvas.width = thumbnail.header.width;
        canvas.height = thumbnail.header.height;
        draw(canvas, thumbnail);
        drawn.add(name);
      } catch {
        if (current !== turn) return; // cancelled
        canvas.width = canvas.width; // a preset that does not apply to this picture stays empty
      }
    }
    fresh = false;
    document.body.dataset.presets = String(drawn.size);
  }, fresh ? 0 : PAUSE);
}
