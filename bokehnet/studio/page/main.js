// The page: what is open, what is asked for, and what the hand does.

import { Told, frame, frames, get, post, space, upload } from "./api.js";
import { contextOf, draw, histogram, mark, painted } from "./canvas.js";
import { clearFaults, makePanels, showFault, showSettings, valueOf } from "./panels.js";
import { makeQuick, showQuick } from "./quick.js";
import { showPresets, refreshPresets, stopPresets } from "./presets.js";
import { ringByTouch } from "./touch.js";

const $ = (id) => document.getElementById(id);
const [stage, sheet, result, before, over, marks] = ["stage", "sheet", "result", "before", "over", "marks"].map($);

const now = {
  state: null, facts: {}, tool: "focus", cursor: null, path: null, tap: null, turned: null, loupe: false, beforeOf: "",
};
let pending = null, running = null, first = false, held = false;

// ---- previews: one on its way, the last request wins

/** Ask for a preview; what is changed meanwhile is sent together. */
function ask({ changes = {}, preset, event } = {}) {
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
  const wanted = pending;
  pending = null;
  render(wanted);
}

async function render({ changes, preset, begun, kind }) {
  const control = new AbortController();
  running = control;
  first = false;
  clearFaults();
  say("", "wrong");
  const size = { width: result.width, height: result.height };
  try {
    for await (const found of frames("preview", { changes, preset, held, ...size }, control.signal)) {
      if (control.signal.aborted) return;
      const { header } = found;
      if (header.stage === "progress") showProgress(header.share);
      else if (header.bytes) {
        draw(result, found);
        const fresh = !first;
        first = true;
        painted(() => {
          performance.measure(`pixels ${header.stage}`, { start: begun, end: performance.now(), detail: { kind } });
          if (fresh) taken(header);
          showFacts(header);
          if (header.stage !== "draft") histogram($("histogram"), found.pixels);
        });
        pump();
      }
    }
    if (control.signal.aborted) return;
    showProgress(0);
    painted(settled);
  } catch (error) {
    if (error.name === "AbortError" || control.signal.aborted) return;
    tell(error);
  } finally {
    if (running === control) {
      running = null;
      pump();
    }
  }
}

function taken({ settings, version }) {
  const redraw = now.state.version !== version;
  now.state.settings = settings;
  now.state.version = version;
  showSettings(settings);
  showQuick(now.state, now.facts);
  mark(marks, marked());
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
  const where = header.focus_distance ? `${header.focus_distance.toPrecision(3)} m` : header.focus_disparity?.toFixed(3);
  const words = [`${header.engine}`, where && `focus at ${where}`, `blur up to ${(header.largest_blur * scale()).toFixed(1)} pixels of the file`];
  say(words.filter(Boolean).concat(now.state.notes, header.notes ?? []).join(" · "), "told");
  document.body.dataset.stage = header.stage;
}

const scale = () => now.state.width / Math.max(now.facts.width ?? 1, 1);

function showProgress(share) {
  $("progress").firstElementChild.style.width = `${100 * share}%`;
}

// ---- messages

function say(text, where) {
  $(where).textContent = text;
}

function tell(error) {
  if (!(error instanceof Told)) console.error(error);
  if (!error.path || !showFault(error.path, error.message)) say(error.message, "wrong");
}

const safely = (action) => async (...given) => {
  try {
    say("", "wrong");
    await action(...given);
  } catch (error) {
    tell(error);
  }
};

// ---- opening

async function opened(state) {
  now.state = state;
  sheet.hidden = !state.open;
  $("drop").hidden = state.open;
  $("map-button").hidden = $("role").hidden = !state.open;
  for (const button of document.querySelectorAll("#out button, #out a")) button.toggleAttribute("inert", !state.open);
  if (!state.open) return;
  $("name").textContent = `${state.name}, ${state.width} × ${state.height}`;
  $("out-name").value = state.name.replace(/\.[^.]+$/, "_bokeh.png");
  makeQuick($("quick"), state, (changes, event) => ask({ changes, event }));
  showSettings(state.settings);
  fit();
  showStrokes();
  ask();
  watch();
}

