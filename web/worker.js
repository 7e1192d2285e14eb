// All that takes long, away from the page: files to pixels, tiles through the network, the picture to be saved.

import { renderBokeh, repairDisparity } from "./bokeh.js";

const RUNTIME = "./node_modules/onnxruntime-web/dist";

// Largest side of a tile without what it sees around itself, the least to which it goes where memory is short,
// and steps in which both grow: the network halves the picture a few times, and each tile must be halved where
// the whole would be.
const TILE = 1024;
const LEAST = 128;
const STEP = 64;

// Pixels that the network looks around itself, beyond the blur.
const AROUND = 43;

// The same of the rays, with the blur's multiple that they reach with what is behind an edge; their larger memory
// allows smaller tiles only.
const RAYS = { around: 64, radii: 2, tile: 512 };

// File of the depth repair, which a host may leave out, and the most pixels of a map that it repairs: windows of
// the repair are a few pixels wide, and edges of larger maps are softer than these.
const REPAIR = "./repair.onnx";
const REPAIRED = 3e6;

// Largest side of the picture that the page shows; the saved one has all pixels.
const SHOWN = 1600;

// Codes of 255 by which a picture by WebGPU may differ from that by WebAssembly.
const FAITHFUL = 2;

let session;
let repair;
let photo;
let given; // the map that was opened
let disparity; // the map in use
let sharpens = false;
let shown;
let latest = 0;
let tile = TILE;
let rays = false;
let turn = Promise.resolve();

/** Pixels of an image file, scaled to `size` where that is given. */
async function pixels(blob, size) {
  const bitmap = await createImageBitmap(blob, { colorSpaceConversion: "none" });
  const { width, height } = size ?? bitmap;
  const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0, width, height);
  bitmap.close();
  return context.getImageData(0, 0, width, height);
}

/** A part of an ImageData. */
function part({ data, width }, left, top, right, bottom) {
  const cut = new ImageData(right - left, bottom - top);
  for (let y = top; y < bottom; y++) {
    cut.data.set(data.subarray(4 * (y * width + left), 4 * (y * width + right)), 4 * (y - top) * cut.width);
  }
  return cut;
}

/** The code of disparity that is blurred most, and its radius in pixels. */
function mostBlurred({ K, focus }) {
  let code = 0;
  let away = -1;
  const seen = new Set();
  for (let i = 0; i < disparity.data.length && seen.size < 256; i += 4) seen.add(disparity.data[i]);
  for (const one of seen) {
    if (Math.abs(one / 255 - focus) > away) [code, away] = [one, Math.abs(one / 255 - focus)];
  }
  return { code, radius: K * away };
}

/** Side of the tiles of a picture of that length: all about alike. */
const side = (length) => STEP * Math.ceil(length / Math.ceil(length / tile) / STEP);

/** Give the page's canvas its size. */
function fit({ width, height }) {
  const scale = Math.min(1, SHOWN / Math.max(width, height));
  [shown.width, shown.height] = [Math.round(width * scale), Math.round(height * scale)];
}

/** Draw a part of the picture on the page. */
function show(whole, x, y, width, height) {
  const [across, down] = [shown.width / whole.width, shown.height / whole.height];
  const to = [x * across, y * down, width * across, height * down];
  shown.getContext("2d").drawImage(whole, x, y, width, height, ...to);
}

/** Whether there is a graphics card by WebGPU; one that software imitates counts only where it is asked for. */
async function hasCard(provider) {
  if (provider === "wasm") return false;
  const adapter = await navigator.gpu?.requestAdapter().catch(() => null);
  return Boolean(adapter) && (provider === "webgpu" || !adapter.info?.isFallbackAdapter);
}

/** Codes of a small picture by a network, and the milliseconds that it took. */
async function tried(network) {
  const [width, height] = [45, 31]; // odd, as halves of pictures mostly are: there the ways differ
  const [colors, near] = [new ImageData(width, height), new ImageData(width, height)];
  for (let i = 0; i < colors.data.length; i++) {
    colors.data[i] = (i * 7919) % 251;
    near.data[i] = (i / 4) % width < 20 ? 60 : 200;
  }
  const numbers = { K: 6, focus: 0.24 };
  const begun = performance.now();
  const { data } = await renderBokeh(network, colors, near, numbers);
  return { data, took: performance.now() - begun };
}

/** Why a network by WebGPU is not taken, by a trial against the one by WebAssembly; "" where it is. */
async function against(quick, sure, anySpeed) {
  const there = (await tried(quick)).data, here = (await tried(sure)).data;
  if (there.some((code, i) => Math.abs(code - here[i]) > FAITHFUL)) return "By WebGPU the picture would be another";
  const slower = async () => (await tried(quick)).took > (await tried(sure)).took; // the first time says nothing
  return !anySpeed && (await slower()) ? "WebGPU would be slower" : "";
}

