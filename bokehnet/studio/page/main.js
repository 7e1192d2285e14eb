// Main script of the page: state, previews, and user input.

import { ServerError, frame, frames, get, post, space, upload } from "./api.js";
import { makeBanner, showBanner, showEstimate } from "./banner.js";
import { clear, contextOf, draw, histogram, mark, painted, resize } from "./canvas.js";
import { focusEnds } from "./focus.js";
import { clearFaults, makePanels, showFault, showSettings, valueOf } from "./panels.js";
import { makeQuick, sharpWords, shifted, showLightNote, showQuick } from "./quick.js";
import { clearPresets, refreshPresets, selectPreset, showPresets, stopPresets } from "./presets.js";
import { makeView } from "./view.js";

const $ = (id) => document.getElementById(id);
const [stage, sheet, result, before, over, marks] = ["stage", "sheet", "result", "before", "over", "marks"].map($);

const now = {
  state: null, facts: {}, tool: "focus", cursor: null, path: null, tap: null, turned: null, loupe: false, beforeOf: "",
  pointer: null, trace: null, comparing: false, missing: false, renderFailed: false,
};

const TINTS = { nearer: "#f58c2888", farther: "#3c78eb88", same: "#ffffff66", sharp: "#46e67888", hidden: "#b45ae688" };
const COMMAND_DELAY_MS = 300; // after the last draft: the final picture of a busy machine may take long
let pending = null, running = null, first = false, held = false;

// ---- previews: one request at a time, the last one wins

/** Request a preview; changes made meanwhile are sent together. */
function requestPreview({ changes = {}, preset, event } = {}) {
  if (!now.state?.open) return;
  pending ??= { changes: {}, begun: event?.timeStamp ?? performance.now(), kind: event?.type ?? "other" };
  for (const [group, fields] of Object.entries(changes)) {
    if (group === "focus") [pending.changes.focus, now.turned] = [{}, null];
    pending.changes[group] = { ...pending.changes[group], ...fields };
  }
  if (preset !== undefined) pending.preset = preset;
  stopPresets();
  pump();
}

function pump() {
  if (!pending || (running && !first)) return;
  running?.abort();
  const request = pending;
  pending = null;
  render(request);
}

async function render({ changes, preset, begun, kind }) {
  const control = new AbortController();
  running = control;
  first = false;
  clearFaults();
  if (kind !== "other" || now.renderFailed) showMessage("", "error"); // else it may be the error of a file
  now.renderFailed = false;
  const size = { width: result.width, height: result.height };
  try {
    for await (const picture of frames("preview", { changes, preset, held, ...size }, control.signal)) {
      if (control.signal.aborted) return;
      const { header } = picture;
      if (header.stage === "progress") showProgress(header.share);
      else if (header.bytes) {
        draw(result, picture);
        const fresh = !first;
        first = true;
        painted(() => {
          performance.measure(`pixels ${header.stage}`, { start: begun, end: performance.now(), detail: { kind } });
          if (fresh) {
            now.facts = header;
            applySettings(header);
            clearTimeout(now.commandTimer);
            now.commandTimer = setTimeout(showCommand, COMMAND_DELAY_MS);
          }
          showFacts({ ...header, equivalents: header.equivalents ?? now.facts.equivalents });
          if (header.stage !== "draft") histogram($("histogram"), picture.pixels);
        });
        pump();
      }
    }
    if (control.signal.aborted) return;
    showProgress(0);
    painted(settled);
  } catch (error) {
    if (error.name === "AbortError" || control.signal.aborted) return;
    showError(error);
    now.renderFailed = true;
  } finally {
    if (running === control) {
      running = null;
      pump();
    }
  }
}

function applySettings({ settings, version, history, preset }) {
  const redraw = now.state.version !== version;
  Object.assign(now.state, { settings, version, preset, ...history });
  now.trace = null;
  showSettings(settings);
  selectPreset(preset);
  showHistory();
  if (redraw) showBefore();
  showOverlay();
}

