// Banner over a picture without depth: estimate it, open a map, or paint.

import { get, post } from "./api.js";

const $ = (id) => document.getElementById(id);

/** Connect the buttons; `estimating` is called once an estimate has begun. */
export function makeBanner({ safely, paint, estimating }) {
  const begin = safely(async (agreed) => {
    ask("");
    await post("estimate", { agreed });
    estimating();
  });
  $("estimate").addEventListener("click", safely(async () => {
    const offer = await get("offer");
    if (!offer.available) ask(`Depth cannot be estimated here: ${offer.reason}`);
    else if (offer.cached) await begin(true);
    else ask(offer.text, offer.size);
  }));
  $("agree").addEventListener("click", () => begin(true));
  $("decline").addEventListener("click", () => ask(""));
  $("paint").addEventListener("click", paint);
}

/** Show a question or message; `size` of a download adds the buttons for consent. */
function ask(text, size = "") {
  $("offer").hidden = !text;
  $("offer-text").textContent = text;
  $("agree").textContent = `Download ${size} and estimate`;
  $("agree").hidden = $("decline").hidden = !size;
}

/** Show the banner if the picture has no depth, and disable the controls that then do nothing. */
export function showBanner(state) {
  const missing = Boolean(state.open && state.flat && !state.strokes);
  $("banner").hidden = !missing;
  for (const id of ["quick", "presets"]) $(id).toggleAttribute("inert", missing);
  $("export").disabled = missing;
  return missing;
}

/** Show the progress of an estimate. */
export function showEstimate(job) {
  const running = job.state === "running";
  for (const id of ["estimate", "paint"]) $(id).disabled = running;
  $("estimate").textContent = running ? `Estimating depth, ${Math.round(100 * job.share)} % …` : "Estimate depth";
  if (job.state === "failed") ask(job.error);
}
