// The page around the renderer: files or, with ?photo=URL&disparity=URL&K=38&focus=0.46, addresses.

import { renderBokeh } from "./bokeh.js";

const form = document.querySelector("form");
const status = document.querySelector("#status");
const save = document.querySelector("#save");
const canvas = document.querySelector("canvas");
const given = new URLSearchParams(location.search);
const session = ort.InferenceSession.create(given.get("model") ?? "fast.onnx");

/** Pixels of an image file, scaled to `size` where that is given. */
async function pixels(blob, size) {
  const bitmap = await createImageBitmap(blob, { colorSpaceConversion: "none" });
  const { width, height } = size ?? bitmap;
  const context = new OffscreenCanvas(width, height).getContext("2d");
  context.drawImage(bitmap, 0, 0, width, height);
  return context.getImageData(0, 0, width, height);
}

async function render(photoBlob, disparityBlob) {
  try {
    status.textContent = "Rendering ...";
    const photo = await pixels(photoBlob);
    const disparity = await pixels(disparityBlob, photo);
    const [K, focus, gamma] = ["K", "focus", "gamma"].map((name) => Number(form.elements[name].value));
    const ready = await session;
    const start = performance.now();
    const picture = await renderBokeh(ready, photo, disparity, { K, focus, gamma });
    const seconds = ((performance.now() - start) / 1000).toFixed(1);
    [canvas.width, canvas.height] = [picture.width, picture.height];
    canvas.getContext("2d").putImageData(picture, 0, 0);
    save.href = canvas.toDataURL("image/png");
    save.hidden = false;
    status.textContent = `${picture.width}x${picture.height} in ${seconds} s`;
  } catch (error) {
    status.textContent = `Failed: ${error.message ?? error}`;
  }
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  const [photo, disparity] = ["photo", "disparity"].map((name) => form.elements[name].files[0]);
  if (photo && disparity) render(photo, disparity);
  else status.textContent = "Choose a photo and its disparity first.";
});

if (given.has("photo") && given.has("disparity")) {
  for (const name of ["K", "focus", "gamma"]) if (given.has(name)) form.elements[name].value = given.get(name);
  const fetched = ["photo", "disparity"].map(async (name) => (await fetch(given.get(name))).blob());
  render(...(await Promise.all(fetched)));
}
