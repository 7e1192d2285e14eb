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

/** Return whether the numbers are within their bounds, and report errors beside their controls. */
function sound() {
  const { validity, validationMessage, value, min, max } = form.elements.gamma;
  blame("gamma", validity.valid ? "" : value === "" ? `expected a number from ${min} to ${max}` : validationMessage);
  return validity.valid;
}

/** Show the values of the sliders. */
function showNumbers() {
  const { K, focus } = numbers();
  document.querySelector("[data-shown=K]").textContent = `${K} pixels`;
  document.querySelector("[data-shown=focus]").textContent = focus.toFixed(2);
}

/** Set a slider, whose range grows to hold the value. */
function setSlider(name, value) {
  const slider = form.elements[name];
  slider.max = Math.max(slider.max, value);
  slider.value = value;
  showNumbers();
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

const chosen = {};

/** Take a file for one of both places, and open both as soon as they are there. */
function choose(name, file) {
  chosen[name] = file;
  blame(name, "");
  const label = { photo: "Photo", disparity: "Depth map" }[name];
  document.querySelector(`[data-of=${name}]`).textContent = file.name ? `${label}: ${file.name}` : `Another ${label.toLowerCase()}`;
  if (chosen.photo && chosen.disparity) open(chosen.photo, chosen.disparity);
  else status.textContent = chosen.photo ? "Now its depth map." : "Now the photo.";
}

const isMap = (file) => /depth|disp|map/i.test(file.name);

/** Take dropped files: of two, the map is the one that is named so, else the second. */
function drop(files) {
  if (files.length >= 2) {
    const [photo, disparity] = isMap(files[0]) && !isMap(files[1]) ? [files[1], files[0]] : files;
    delete chosen.disparity; // open once, with both
    choose("photo", photo);
    choose("disparity", disparity);
  } else if (files.length) choose(chosen.photo && (!chosen.disparity || isMap(files[0])) ? "disparity" : "photo", files[0]);
}

async function openAddresses(photo, disparity) {
  const fetched = [photo, disparity].map(async (address) => {
    const response = await fetch(address);
    if (!response.ok) throw new Error(`expected a picture at ${address}, the host answers ${response.status}`);
    return response.blob();
  });
  try {
    const [one, other] = await Promise.all(fetched);
    delete chosen.disparity;
    choose("photo", one);
    choose("disparity", other);
  } catch (error) {
    fail(error.message);
  }
}

worker.onmessage = ({ data }) => {
  if (data.provider) {
    document.body.dataset.provider = data.provider;
    if (data.why) tell(`${data.why}: WebAssembly does the work, on the processor.`);
  } else if (data.opened) {
    opened = { ...opening, ...data.opened };
    ready = false;
    document.querySelector("#controls").inert = false;
    form.elements.K.max = Math.max(60, Math.round(data.opened.width / 10), numbers().K);
    const { width, height, photo, disparity } = opened;
    const small = Math.min(1, SMALL / Math.max(width, height));
    const size = { width: Math.round(width * small), height: Math.round(height * small) };
    previewer.postMessage({ open: { photo, disparity, ...size, full: width } });
    render();
  } else if (data.focus !== undefined) {
    setSlider("focus", data.focus.toFixed(3));
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
  showNumbers();
  follow();
});

form.addEventListener("submit", (event) => event.preventDefault());

for (const name of ["photo", "disparity"]) {
  const input = form.elements[name];
  input.addEventListener("click", () => (input.value = "")); // the same file can be chosen again
  input.addEventListener("change", () => input.files[0] && choose(name, input.files[0]));
}

const zone = document.querySelector("#files");
document.addEventListener("dragover", (event) => {
  event.preventDefault();
  zone.classList.add("over");
});
document.addEventListener("dragleave", () => zone.classList.remove("over"));
document.addEventListener("drop", (event) => {
  event.preventDefault();
  zone.classList.remove("over");
  drop([...event.dataTransfer.files]);
});
document.querySelector("#sample").addEventListener("click", () => openAddresses("demo.png", "demo_disparity.png"));

for (const name of ["K", "focus"]) setSlider(name, Number(given.get(name) ?? form.elements[name].value));
if (given.has("gamma")) form.elements.gamma.value = given.get("gamma");
if (given.has("photo") && given.has("disparity")) await openAddresses(given.get("photo"), given.get("disparity"));