function settled() {
  if (!pending) now.turned = null;
  document.body.dataset.settled = String(Number(document.body.dataset.settled ?? 0) + 1);
  showCommand();
  refreshPresets();
}

function showFacts(header) {
  now.facts = header;
  showQuick(now.state, header);
  const stop = now.state.kind === "metric" ? valueOf(now.state.settings, "camera.f_number") : header.equivalents?.f_number;
  const across = 2 * header.largest_blur * scale(), percent = (100 * across) / now.state.width;
  const words = [
    stop && `f/${Number(stop.toPrecision(2))}`, `sharp ${sharpWords()}`,
    `lights blur into discs of up to ${Math.round(across)} pixels, ${percent.toFixed(1)} % of the width`, `engine ${header.engine}`,
  ];
  if (now.missing) words.splice(0, words.length, "no depth, no blur");
  showMessage(words.filter(Boolean).concat(now.state.notes, header.notes ?? []).join(" · "), "status");
  document.body.dataset.stage = header.stage;
}

const scale = () => now.state.width / Math.max(now.facts.width ?? 1, 1);

function showProgress(share) {
  $("progress").firstElementChild.style.width = `${100 * share}%`;
}

// ---- messages

function showMessage(text, where) {
  $(where).textContent = text;
}

function showError(error) {
  if (!(error instanceof ServerError)) console.error(error);
  if (!error.path || !showFault(error.path, error.message)) showMessage(error.message, "error");
}

/** Show the errors of an action; an event of the user erases an earlier one. */
const safely = (action) => async (...values) => {
  try {
    if (values[0] instanceof Event) showMessage("", "error");
    await action(...values);
  } catch (error) {
    showError(error);
  }
};

// ---- opening

async function opened(state) {
  const isNew = now.state?.picture !== state.picture;
  now.state = state;
  now.missing = showBanner(state);
  sheet.hidden = !state.open;
  $("drop").hidden = state.open;
  $("map-button").hidden = $("role").hidden = !state.open;
  for (const button of document.querySelectorAll("#out button, #out a")) button.toggleAttribute("inert", !state.open);
  if (!state.open) return;
  $("name").textContent = `${state.name}, ${state.width} × ${state.height}`;
  if (isNew) {
    $("out-name").value = state.export_name;
    now.facts = {};
    // The previous picture may have another shape, also in a preview that is still on its way.
    running?.abort();
    running = null;
    for (const canvas of [result, before, over]) clear(canvas);
    clearPresets();
    view.fit();
    makeQuick($("quick"), state, (changes, event) => requestPreview({ changes, event }), () => toggleOverlay("light"));
  }
  selectPreset(state.preset);
  showSettings(state.settings);
  fit();
  showStrokes();
  requestPreview();
  watch();
}

/** Resize the canvases to the size of the picture on the page. */
function fit() {
  const { width, height } = now.state;
  stage.style.setProperty("--ratio", height / width);
  const room = stage.getBoundingClientRect(), dense = Math.min(devicePixelRatio || 1, 2);
  const factor = Math.min((room.width - 4) / width, (room.height - 4) / height);
  sheet.style.width = `${Math.round(width * factor)}px`;
  sheet.style.height = `${Math.round(height * factor)}px`;
  const share = Math.min(1, factor * dense * view.zoom(), 2560 / Math.max(width, height));
  const size = [width, height].map((side) => Math.max(16, Math.round(side * share)));
  for (const canvas of [result, before, over, marks]) resize(canvas, ...size);
  showBefore(true);
}

const showBefore = safely(async (fresh) => {
  const share = now.comparing ? 100 : Number($("compare").value);
  before.style.clipPath = `inset(0 ${100 - share}% 0 0)`;
  $("split").style.left = `${share}%`;
  before.hidden = $("split").hidden = share === 0;
  const key = `${now.state.picture} ${result.width}`;
  if (share && (fresh || now.beforeOf !== key)) {
    now.beforeOf = key;
    draw(before, await frame(`plain?width=${result.width}&height=${result.height}&space=${space}`));
  } else if (fresh) now.beforeOf = "";
});