/**
 * Load the network. WebGPU does the work where a card is there, gives the picture that WebAssembly gives, and is
 * quicker in a trial (however quick, where the page asks for it); else WebAssembly does.
 */
async function load(model, provider) {
  if (!globalThis.WebAssembly) throw new Error("this browser has no WebAssembly, by which the network runs");
  const card = await hasCard(provider);
  globalThis.ort = await import(`${RUNTIME}/ort.${card ? "all" : "wasm"}.min.mjs`);
  const create = (name) => ort.InferenceSession.create(model, { executionProviders: [name], logSeverityLevel: 3 });
  const sure = await create("wasm");
  let why = provider === "wasm" ? "" : "This browser has no graphics card by WebGPU";
  if (card) {
    try {
      const quick = await create("webgpu");
      why = await against(quick, sure, provider === "webgpu");
      if (!why) {
        postMessage({ provider: "webgpu", why });
        return quick;
      }
    } catch (error) {
      why = `WebGPU cannot do it (${error.message ?? error})`;
    }
  }
  postMessage({ provider: "wasm", why });
  return sure;
}

/** Session of the depth repair; null where the host has no such file. */
async function loadRepair() {
  const answer = await fetch(REPAIR).catch(() => null);
  if (!answer?.ok) return null;
  return ort.InferenceSession.create(await answer.arrayBuffer(), { executionProviders: ["wasm"], logSeverityLevel: 3 });
}

/** Choose the map to render with: the one that was opened or, if the page asks for it, the sharpened one. */
async function chooseMap() {
  disparity = given;
  if (!sharpens || photo.width * photo.height > REPAIRED) return;
  try {
    await session; // it loads the runtime
    const network = await (repair ??= loadRepair());
    if (network) disparity = await repairDisparity(network, photo, given);
  } catch (error) {
    postMessage({ notice: `The depth map is used as it is: sharpening failed (${error.message ?? error}).` });
  }
}

/** Whether an error says that there is too little memory: of the browser, of WebAssembly, or of the runtime. */
const isMemory = (error) =>
  error instanceof RangeError || /memory|alloc|too large|^\d+$/i.test(String(error?.message ?? error));

/** Render, in smaller tiles where there is too little memory for large ones. */
async function renderWithin(id, numbers) {
  for (;;) {
    try {
      return await render(id, numbers);
    } catch (error) {
      if (!isMemory(error)) throw error;
      if (tile <= LEAST) throw new Error("too little memory in this browser; try less blur or a smaller photo");
      tile /= 2;
      postMessage({ notice: `Too little memory for large tiles: they are ${tile} pixels wide now, which takes longer.` });
    }
  }
}

/** Pixels of what a control gave; an error tells which. */
async function decoded(of, blob, size) {
  try {
    return await pixels(blob, size);
  } catch (error) {
    const why = isMemory(error) ? "too large for this browser's memory" : "no picture that this browser can read";
    throw Object.assign(new Error(`the ${of}: ${why}`), { of });
  }
}

// Convention of networks for relative disparity: colours by the mean and deviation of ImageNet, shorter side, step of
// the sides.
const MEAN = [0.485, 0.456, 0.406];
const DEVIATION = [0.229, 0.224, 0.225];
const SHORTER_SIDE = 518;
const PATCH = 14;

let depthNetwork;

/** Load a depth network; it has one input, a picture (1, 3, height, width). */
async function loadDepthNetwork(bytes) {
  const problem = (why) => Object.assign(new Error(`the network: ${why}`), { of: "network" });
  let network;
  try {
    network = await ort.InferenceSession.create(bytes, { executionProviders: ["wasm"], logSeverityLevel: 3 });
  } catch (error) {
    throw problem(isMemory(error) ? "too large for this browser's memory" : "no ONNX file that this browser can run");
  }
  const [input] = network.inputMetadata, shape = input.shape ?? [];
  if (network.inputNames.length !== 1 || shape.length !== 4 || (typeof shape[1] === "number" && shape[1] !== 3)) {
    throw problem(`expected one input (1, 3, height, width), found ${network.inputNames.join(", ")} (${shape.join(", ")})`);
  }
  return network;
}

/** Size in which a network receives a picture: its own if that is fixed. */
function sizeFor(network, { width, height }) {
  const [, , fixedHeight, fixedWidth] = network.inputMetadata[0].shape;
  const scale = SHORTER_SIDE / Math.min(width, height);
  const side = (length) => PATCH * Math.max(1, Math.round((length * scale) / PATCH));
  const number = (fixed, length) => (typeof fixed === "number" && fixed > 0 ? fixed : side(length));
  return { width: number(fixedWidth, width), height: number(fixedHeight, height) };
}

