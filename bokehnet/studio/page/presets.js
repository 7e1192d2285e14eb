// Looks as thumbnails of this picture, made while nothing else is to be done.

import { frame } from "./api.js";
import { draw } from "./canvas.js";

const canvases = new Map();
let turn = 0, timer = 0, drawn = new Set();

/** Make a button for each look. */
export function showPresets(place, presets, wear) {
  for (const { name, description } of [{ name: "", description: "No look" }, ...presets]) {
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
      for (const other of place.children) other.setAttribute("aria-selected", String(other === button));
      wear(name, event);
    });
    place.append(button);
    canvases.set(name, canvas);
  }
}

/** Nothing more of them for now: the picture itself is wanted. */
export function stopPresets() {
  turn += 1;
  clearTimeout(timer);
}

/** Draw all, one after the other, once the hand rests. */
export function refreshPresets() {
  stopPresets();
  const mine = turn;
  timer = setTimeout(async () => {
    drawn = new Set();
    for (const [name, canvas] of canvases) {
      if (mine !== turn) return;
      try {
        const found = await frame("thumbnail", { preset: name });
        canvas.width = found.header.width;
        canvas.height = found.header.height;
        draw(canvas, found);
        drawn.add(name);
      } catch {
        if (mine !== turn) return; // given up
        canvas.width = canvas.width; // a look that does not go with this picture stays empty
      }
    }
    document.body.dataset.presets = String(drawn.size);
  }, 700);
}