const showOverlay = safely(async () => {
  const kind = $("overlay-kind").value;
  over.hidden = !kind;
  if (kind) draw(over, await frame(`overlay?kind=${kind}&width=${result.width}&height=${result.height}`));
});

async function take(files, role = "picture") {
  showMessage(`opening ${files[0].name} …`, "status");
  try {
    showMessage("", "error");
    let state = await upload("open", files[0], role);
    if (files[1] && role === "picture") state = await upload("open", files[1], $("role").value);
    await opened(state);
  } catch (error) {
    showMessage("", "status");
    showError(error);
  }
}

/** Poll the background jobs while any is running. */
let watching = 0;
async function watch() {
  const turn = ++watching;
  for (;;) {
    let jobs;
    try {
      jobs = await get("jobs");
    } catch (error) {
      showError(error);
      return;
    }
    if (turn !== watching) return;
    showJobs(jobs);
    if (Object.values(jobs).every((job) => job.state !== "running")) return;
    await new Promise((done) => setTimeout(done, 300));
  }
}

function showJobs(jobs) {
  const { repair, light, estimate, export: out } = jobs;
  if (now.light === "running" && light.state === "done" && light.note) requestPreview();
  now.light = light.state;
  showLightNote(light);
  showEstimate(estimate);
  if (now.estimate === "running" && estimate.state === "done") safely(async () => opened(await get("state")))();
  now.estimate = estimate.state;
  if (now.repair === "running" && repair.state === "done") {
    safely(async () => {
      await opened(await get("state"));  // the focus may have moved with the map
      showMessage(`map repaired: ${repair.reason}`, "status");
    })();
  }
  if (repair.state === "failed") showMessage(repair.error, "error");
  if (repair.state === "running") showProgress(repair.share);
  now.repair = repair.state;
  const bar = $("export-bar"), exportStatus = $("export-status");
  bar.hidden = out.state !== "running";
  bar.value = out.share ?? 0;
  $("export").textContent = out.state === "running" ? "Stop" : "Export";
  exportStatus.className = out.state === "failed" ? "fault" : "";
  exportStatus.replaceChildren();
  if (out.state === "failed") exportStatus.textContent = out.error;
  if (out.state === "running") exportStatus.textContent = timeLeft(out);
  if (out.state === "done") {
    const link = document.createElement("a");
    Object.assign(link, { href: "api/result", download: out.name, textContent: `Save ${out.name}`, className: "button" });
    exportStatus.append(link);
    if (now.exporting) link.click();
    now.exporting = false;
  }
  document.body.dataset.export = out.state;
}

/** Return the time that an export still needs, in words. */
function timeLeft({ share, seconds }) {
  if (!(share > 0.02)) return "Exporting …";
  const left = (seconds * (1 - share)) / share;
  return left < 1 ? "Almost done …" : `About ${left < 90 ? `${Math.ceil(left)} s` : `${Math.ceil(left / 60)} min`} left`;
}

// ---- pointer input on the picture

function place(event) {
  const box = sheet.getBoundingClientRect();
  return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height].map((x) => Math.min(Math.max(x, 0), 1));
}

const pixel = ([x, y]) => [Math.min(Math.floor(x * now.state.width), now.state.width - 1), Math.min(Math.floor(y * now.state.height), now.state.height - 1)];

function marked() {
  const at = valueOf(now.state?.settings, "focus.at");
  const focus = at ? [(at[0] + 0.5) / now.state.width, (at[1] + 0.5) / now.state.height] : null;
  const brushing = now.tool !== "focus";
  return {
    focus, cursor: now.cursor, path: now.path ?? now.trace, radius: Number($("brush-size").value) / 100,
    brush: brushing ? now.pointer : null, tint: TINTS[now.tool] ?? TINTS.same, zoom: view.zoom(),
  };
}

