// Page of a 3-D scene: orbit, focus and lens; a draft follows the hand, traced pictures replace it at rest.

import { frames, get } from "./api.js";

const MAX_WIDTH = 640, DEGREES_PER_PX = 0.35, CLICK_PX = 4, FOCUS_STEP = 1.04;
// Widths of a draft: the last at rest; in motion the next smaller one above SLOW_MS, the next larger below FAST_MS.
const DRAFT_WIDTHS = [128, 160, 192, 224, 256], SLOW_MS = 85, FAST_MS = 50;
const element = (id) => document.getElementById(id);
const canvas = element("result"), stage = element("stage");

const view = { azimuth: 0, elevation: 0, zoom: 1, exposure: 0, lens: {} };
let scene, original, controller = null, drafting = false, waiting = null, times = [];
let pace = DRAFT_WIDTHS.length - 1;

/** Ask for pictures of the current view; while a draft is on its way, only the newest request waits. */
function show(options = {}) {
  if (drafting) {
    waiting = { ...options, focus_at: options.focus_at ?? waiting?.focus_at };
    return;
  }
  waiting = null;
  load(options);
}

async function load(options) {
  controller?.abort();
  const own = (controller = new AbortController());
  drafting = true;
  const begin = performance.now();
  const largest = DRAFT_WIDTHS.at(-1), draft_width = options.moving ? DRAFT_WIDTHS[pace] : largest;
  const width = Math.min(MAX_WIDTH, Math.max(largest, Math.round(canvas.clientWidth)));
  try {
    for await (const { header, pixels } of frames("view", { ...view, ...options, width, draft_width }, own.signal)) {
      if (own.signal.aborted) return;
      if (pixels) await draw(pixels);
      if (header.stage === "draft") {
        drafting = Boolean(options.moving); // its response is read to its end, so that the connection stays
        element("error").textContent = "";
        count(performance.now() - begin, options.moving ? draft_width : 0);
        if (options.focus_at) focused(header.focus_distance);
      }
      report(header);
      if (header.stage === "draft" && waiting && !drafting) return show(waiting);
    }
    drafting = false;
    if (options.moving && waiting) show(waiting);
  } catch (error) {
    if (error.name === "AbortError") return;
    element("error").textContent = error.message;
    drafting = false;
    document.body.dataset.stage = "error";
    if (waiting) show(waiting);
  }
}

async function draw(jpeg) {
  const picture = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    [canvas.width, canvas.height] = [picture.width, picture.height];
  }
  canvas.getContext("2d").drawImage(picture, 0, 0);
  picture.close();
}

/** Count drafts of the last second, and choose the width of the next one in motion. */
function count(milliseconds, movingWidth) {
  const now = performance.now();
  if (movingWidth) {
    if (milliseconds > SLOW_MS) pace = Math.max(pace - 1, 0);
    else if (milliseconds < FAST_MS) pace = Math.min(pace + 1, DRAFT_WIDTHS.length - 1);
    document.body.dataset.width = movingWidth;
  }
  document.body.dataset.latency = Math.round(milliseconds);
  times = [...times.filter((time) => now - time < 1000), now];
  document.body.dataset.drafts = Number(document.body.dataset.drafts ?? 0) + 1;
  document.body.dataset.rate = times.length;
}

function report(header) {
  const { samples } = header, traced = header.stage === "traced";
  if (header.stage !== "done") document.body.dataset.samples = samples;
  document.body.dataset.stage = header.stage;
  element("progress").firstElementChild.style.width = traced ? `${(100 * samples) / scene.samples}%` : "0";
  if (header.stage === "done") return;
  const where = `${view.azimuth.toFixed(0)}° across, ${view.elevation.toFixed(0)}° up`;
  const state = traced ? `traced, ${samples} of ${scene.samples} samples` : `draft, ${times.length} a second`;
  element("status").textContent = `${state}; ${where}`;
}

