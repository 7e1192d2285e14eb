// Adds the two headers that a browser asks for before it shares memory between threads, where the host that has
// these files cannot be configured to send them: a service worker between the page and the host.

addEventListener("install", () => skipWaiting());
addEventListener("activate", (event) => event.waitUntil(clients.claim()));

async function isolated(request) {
  const answer = await fetch(request);
  if (answer.status === 0) return answer; // of another origin, closed
  const headers = new Headers(answer.headers);
  headers.set("Cross-Origin-Opener-Policy", "same-origin");
  headers.set("Cross-Origin-Embedder-Policy", "require-corp");
  headers.set("Cross-Origin-Resource-Policy", "same-origin");
  return new Response(answer.body, { status: answer.status, statusText: answer.statusText, headers });
}

addEventListener("fetch", (event) => {
  if (event.request.cache !== "only-if-cached" || event.request.mode === "same-origin") {
    event.respondWith(isolated(event.request));
  }
});