function focusAt(point, event) {
  if (now.state.kind === "defocus" || now.missing) return;
  requestPreview({ changes: { focus: { at: pixel(point) } }, event });
}

function ring(steps, event) {
  if (!now.state?.open || now.missing || now.facts.focus_disparity == null) return;
  const [far, near] = focusEnds(now.state, now.facts);
  const from = now.turned ?? (far + near) / 2; // previews of earlier steps may still arrive
  const metric = now.state.kind === "metric";
  const turned = metric ? Math.max(from * 1.04 ** steps, 1e-6) : Math.min(Math.max(from + 0.01 * steps, 0), 1);
  requestPreview({ changes: shifted(now.state, far, near, turned), event });
  now.turned = turned;
}

sheet.addEventListener("pointerdown", (event) => {
  if (event.button !== 0 || !event.isPrimary || view.panning()) return;
  now.cursor = null;
  if (now.tool === "focus") {
    if (event.pointerType === "touch") now.tap = place(event); // a second finger may follow
    else focusAt(place(event), event);
    return;
  }
  sheet.setPointerCapture(event.pointerId);
  now.path = [place(event)];
  mark(marks, marked());
});
sheet.addEventListener("pointermove", (event) => {
  if (!event.isPrimary) return;
  now.pointer = event.pointerType === "touch" && !now.path ? null : place(event);
  if (now.path && now.path.length < 1900) now.path.push(now.pointer);
  else if (now.loupe) lookAt(place(event));
  if (now.tool !== "focus") mark(marks, marked());
});
sheet.addEventListener("pointerleave", () => {
  now.pointer = null;
  mark(marks, marked());
});
sheet.addEventListener("pointerup", safely(async (event) => {
  if (now.tap && event.isPrimary) focusAt(now.tap, event);
  now.tap = null;
  if (!now.path) return;
  const { path, radius } = marked();
  [now.path, now.trace] = [null, path]; // the trace stays until the preview shows the stroke
  await stroke({ effect: now.tool, points: path, radius, edges: $("brush-edges").checked });
}));
sheet.addEventListener("pointercancel", () => {
  now.path = now.tap = null;
  mark(marks, marked());
});
stage.addEventListener("wheel", (event) => {
  if (!now.state?.open || event.ctrlKey) return;
  event.preventDefault();
  ring(-Math.sign(event.deltaY), event);
}, { passive: false });

async function stroke(table) {
  now.state = { ...now.state, ...(await post("stroke", { stroke: table })) };
  now.missing = showBanner(now.state);
  showStrokes();
  requestPreview();
}

function showStrokes() {
  $("save-map").hidden = !now.state?.strokes;
  showHistory();
  mark(marks, marked());
}

function showHistory() {
  $("undo").disabled = !now.state?.done;
  $("redo").disabled = !now.state?.undone;
  const changes = now.state?.changes ?? [];
  $("history-button").disabled = !changes.length;
  $("history").replaceChildren(...["Opened", ...changes].map((words, step) => {
    const entry = document.createElement("button");
    entry.type = "button";
    entry.role = "option";
    entry.textContent = words;
    entry.ariaSelected = String(step === now.state?.done);
    entry.addEventListener("click", () => stepTo(step));
    return entry;
  }));
}

/** Undo or redo until `step` changes are done. */
const stepTo = safely(async (step) => {
  const count = step - now.state.done;
  if (!count) return;
  now.state = { ...now.state, ...(await post(count < 0 ? "undo" : "redo", { count: Math.abs(count) })) };
  now.missing = showBanner(now.state);
  selectPreset(now.state.preset);
  showStrokes();
  requestPreview();
});
$("undo").addEventListener("click", () => stepTo(now.state.done - 1));
$("redo").addEventListener("click", () => stepTo(now.state.done + 1));

