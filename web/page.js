// The page around the renderer: files or, with ?photo=URL&disparity=URL&K=38&focus=0.46, addresses. All work is
// done by worker.js and preview.js, which draw on the page's canvases themselves.

const form = document.querySelector("form");
const status = document.querySelector("#status");
const told = document.querySelector("#told");
const bar = document.querySelector("progress");
const save = document.querySelector("#save");
const result = document.querySelector("#result");
const quick = document.querySelector("#preview");
const given = new URLSearchParams(location.search);

/** Say what this browser gives less than all. */
function tell(line) {
  told.append(`${line} `);
}

/** Say beside a control what is wrong with it; "" where nothing is. */
function blame(name, line) {
  document.querySelector(`[data-fault="${name}"]`).textContent = line;
}

function fail(line) {
  bar.hidden = true;
  status.textContent = `Failed: ${line}`;
}

if (!result.transferControlToOffscreen) {
  fail("this browser cannot draw beside the page (OffscreenCanvas), as those since 2023 can");
  throw new Error(status.textContent);
}

// Threads need two headers; where the host does not send them, isolate.js adds them, once it has the page.
if (!crossOriginIsolated && navigator.serviceWorker && !sessionStorage.getItem("isolating")) {
  sessionStorage.setItem("isolating", "yes"); // once, lest the page loads for ever
  const there = navigator.serviceWorker.register("isolate.js").then(() => navigator.serviceWorker.ready, () => null);
  await Promise.race([there, new Promise((resolve) => setTimeout(resolve, 5000))]); // some browsers never answer
  location.reload();
  await new Promise(() => {});
}
if (!crossOriginIsolated) tell("This browser gives the page no threads: one core does all the work.");

const worker = new Worker("worker.js", { type: "module" });
const previewer = new Worker("preview.js", { type: "module" });

// Milliseconds without a change after which the renderer begins; largest side of the quick picture.
const REST = 400;
const SMALL = 640;

let asked = 0;
let opened = null;
let opening = null;
let ready = false;
let resting = 0;
window.previews = 0;

function begin(target, canvas, more = {}) {
  const theirs = canvas.transferControlToOffscreen();
  target.postMessage({ canvas: theirs, ...more }, [theirs]);
}
begin(worker, result, { model: given.get("model") ?? "fast.onnx", provider: given.get("provider") ?? "auto" });
begin(previewer, quick);

const NUMBERS = ["K", "focus", "gamma"];
const numbers = () => Object.fromEntries(NUMBERS.map((name) => [name, Number(form.elements[name].value)]));

/** Whether all numbers are within their bounds; what is not is told beside its control. */
function sound() {
  for (const name of NUMBERS) {
    const { validity, validationMessage, value, min, max } = form.elements[name];
    blame(name, validity.valid ? "" : value === "" ? `expected a number from ${min} to ${max}` : validationMessage);
  }
  return NUMBERS.every((name) => form.elements[name].validity.valid);
}

/** Ask for the picture by the numbers in the form; what was asked for before is given up. */
function render() {
  if (!opened || !sound()) return;
  clearTimeout(resting);
  resting = 0;
  worker.postMessage({ id: ++asked, numbers: numbers() });
  bar.hidden = false;
  bar.value = 0;
  save.hidden = true;
  status.textContent = "Rendering ...";
}

/** Show a quick picture, and ask for the renderer's once the hand rests. */
function follow() {
  if (!sound() || !opened) return;
  if (ready) previewer.postMessage({ numbers: numbers() });
  clearTimeout(resting);
  resting = setTimeout(render, REST);
}

/** Open files; the picture that is there stays until both are read. */
function open(photo, disparity) {
  for (const name of ["photo", "disparity"]) blame(name, "");
  opening = { photo, disparity };
  status.textContent = "Opening ...";
  worker.postMessage({ open: opening });
}

function showSliders() {
  for (const slider of document.querySelectorAll("[data-of]")) slider.value = form.elements[slider.dataset.of].value;
}

worker.onmessage = ({ data }) => {
  if (data.provider) {
    document.body.dataset.provider = data.provider;
    if (data.why) tell(`${data.why}: WebAssembly does the work, on the processor.`);
  } else if (data.opened) {
    opened = { ...opening, ...data.opened };
    ready = false;
    const { width, height, photo, disparity } = opened;
    const small = Math.min(1, SMALL / Math.max(width, height));
    const size = { width: Math.round(width * small), height: Math.round(height * small) };
    previewer.postMessage({ open: { photo, disparity, ...size, full: width } });
    render();
  } else if (data.focus !== undefined) {
    form.elements.focus.value = data.focus.toFixed(3);
    showSliders();
    if (ready) previewer.postMessage({ numbers: numbers() });
    render();
  } else if (data.share !== undefined && data.id === asked) {
    bar.value = data.share;
  } else if (data.done && data.id === asked) {
    URL.revokeObjectURL(save.href);
    save.href = URL.createObjectURL(data.done);
    save.hidden = false;
    bar.hidden = quick.hidden = true;
    status.textContent = `${opened.width}x${opened.height} in ${data.seconds.toFixed(1)} s`;
  } else if (data.told) {
    tell(data.told);
  } else if (data.error) {
    if (data.of) {
      blame(data.of, data.error);
      opening = null;
    }
    fail(data.error);
  }
};

worker.onerror = (event) => fail(event.message || "the browser cannot run module workers");

previewer.onmessage = ({ data }) => {
  if (data.ready) ready = true;
  if (data.drawn) {
    window.previews += 1;
    window.preview = data;
    quick.hidden = bar.hidden && !resting;
  }
  if (data.error) tell(`No quick picture while you drag: ${data.error}.`);
};

result.addEventListener("click", (event) => {
  const box = result.getBoundingClientRect();
  const [x, y] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  if (opened) worker.postMessage({ focusAt: { x, y } });
});

form.addEventListener("input", ({ target }) => {
  if (target.type === "file") return;
  if (target.dataset.of) form.elements[target.dataset.of].value = target.value;
  else showSliders();
  follow();
});

form.addEventListener("submit", (event) => {
  event.preventDefault();
  const [photo, disparity] = ["photo", "disparity"].map((name) => form.elements[name].files[0]);
  if (photo && disparity && (photo !== opening?.photo || disparity !== opening?.disparity)) open(photo, disparity);
  else if (opened) render();
  else status.textContent = "Choose a photo and its disparity first.";
});

if (given.has("photo") && given.has("disparity")) {
  for (const name of ["K", "focus", "gamma"]) if (given.has(name)) form.elements[name].value = given.get(name);
  showSliders();
  const fetched = ["photo", "disparity"].map(async (name) => (await fetch(given.get(name))).blob());
  open(...(await Promise.all(fetched)));
}
