// The page around the renderer: files or, with ?photo=URL&disparity=URL&K=38&focus=0.46, addresses. All work is
// done by worker.js; here pictures are put on the canvas as they come.

const form = document.querySelector("form");
const status = document.querySelector("#status");
const bar = document.querySelector("progress");
const save = document.querySelector("#save");
const canvas = document.querySelector("canvas");
const context = canvas.getContext("2d");
const given = new URLSearchParams(location.search);
const worker = new Worker("worker.js", { type: "module" });
let asked = 0;
let opened = false;

worker.postMessage({ model: given.get("model") ?? "fast.onnx" });

/** Ask for the picture by the numbers in the form; what was asked for before is given up. */
function render() {
  if (!opened) return;
  const entries = ["K", "focus", "gamma"].map((name) => [name, Number(form.elements[name].value)]);
  worker.postMessage({ id: ++asked, numbers: Object.fromEntries(entries) });
  bar.hidden = false;
  bar.value = 0;
  save.hidden = true;
  status.textContent = "Rendering ...";
}

function open(photo, disparity) {
  opened = true;
  worker.postMessage({ open: { photo, disparity } });
  render();
}

worker.onmessage = ({ data }) => {
  if (data.opened) {
    [canvas.width, canvas.height] = [data.opened.width, data.opened.height];
  } else if (data.focus !== undefined) {
    form.elements.focus.value = data.focus.toFixed(3);
    render();
  } else if (data.tile) {
    context.drawImage(data.tile, data.x, data.y);
    data.tile.close();
    if (data.id === asked) bar.value = data.share;
  } else if (data.id === asked && data.done) {
    URL.revokeObjectURL(save.href);
    save.href = URL.createObjectURL(data.done);
    save.hidden = false;
    bar.hidden = true;
    status.textContent = `${canvas.width}x${canvas.height} in ${data.seconds.toFixed(1)} s`;
  } else if (data.error) {
    bar.hidden = true;
    status.textContent = `Failed: ${data.error}`;
  }
};

worker.onerror = (event) => {
  bar.hidden = true;
  status.textContent = `Failed: ${event.message || "the browser cannot run module workers"}`;
};

canvas.addEventListener("click", (event) => {
  const box = canvas.getBoundingClientRect();
  const [x, y] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  if (opened) worker.postMessage({ focusAt: { x, y } });
});

form.addEventListener("submit", (event) => {
  event.preventDefault();
  const [photo, disparity] = ["photo", "disparity"].map((name) => form.elements[name].files[0]);
  if (photo && disparity) open(photo, disparity);
  else if (opened) render();
  else status.textContent = "Choose a photo and its disparity first.";
});

if (!crossOriginIsolated) {
  document.querySelector("#told").textContent =
    "This server does not send the headers for threads: one core does all the work.";
}

if (given.has("photo") && given.has("disparity")) {
  for (const name of ["K", "focus", "gamma"]) if (given.has(name)) form.elements[name].value = given.get(name);
  const fetched = ["photo", "disparity"].map(async (name) => (await fetch(given.get(name))).blob());
  open(...(await Promise.all(fetched)));
}