function pick(tool) {
  now.tool = tool;
  for (const button of document.querySelectorAll("[data-tool]")) button.setAttribute("aria-checked", String(button.dataset.tool === tool));
  $("brush").classList.toggle("idle", tool === "focus");
  $("brush").toggleAttribute("inert", tool === "focus");
  if (now.state?.open) mark(marks, marked());
}
for (const button of document.querySelectorAll("[data-tool]")) button.addEventListener("click", () => pick(button.dataset.tool));

// ---- loupe

let looking = null, next = null;
function lookAt(point) {
  next = point;
  if (!looking) look();
}
const look = safely(async () => {
  const point = next;
  next = null;
  looking = new AbortController();
  try {
    const loupe = $("loupe"), dense = Math.min(devicePixelRatio || 1, 2);
    loupe.style.width = loupe.style.height = "256px";
    for await (const picture of frames("loupe", { x: point[0], y: point[1], width: 256 * dense, height: 256 * dense }, looking.signal)) {
      if (!picture.header.bytes) continue;
      loupe.width = picture.header.width;
      loupe.height = picture.header.height;
      draw(loupe, picture);
      loupe.dataset.stage = picture.header.stage;
      if (next) break;
    }
  } finally {
    looking?.abort();
    looking = null;
    if (next) look();
  }
});
function toggleLoupe() {
  now.loupe = !now.loupe;
  $("loupe").hidden = !now.loupe;
  $("loupe-button").setAttribute("aria-pressed", String(now.loupe));
  if (now.loupe && now.state?.open) lookAt(now.cursor ?? marked().focus ?? [0.5, 0.5]);
}
$("loupe-button").addEventListener("click", toggleLoupe);

// While a slider is dragged, further changes follow soon.
addEventListener("pointerdown", (event) => (held = event.target.type === "range"), true);
for (const end of ["pointerup", "pointercancel", "blur"]) addEventListener(end, () => (held = false), true);

// ---- keyboard

stage.addEventListener("keydown", (event) => {
  const step = event.shiftKey ? 0.05 : 0.01;
  const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
  if (moves[event.key] && now.state?.open) {
    const [x, y] = now.cursor ?? marked().focus ?? [0.5, 0.5];
    now.cursor = [x + moves[event.key][0], y + moves[event.key][1]].map((one) => Math.min(Math.max(one, 0), 1));
    mark(marks, marked());
    if (now.loupe) lookAt(now.cursor);
  } else if (event.key === "Enter" && now.cursor) {
    if (now.tool === "focus") focusAt(now.cursor, event);
    else safely(stroke)({ effect: now.tool, points: [now.cursor], radius: marked().radius, edges: $("brush-edges").checked });
  } else if (event.key === "+" || event.key === "=") ring(1, event);
  else if (event.key === "-") ring(-1, event);
  else return;
  event.preventDefault();
});
document.addEventListener("keydown", (event) => {
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "range") return;
  const key = event.key.toLowerCase();
  if (event.ctrlKey || event.metaKey) {
    if (key === "z") {
      event.preventDefault();
      $(event.shiftKey ? "redo" : "undo").click();
    }
    return;
  }
  const tools = { f: "focus", 1: "nearer", 2: "farther", 3: "same", 4: "sharp", 5: "hidden" };
  const overlays = { d: "depth", p: "focus", c: "confidence", h: "light" };
  if (tools[key]) pick(tools[key]);
  else if (overlays[key]) toggleOverlay(overlays[key]);
  else if (key === "l") toggleLoupe();
  else if (key === "0") view.fit();
  else if (key === "b" && !event.repeat) compare(true);
});
document.addEventListener("keyup", (event) => event.key.toLowerCase() === "b" && compare(false));
addEventListener("blur", () => compare(false));

function toggleOverlay(kind) {
  const select = $("overlay-kind");
  select.value = select.value === kind ? "" : kind;
  showOverlay();
}

/** Show the original while a key or button is held. */
function compare(on) {
  if (now.comparing === on || !now.state?.open) return;
  now.comparing = on;
  showBefore();
}
$("hold").addEventListener("pointerdown", () => compare(true));
for (const end of ["pointerup", "pointercancel"]) addEventListener(end, () => compare(false));