/** Give the canvases the size that the picture has here. */
function fit() {
  const { width, height } = now.state;
  stage.style.setProperty("--ratio", height / width);
  const room = stage.getBoundingClientRect(), dense = Math.min(devicePixelRatio || 1, 2);
  const factor = Math.min((room.width - 4) / width, (room.height - 4) / height);
  sheet.style.width = `${Math.round(width * factor)}px`;
  sheet.style.height = `${Math.round(height * factor)}px`;
  const share = Math.min(1, factor * dense, 2560 / Math.max(width, height));
  for (const canvas of [result, before, over, marks]) {
    canvas.width = Math.max(16, Math.round(width * share));
    canvas.height = Math.max(16, Math.round(height * share));
  }
  showBefore(true);
}

const showBefore = safely(async (fresh) => {
  const share = Number($("compare").value);
  before.style.clipPath = `inset(0 ${100 - share}% 0 0)`;
  $("split").style.left = `${share}%`;
  before.hidden = $("split").hidden = share === 0;
  const wanted = `${now.state.name} ${result.width}`;
  if (share && (fresh || now.beforeOf !== wanted)) {
    now.beforeOf = wanted;
    draw(before, await frame(`plain?width=${result.width}&height=${result.height}&space=${space}`));
  } else if (fresh) now.beforeOf = "";
});

const showOverlay = safely(async () => {
  const kind = $("overlay-kind").value;
  over.hidden = !kind;
  if (kind) draw(over, await frame(`overlay?kind=${kind}&width=${result.width}&height=${result.height}`));
});

async function take(files, role = "picture") {
  say(`opening ${files[0].name} …`, "told");
  try {
    say("", "wrong");
    let state = await upload("open", files[0], role);
    if (files[1] && role === "picture") state = await upload("open", files[1], $("role").value);
    await opened(state);
  } catch (error) {
    say("", "told");
    tell(error);
  }
}

/** Follow what goes on in the background while anything does. */
let watching = 0;
async function watch() {
  const turn = ++watching;
  for (;;) {
    let jobs;
    try {
      jobs = await get("jobs");
    } catch (error) {
      tell(error);
      return;
    }
    if (turn !== watching) return;
    showJobs(jobs);
    if (jobs.repair.state !== "running" && jobs.export.state !== "running") return;
    await new Promise((done) => setTimeout(done, 300));
  }
}

function showJobs(jobs) {
  const { repair, export: out } = jobs;
  if (now.repair === "running" && repair.state === "done") {
    say(`map repaired: ${repair.reason}`, "told");
    ask();
  }
  if (repair.state === "failed") say(repair.error, "wrong");
  if (repair.state === "running") showProgress(repair.share);
  now.repair = repair.state;
  const bar = $("export-bar"), told = $("export-told");
  bar.hidden = out.state !== "running";
  bar.value = out.share ?? 0;
  $("export").textContent = out.state === "running" ? "Stop" : "Export";
  told.className = out.state === "failed" ? "fault" : "";
  told.replaceChildren();
  if (out.state === "failed") told.textContent = out.error;
  if (out.state === "done") {
    const link = document.createElement("a");
    Object.assign(link, { href: "api/result", download: out.name, textContent: `Save ${out.name}`, className: "button" });
    told.append(link);
    if (now.exporting) link.click();
    now.exporting = false;
  }
  document.body.dataset.export = out.state;
}

// ---- the hand on the picture

function place(event) {
  const box = sheet.getBoundingClientRect();
  return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height].map((x) => Math.min(Math.max(x, 0), 1));
}

const pixel = ([x, y]) => [Math.min(Math.floor(x * now.state.width), now.state.width - 1), Math.min(Math.floor(y * now.state.height), now.state.height - 1)];

function marked() {
  const at = valueOf(now.state?.settings, "focus.at");
  const focus = at ? [(at[0] + 0.5) / now.state.width, (at[1] + 0.5) / now.state.height] : null;
  return { focus, cursor: now.cursor, path: now.path, radius: Number($("brush-size").value) / 100 };
}

function focusAt(point, event) {
  if (now.state.kind === "defocus") return;
  ask({ changes: { focus: { at: pixel(point) } }, event });
}

