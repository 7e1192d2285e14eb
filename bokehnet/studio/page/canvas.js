// Drawing of pixels, the histogram, and markers on canvases.

import { space } from "./api.js";

const scratch = document.createElement("canvas");
const scratchContext = scratch.getContext("2d", { colorSpace: space, willReadFrequently: false });

export function contextOf(canvas) {
  return canvas.getContext("2d", { colorSpace: space });
}

/** Draw a frame over a whole canvas, scaled to its size. */
export function draw(canvas, { header, pixels }) {
  const { width, height } = header;
  const data = new ImageData(new Uint8ClampedArray(pixels.buffer), width, height, { colorSpace: space });
  const context = contextOf(canvas);
  if (canvas.width === width && canvas.height === height) {
    context.putImageData(data, 0, 0);
    return;
  }
  if (scratch.width !== width || scratch.height !== height) {
    scratch.width = width;
    scratch.height = height;
  }
  scratchContext.putImageData(data, 0, 0);
  context.imageSmoothingQuality = "high";
  context.clearRect(0, 0, canvas.width, canvas.height);
  context.drawImage(scratch, 0, 0, canvas.width, canvas.height);
}

/** Make a canvas transparent. */
export function clear(canvas) {
  contextOf(canvas).clearRect(0, 0, canvas.width, canvas.height);
}

/** Change the size of a canvas, and keep what it shows until it is drawn again. */
export function resize(canvas, width, height) {
  if (canvas.width === width && canvas.height === height) return;
  const old = document.createElement("canvas");
  old.width = canvas.width;
  old.height = canvas.height;
  contextOf(old).drawImage(canvas, 0, 0);
  canvas.width = width;
  canvas.height = height;
  contextOf(canvas).drawImage(old, 0, 0, width, height);
}

/** Draw the histogram of red, green and blue of a frame, from a subset of its pixels. */
export function histogram(canvas, pixels) {
  const counts = [0, 1, 2].map(() => new Uint32Array(64));
  const step = 4 * Math.max(1, Math.floor(pixels.length / 4 / 60000));
  for (let at = 0; at < pixels.length; at += step) {
    for (let channel = 0; channel < 3; channel++) counts[channel][pixels[at + channel] >> 2]++;
  }
  const context = canvas.getContext("2d"), { width, height } = canvas;
  const maximum = Math.max(...counts.flatMap((one) => [...one.subarray(1, 63)]), 1);
  context.clearRect(0, 0, width, height);
  context.globalCompositeOperation = "lighter";
  ["#b03a3a", "#3a9a4a", "#3a5ac0"].forEach((color, channel) => {
    context.fillStyle = color;
    counts[channel].forEach((count, bin) => {
      const tall = Math.min(1, Math.sqrt(count / maximum)) * height;
      context.fillRect((bin * width) / 64, height - tall, width / 64, tall);
    });
  });
  context.globalCompositeOperation = "source-over";
}

/** Draw the cursor and the focus as crosses in rings, the ring of a brush, and its path in the brush's tint. */
export function mark(canvas, { focus, cursor, path, radius, brush, tint, zoom = 1 }) {
  const context = canvas.getContext("2d"), { width, height } = canvas;
  const unit = width / canvas.clientWidth / zoom || 1;
  context.clearRect(0, 0, width, height);
  for (const [point, color] of [[focus, "#f5b04c"], [cursor, "#ffffff"]]) {
    if (!point) continue;
    const x = point[0] * width, y = point[1] * height;
    for (const [line, shade] of [[4, "#000000a0"], [2, color]]) {
      context.lineWidth = line * unit;
      context.strokeStyle = shade;
      context.beginPath();
      context.arc(x, y, 11 * unit, 0, 7);
      context.moveTo(x - 5 * unit, y);
      context.lineTo(x + 5 * unit, y);
      context.moveTo(x, y - 5 * unit);
      context.lineTo(x, y + 5 * unit);
      context.stroke();
    }
  }
  if (path?.length) {
    context.strokeStyle = tint;
    context.lineWidth = 2 * radius * width;
    context.lineCap = context.lineJoin = "round";
    context.beginPath();
    context.moveTo(path[0][0] * width, path[0][1] * height);
    for (const [x, y] of [...path, [path[0][0] + (path.length < 2 ? 1e-4 : NaN), path[0][1]]]) {
      if (!Number.isNaN(x)) context.lineTo(x * width, y * height);
    }
    context.stroke();
  }
  if (brush) {
    for (const [line, shade] of [[3, "#000000a0"], [1.5, "#ffffff"]]) {
      context.lineWidth = line * unit;
      context.strokeStyle = shade;
      context.beginPath();
      context.arc(brush[0] * width, brush[1] * height, radius * width, 0, 7);
      context.stroke();
    }
  }
}

/** Call a function after the next paint, so that the paint does not wait for it. */
export function painted(then) {
  requestAnimationFrame(() => {
    const channel = new MessageChannel();
    channel.port1.onmessage = then;
    channel.port2.postMessage(0);
  });
}
