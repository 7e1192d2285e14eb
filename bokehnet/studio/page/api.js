// Talking to the studio's server: JSON, and pictures as frames of a JSON header and pixels.

const wide = matchMedia("(color-gamut: p3)").matches && hasWideCanvas();

export const space = wide ? "display-p3" : "srgb";
export const client = crypto.randomUUID();

function hasWideCanvas() {
  try {
    const context = document.createElement("canvas").getContext("2d", { colorSpace: "display-p3" });
    return context.getContextAttributes().colorSpace === "display-p3";
  } catch {
    return false;
  }
}

/** An error that the server told, with the setting that caused it. */
export class Told extends Error {
  constructor(message, path = "") {
    super(message);
    this.path = path;
  }
}

async function checked(response) {
  if (response.ok) return response;
  let found = {};
  try {
    found = await response.json();
  } catch {
    // the guard answers in plain text
  }
  throw new Told(found.error || `the studio answered ${response.status}`, found.path || "");
}

const STOPPED = "The studio has stopped. Start it again, and reload the page with its new address.";

/** What the network gives; where it gives nothing any more, the studio has stopped. */
async function arrived(given) {
  try {
    return await given;
  } catch (error) {
    throw error.name === "AbortError" ? error : new Told(STOPPED);
  }
}

const reached = (address, options) => arrived(fetch(address, options));

export async function get(name) {
  return (await checked(await reached(`api/${name}`))).json();
}

export async function post(name, body = {}) {
  const options = { method: "POST", body: JSON.stringify(body), headers: { "content-type": "application/json" } };
  return (await checked(await reached(`api/${name}`, options))).json();
}

export async function upload(name, file, role) {
  const query = new URLSearchParams(role ? { name: file.name, role } : { name: file.name });
  return (await checked(await reached(`api/${name}?${query}`, { method: "POST", body: file }))).json();
}

/** Yield {header, pixels} of an answer, as they come. */
export async function* frames(name, body, signal) {
  const options = body
    ? { method: "POST", body: JSON.stringify({ client, space, ...body }), signal }
    : { signal };
  const response = await checked(await reached(`api/${name}`, options));
  const reader = response.body.getReader();
  let parts = [], held = 0;
  const take = async (count) => {
    while (held < count) {
      const { done, value } = await arrived(reader.read());
      if (done) return null;
      parts.push(value);
      held += value.length;
    }
    const joined = new Uint8Array(count);
    let at = 0;
    while (at < count) {
      const part = parts[0], used = Math.min(part.length, count - at);
      joined.set(part.subarray(0, used), at);
      at += used;
      if (used === part.length) parts.shift();
      else parts[0] = part.subarray(used);
    }
    held -= count;
    return joined;
  };
  for (;;) {
    const size = await take(4);
    if (!size) return;
    const told = await take(new DataView(size.buffer).getUint32(0, true));
    if (!told) throw new Told(STOPPED);
    const header = JSON.parse(new TextDecoder().decode(told));
    const pixels = header.bytes ? await take(header.bytes) : null;
    if (header.bytes && !pixels) throw new Told(STOPPED);
    if (header.stage === "error") throw new Told(header.error);
    yield { header, pixels };
  }
}

export async function frame(name, body, signal) {
  for await (const found of frames(name, body, signal)) return found;
  return null;
}