function ring(steps, event) {
  if (!now.state?.open || now.facts.focus_disparity == null) return;
  const from = now.turned ?? now.facts.focus_disparity; // pictures of earlier steps may be still to come
  if (now.state.kind === "metric") {
    const dioptres = Math.max(1000 * from * 1.04 ** steps, 1e-3);
    ask({ changes: { focus: { distance: 1 / dioptres } }, event });
    now.turned = dioptres / 1000;
  } else {
    const turned = Math.min(Math.max(from + 0.01 * steps, 0), 1);
    ask({ changes: { focus: { value: Number(turned.toFixed(4)) } }, event });
    now.turned = turned;
  }
}

sheet.addEventListener("pointerdown", (event) => {
  if (event.button !== 0 || !event.isPrimary) return;
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
  if (now.path && now.path.length < 1900) {
    now.path.push(place(event));
    mark(marks, marked());
  } else if (now.loupe) lookAt(place(event));
});
sheet.addEventListener("pointerup", safely(async (event) => {
  if (now.tap && event.isPrimary) focusAt(now.tap, event);
  now.tap = null;
  if (!now.path) return;
  const { path, radius } = marked();
  now.path = null;
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

ringByTouch(stage, (steps, event) => {
  now.path = now.tap = null; // what the first finger may have begun
  ring(steps, event);
});

async function stroke(told) {
  now.state = { ...now.state, ...(await post("stroke", { stroke: told })) };
  showStrokes();
  ask();
}

function showStrokes() {
  $("undo").disabled = !now.state?.strokes;
  $("redo").disabled = !now.state?.undone;
  $("save-map").hidden = !now.state?.strokes;
  mark(marks, marked());
}

for (const name of ["undo", "redo"]) {
  $(name).addEventListener("click", safely(async () => {
    now.state = { ...now.state, ...(await post(name)) };
    showStrokes();
    ask();
  }));
}

function pick(tool) {
  now.tool = tool;
  for (const button of document.querySelectorAll("[data-tool]")) button.setAttribute("aria-checked", String(button.dataset.tool === tool));
  $("brush").hidden = tool === "focus";
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
    for await (const found of frames("loupe", { x: point[0], y: point[1], width: 256 * dense, height: 256 * dense }, looking.signal)) {
      if (!found.header.bytes) continue;
      loupe.width = found.header.width;
      loupe.height = found.header.height;
      draw(loupe, found);
      loupe.dataset.stage = found.header.stage;
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

// While a slider is dragged the next change is near.
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
  } else if ((event.key === "Enter" || event.key === " ") && now.cursor) {
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
  const overlays = { d: "depth", p: "focus", c: "confidence" };
  if (tools[key]) pick(tools[key]);
  else if (overlays[key]) {
    const select = $("overlay-kind");
    select.value = select.value === overlays[key] ? "" : overlays[key];
    showOverlay();
  } else if (key === "l") toggleLoupe();
});

// ---- export, words, files

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
$("map").addEventListener("change", () => $("map").files[0] && take([...$("map").files], $("role").value));
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

// ---- beginning

let resized = 0;
new ResizeObserver(() => {
  clearTimeout(resized);
  resized = setTimeout(() => {
    if (!now.state?.open) return;
    const was = result.width;
    const { width } = sheet.getBoundingClientRect();
    const room = stage.getBoundingClientRect();
    const factor = Math.min((room.width - 4) / now.state.width, (room.height - 4) / now.state.height);
    if (Math.abs(width - now.state.width * factor) > 2 || !was) {
      fit();
      ask();
    }
  }, 150);
}).observe(stage);

// Another page of the same studio may have changed what is open.
addEventListener("focus", safely(async () => {
  const state = await get("state");
  const changed = JSON.stringify([state.settings, state.version, state.name]) !== JSON.stringify([now.state?.settings, now.state?.version, now.state?.name]);
  if (state.open && !running && changed) await opened(state);
}));

safely(async () => {
  contextOf(result); // with the space of the picture
  const [panels, presets, state] = await Promise.all([get("panels"), get("presets"), get("state")]);
  makePanels($("panels"), panels, (changes, event) => ask({ changes, event }));
  showPresets($("presets"), presets, (preset, event) => ask({ preset, event }));
  await opened(state);
  document.body.dataset.ready = "yes";
})();