/** Return the disparity of a photo as a grey PNG, near is bright. */
async function estimated(blob, bytes) {
  await session; // it loads the runtime
  if (bytes) depthNetwork = await loadDepthNetwork(bytes);
  const whole = await decoded("photo", blob);
  const size = sizeFor(depthNetwork, whole), { width, height } = size, area = width * height;
  const { data } = await pixels(blob, size);
  const values = new Float32Array(3 * area);
  for (let i = 0; i < area; i++) {
    for (let c = 0; c < 3; c++) values[c * area + i] = (data[4 * i + c] / 255 - MEAN[c]) / DEVIATION[c];
  }
  const input = new ort.Tensor("float32", values, [1, 3, height, width]);
  const output = (await depthNetwork.run({ [depthNetwork.inputNames[0]]: input }))[depthNetwork.outputNames[0]];
  const [rows, columns] = output.dims.slice(-2);
  const low = output.data.reduce((a, b) => Math.min(a, b), Infinity);
  const high = output.data.reduce((a, b) => Math.max(a, b), -Infinity);
  if (output.data.length !== rows * columns || !(high - low > 0 && high - low < Infinity)) {
    throw Object.assign(new Error("the network: expected a map of different depths, found none"), { of: "network" });
  }
  const grey = new ImageData(columns, rows);
  for (let i = 0; i < rows * columns; i++) {
    grey.data.fill(Math.round((255 * (output.data[i] - low)) / (high - low)), 4 * i, 4 * i + 3);
    grey.data[4 * i + 3] = 255;
  }
  const canvas = new OffscreenCanvas(columns, rows);
  canvas.getContext("2d").putImageData(grey, 0, 0);
  return canvas.convertToBlob({ type: "image/png" });
}

const pause = () => new Promise((resolve) => setTimeout(resolve));

/** Render tile by tile, until another request comes. */
async function render(id, numbers) {
  const start = performance.now();
  const { width, height } = photo;
  const most = mostBlurred(numbers);
  const [radii, margin] = rays ? [RAYS.radii, RAYS.around] : [1, AROUND];
  const around = STEP * Math.ceil((radii * most.radius + margin) / STEP);
  const whole = new OffscreenCanvas(width, height);
  const context = whole.getContext("2d");
  const [tall, wide] = [side(height), side(width)];
  const [rows, columns] = [Math.ceil(height / tall), Math.ceil(width / wide)];
  for (let at = 0; at < rows * columns; at++) {
    const [y, x] = [tall * Math.floor(at / columns), wide * (at % columns)];
    const [left, top] = [Math.max(0, x - around), Math.max(0, y - around)];
    const right = Math.min(width, x + wide + around);
    const bottom = Math.min(height, y + tall + around);
    const seen = part(disparity, left, top, right, bottom);
    if (rows * columns > 1) {
      // How often the network halves a picture follows from its largest blur: all tiles shall have the same.
      const row = top < y ? 0 : seen.height - 1;
      const column = left < x ? 0 : seen.width - 1;
      seen.data.fill(most.code, 4 * (row * seen.width + column), 4 * (row * seen.width + column) + 3);
    }
    const picture = await renderBokeh(await session, part(photo, left, top, right, bottom), seen, numbers);
    await pause();
    if (id !== latest) return;
    const kept = part(picture, x - left, y - top, Math.min(x + wide, width) - left, Math.min(y + tall, height) - top);
    context.putImageData(kept, x, y);
    show(whole, x, y, kept.width, kept.height);
    postMessage({ id, share: (at + 1) / (rows * columns) });
  }
  const seconds = (performance.now() - start) / 1000;
  postMessage({ done: await whole.convertToBlob({ type: "image/png" }), id, seconds });
}

async function answer({ id, model, rays: traces, provider, canvas, open, estimate, sharpen, focusAt, numbers }) {
  try {
    if (canvas) shown = canvas;
    if (model) {
      [rays, tile] = [traces, traces ? RAYS.tile : TILE];
      (session = load(model, provider)).catch((error) => postMessage({ error: error.message ?? String(error) }));
    }
    if (estimate) postMessage({ estimated: await estimated(estimate.photo, estimate.bytes) });
    if (open) {
      const one = await decoded("photo", open.photo);
      [photo, given] = [one, await decoded("disparity", open.disparity, one)];
      await chooseMap();
      fit(photo);
      postMessage({ opened: { width: photo.width, height: photo.height } });
    }
    if (sharpen !== undefined) {
      sharpens = sharpen;
      if (photo) await chooseMap();
    }
    if (focusAt) {
      const { width, height } = photo;
      const row = Math.min(Math.floor(focusAt.y * height), height - 1);
      const column = Math.min(Math.floor(focusAt.x * width), width - 1);
      postMessage({ focus: disparity.data[4 * (row * width + column)] / 255 });
    }
    if (numbers && photo && id === latest) await renderWithin(id, numbers);
  } catch (error) {
    postMessage({ error: error.message ?? String(error), id, of: error.of });
  }
}

onmessage = ({ data }) => {
  if (data.numbers) latest = data.id;
  turn = turn.then(() => answer(data));
};
