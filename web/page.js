// The page around the renderer: files or, with ?photo=URL&disparity=URL&K=38&focus=0.46, addresses. All work is
// done by worker.js and preview.js, which draw on the page's canvases themselves.

const form = document.querySelector("form");
const status = document.querySelector("#status");
const notice = document.querySelector("#notice");
const bar = document.querySelector("progress");
const save = document.querySelector("#save");
const result = document.querySelector("#result");
const quick = document.querySelector("#preview");
const query = new URLSearchParams(location.search);

/** Say what this browser gives less than all. */
function report(line) {
  if (!notice.textContent.includes(line)) notice.append(`${line} `);
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
if (!crossOriginIsolated) report("This browser gives the page no threads: one core does all the work.");

const worker = new Worker("worker.js", { type: "module" });
const previewer = new Worker("preview.js", { type: "module" });

// Milliseconds without a change after which the renderer begins; largest side of the quick picture.
const REST = 400;
const SMALL = 640;

let requests = 0;
let opened = null;
let opening = null;
let ready = false;
let resting = 0;
window.previews = 0;

function begin(target, canvas, more = {}) {
  const theirs = canvas.transferControlToOffscreen();
  target.postMessage({ canvas: theirs, ...more }, [theirs]);
}

/** Load a renderer by its address; the rays look farther around a tile than the others. */
const renderer = (model) => ({ model, rays: /rays/.test(model), provider: query.get("provider") ?? "auto" });
const { quality } = form.elements;
quality.closest("p").hidden = query.has("model");
begin(worker, result, renderer(query.get("model") ?? quality.value));
const { sharpen } = form.elements;
fetch("repair.onnx", { method: "HEAD" }).then(({ ok }) => (sharpen.closest("p").hidden = !ok), () => {});
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

/** Request the picture of the numbers in the form; earlier requests are abandoned. */
function render() {
  if (!opened || !sound()) return;
  clearTimeout(resting);
  resting = 0;
  worker.postMessage({ id: ++requests, numbers: numbers() });
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
  else status.textContent = chosen.photo ? "Now its depth map, or estimate it." : "Now the photo.";
  document.querySelector("#without").open = !chosen.disparity;
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

// Network whose address the page offers; its bytes are checked. Other addresses are used as they are.
const NETWORK = {
  address:
    "https://huggingface.co/onnx-community/depth-anything-v2-small/resolve/4472b7362082ad9968fee890ca0f1e5aca36b93d/onnx/model.onnx",
  sha256: "afb6a5c28f3b6bf1618c6e43f02073ef9dfdc70e937502d51603e57b0a1df10c",
  about: "Depth Anything V2 Small, 99 MB, Apache-2.0. The photo stays here. Any network in which near is large will do.",
};
const download = document.querySelector("#download");
let stop = null;

/** Estimate the depth of the photo; `bytes` of a network replace the one of an earlier estimate. */
function estimate(bytes) {
  blame("network", "");
  if (!chosen.photo) return blame("network", "choose a photo first");
  status.textContent = "Estimating depth ...";
  worker.postMessage({ estimate: { photo: chosen.photo, bytes } }, bytes ? [bytes] : []);
}

/** Return the bytes behind an address and show the progress. */
async function fetched(address, signal) {
  const response = await fetch(address, { signal });
  if (!response.ok) throw new Error(`expected a network at this address, the host answers ${response.status}`);
  const total = Number(response.headers.get("content-length")), parts = [];
  let size = 0;
  for (const reader = response.body.getReader(); ; ) {
    const { done, value } = await reader.read();
    if (done) break;
    parts.push(value);
    size += value.length;
    status.textContent = `Downloading ${(size / 1e6).toFixed(0)}${total ? ` of ${(total / 1e6).toFixed(0)}` : ""} MB ...`;
  }
  return new Blob(parts).arrayBuffer();
}

/** Raise an error unless the bytes are those of the offered network. */
async function checkHash(bytes) {
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
  const hex = [...digest].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  if (hex !== NETWORK.sha256) throw new Error(`expected SHA-256 ${NETWORK.sha256.slice(0, 12)}..., found ${hex.slice(0, 12)}...`);
}

download.addEventListener("click", async () => {
  if (stop) return stop.abort();
  if (!chosen.photo) return blame("network", "choose a photo first");
  const { address } = form.elements;
  if (!address.value || !address.validity.valid) return blame("network", "expected an address such as https://host/model.onnx");
  blame("network", "");
  stop = new AbortController();
  download.textContent = "Stop";
  try {
    const bytes = await fetched(address.value, stop.signal);
    if (address.value === NETWORK.address) await checkHash(bytes);
    estimate(bytes);
  } catch (error) {
    const why = error.name === "AbortError" ? "stopped; nothing was kept" : `not downloaded: ${error.message}`;
    blame("network", why);
    status.textContent = "Now its depth map.";
  } finally {
    stop = null;
    download.textContent = "Download";
  }
});

document.querySelector("#estimate").addEventListener("click", () => estimate());
form.elements.address.value = NETWORK.address;
document.querySelector("#about").textContent = NETWORK.about;

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
    if (data.why) report(`${data.why}: WebAssembly does the work, on the processor.`);
  } else if (data.estimated) {
    document.querySelector("#estimate").hidden = false;
    choose("disparity", new File([data.estimated], "estimated", { type: "image/png" }));
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
  } else if (data.share !== undefined && data.id === requests) {
    bar.value = data.share;
  } else if (data.done && data.id === requests) {
    URL.revokeObjectURL(save.href);
    save.href = URL.createObjectURL(data.done);
    save.hidden = false;
    bar.hidden = quick.hidden = true;
    status.textContent = `${opened.width}x${opened.height} in ${data.seconds.toFixed(1)} s`;
  } else if (data.notice) {
    report(data.notice);
  } else if (data.error) {
    if (data.of) {
      blame(data.of, data.error);
      if (data.of !== "network") opening = null;
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
  if (data.error) report(`No quick picture while you drag: ${data.error}.`);
};

result.addEventListener("click", (event) => {
  const box = result.getBoundingClientRect();
  const [x, y] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  if (opened) worker.postMessage({ focusAt: { x, y } });
});

form.addEventListener("input", ({ target }) => {
  if (target.type === "file") return;
  if (target === quality) worker.postMessage(renderer(quality.value));
  if (target === sharpen) worker.postMessage({ sharpen: sharpen.checked });
  showNumbers();
  follow();
});

form.addEventListener("submit", (event) => event.preventDefault());

for (const name of ["photo", "disparity", "network"]) {
  const input = form.elements[name];
  input.addEventListener("click", () => (input.value = "")); // the same file can be chosen again
  input.addEventListener("change", async () => {
    const [file] = input.files;
    if (file) name === "network" ? estimate(await file.arrayBuffer()) : choose(name, file);
  });
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

for (const name of ["K", "focus"]) setSlider(name, Number(query.get(name) ?? form.elements[name].value));
if (query.has("gamma")) form.elements.gamma.value = query.get("gamma");
if (query.has("photo") && query.has("disparity")) await openAddresses(query.get("photo"), query.get("disparity"));