/** Show a focus distance, m; null is infinity. */
function focused(distance) {
  view.lens.focus_distance = distance;
  element("focus-distance").value = distance === null ? "" : Number(distance.toPrecision(4));
  element("focus-ring").value = distance === null ? 2 : Math.log10(distance);
}

function fill() {
  const { lens } = view;
  element("lens").value = lens.name;
  element("focal-length").value = lens.focal_length ?? "";
  element("f-number").value = lens.f_number ?? "";
  focused(lens.focus_distance);
}

function number(id) {
  const { value } = element(id);
  return value === "" ? null : Number(value);
}

function orbit(across, up, moving) {
  view.azimuth += across;
  view.elevation = Math.min(Math.max(view.elevation + up, -89), 89);
  show({ moving });
}

function turnRing(factor) {
  if (view.lens.focus_distance === null) return;
  focused(view.lens.focus_distance * factor);
  show();
}

function connect() {
  let from = null, moved = 0, rest = 0;
  stage.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    stage.setPointerCapture(event.pointerId);
    [from, moved] = [[event.clientX, event.clientY], 0];
  });
  stage.addEventListener("pointermove", (event) => {
    if (!from) return;
    const across = event.clientX - from[0], up = event.clientY - from[1];
    moved += Math.hypot(across, up);
    if (moved < CLICK_PX) return;
    from = [event.clientX, event.clientY];
    orbit(-across * DEGREES_PER_PX, up * DEGREES_PER_PX, true);
  });
  stage.addEventListener("pointerup", (event) => {
    if (!from) return;
    from = null;
    if (moved >= CLICK_PX) return show();
    const box = canvas.getBoundingClientRect();
    const at = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    if (at.every((part) => part >= 0 && part < 1)) show({ focus_at: at });
  });
  stage.addEventListener("pointercancel", () => (from = null));
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    view.zoom = Math.min(Math.max(view.zoom * 1.08 ** Math.sign(event.deltaY), 0.05), 20);
    show({ moving: true });
    clearTimeout(rest);
    rest = setTimeout(show, 250);
  }, { passive: false });
  stage.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] }[event.key];
    if (turns) orbit(...turns, false);
    else if (event.key === "+") turnRing(FOCUS_STEP);
    else if (event.key === "-") turnRing(1 / FOCUS_STEP);
    else return;
    event.preventDefault();
  });
  element("lens").addEventListener("change", (event) => {
    const name = event.target.value, thin = name === "thin";
    // A lens of glass is fully open by default; a thin one has no default.
    const f_number = thin ? original.f_number ?? 2.8 : name === original.name ? original.f_number : null;
    Object.assign(view.lens, { name, f_number, focal_length: view.lens.focal_length ?? (thin ? 50 : null) });
    fill();
    show();
  });
  for (const [id, key] of [["focal-length", "focal_length"], ["f-number", "f_number"]]) {
    element(id).addEventListener("change", () => ((view.lens[key] = number(id)), show()));
  }
  element("focus-distance").addEventListener("change", () => (focused(number("focus-distance")), show()));
  element("focus-ring").addEventListener("input", (event) => (focused(10 ** Number(event.target.value)), show({ moving: true })));
  element("focus-ring").addEventListener("change", () => show());
  element("exposure").addEventListener("input", () => ((view.exposure = number("exposure") ?? 0), show()));
  element("reset").addEventListener("click", () => {
    Object.assign(view, { azimuth: 0, elevation: 0, zoom: 1, lens: { ...original } });
    fill();
    show();
  });
}

async function start() {
  scene = await get("scene");
  original = scene.lens;
  view.lens = { ...original };
  element("name").textContent = scene.name;
  document.title = `${scene.name}, bokehnet`;
  element("lens").append(...scene.lenses.map((name) => new Option(name, name)));
  stage.style.setProperty("--aspect", String(1 / scene.ratio));
  fill();
  connect();
  show();
}

start().catch((error) => (element("error").textContent = error.message));
