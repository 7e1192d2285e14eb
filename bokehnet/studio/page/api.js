// Requests to the studio's server: JSON, and pictures as frames of a JSON header and pixels.

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

/** Error reported by the server, with the setting that caused it. */
export class ServerError extends Error {
  constructor(message, path = "") {
    super(message);
    this.path = path;
  }
}

async function checked(response) {
  if (response.ok) return response;
  let body = {};
  try {
    body = await response.json();
  } catch {
    // the guard responds in plain text
  }
  throw new ServerError(body.error || `the studio responded with status ${response.status}`, body.path || "");
}

const STOPPED = "The studio has stopped. Restart it and open its new address.";

/** Await a network operation; a failure means that the studio has stopped. */
async function fromServer(promise) {
  try {
    return await promise;
  } catch (error) {
    throw error.name === "AbortError" ? error : new ServerError(STOPPED);
  }
}

const request = (address, options) => fromServer(fetch(address, options));

export async function get(name) {
  return (await checked(await request(`api/${name}`))).json();
}

export async function post(name, body = {}) {
  const options = { method: "POST", body: JSON.stringify(body), headers: { "content-type": "application/json" } };
  return (await checked(await request(`api/${name}`, options))).json();
}

export async function upload(name, file, role) {
  const query = new URLSearchParams(role ? { name: file.name, role } : { name: file.name });
  return (await checked(await request(`api/${name}?${query}`, { method: "POST", body: file }))).json();
}

/** Yield {header, pixels} of a response as they arrive. */
export async function* frames(name, body, signal) {
  const options = body
    ? { method: "POST", body: JSON.stringify({ client, space, ...body }), signal }
    : { signal };
  const response = await checked(await request(`api/${name}`, options));
  const reader = response.body.getReader();
  let parts = [], buffered = 0;
  const take = async (count) => {
    while (buffered < count) {
      const { done, value } = await fromServer(reader.read());
      if (done) return null;
      parts.push(value);
      buffered += value.length;
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
    buffered -= count;
    return joined;
  };
  for (;;) {
    const size = await take(4);
    if (!size) return;
    const encoded = await take(new DataView(size.buffer).getUint32(0, true));
    if (!encoded) throw new ServerError(STOPPED);
    const header = JSON.parse(new TextDecoder().decode(encoded));
    const pixels = header.bytes ? await take(header.bytes) : null;
    if (header.bytes && !pixels) throw new ServerError(STOPPED);
    if (header.stage === "error") throw new ServerError(header.error);
    yield { header, pixels };
  }
}

export async function frame(name, body, signal) {
  for await (const first of frames(name, body, signal)) return first;
  return null;
}