// ---- export, equivalent code, files

const showCommand = safely(async () => {
  $("command").textContent = (await post("words", { name: $("out-name").value })).command;
});
async function copy(kind) {
  const words = (await post("words", { name: $("out-name").value }))[kind];
  $("command").textContent = words;
  await navigator.clipboard.writeText(words).catch(() => getSelection().selectAllChildren($("command")));
}
$("copy-command").addEventListener("click", safely(() => copy("command")));
$("copy-python").addEventListener("click", safely(() => copy("python")));
$("out-name").addEventListener("change", showCommand);
$("export").addEventListener("click", safely(async () => {
  if (document.body.dataset.export === "running") await post("stop");
  else {
    await post("export", { name: $("out-name").value });
    now.exporting = true;
  }
  watch();
}));
$("open").addEventListener("change", () => $("open").files[0] && take([...$("open").files]));
for (const input of ["map", "map-here"].map($)) {
  input.addEventListener("change", () => input.files[0] && take([...input.files], $("role").value));
}
$("reopen").addEventListener("change", safely(async () => {
  if ($("reopen").files[0]) await opened(await upload("reopen", $("reopen").files[0]));
}));
for (const input of document.querySelectorAll("input[type=file]")) input.addEventListener("click", () => (input.value = ""));
document.addEventListener("dragover", (event) => {
  event.preventDefault();
  stage.classList.add("over");
});
document.addEventListener("dragleave", () => stage.classList.remove("over"));
document.addEventListener("drop", (event) => {
  event.preventDefault();
  stage.classList.remove("over");
  const files = [...event.dataTransfer.files];
  if (files.length === 1 && files[0].name.endsWith(".bokeh")) safely(async () => opened(await upload("reopen", files[0])))();
  else if (files.length) take(files);
});
$("compare").addEventListener("input", () => now.state?.open && showBefore());
$("overlay-kind").addEventListener("change", showOverlay);

// ---- initialisation

let zoomed = 0;
const view = makeView(stage, sheet, () => {
  $("fit").disabled = view.zoom() === 1;
  $("fit").textContent = view.zoom() === 1 ? "Fit" : `Fit (${view.zoom().toFixed(1)}×)`;
  if (!now.state?.open) return;
  mark(marks, marked());
  clearTimeout(zoomed);
  zoomed = setTimeout(() => {
    const was = result.width;
    fit();
    if (result.width !== was) requestPreview();
  }, 300);
}, () => {
  now.path = now.tap = null;
  mark(marks, marked());
});
$("fit").addEventListener("click", () => view.fit());
makeBanner({ safely, paint: () => pick("nearer"), estimating: watch });

let resized = 0;
new ResizeObserver(() => {
  clearTimeout(resized);
  resized = setTimeout(() => {
    if (!now.state?.open) return;
    const was = result.width;
    const width = sheet.offsetWidth;
    const room = stage.getBoundingClientRect();
    const factor = Math.min((room.width - 4) / now.state.width, (room.height - 4) / now.state.height);
    if (Math.abs(width - now.state.width * factor) > 2 || !was) {
      fit();
      requestPreview();
    }
  }, 150);
}).observe(stage);

// Another page of the same studio may have changed the state.
addEventListener("focus", safely(async () => {
  const state = await get("state");
  const changed = JSON.stringify([state.settings, state.version, state.name]) !== JSON.stringify([now.state?.settings, now.state?.version, now.state?.name]);
  if (state.open && !running && changed) await opened(state);
}));

safely(async () => {
  contextOf(result); // sets its colour space
  const [panels, presets, state] = await Promise.all([get("panels"), get("presets"), get("state")]);
  const initialOf = (path) => valueOf(now.state?.initial, path);
  makePanels($("panels"), panels, (changes, event) => requestPreview({ changes, event }), initialOf);
  showPresets($("presets"), presets, (preset, event) => requestPreview({ preset, event }));
  await opened(state);
  document.body.dataset.ready = "yes";
})();
