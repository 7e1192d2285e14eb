// Browsers refuse workers on pages that are opened from the disk. There, a hidden frame runs the script of
// a worker instead, so that the search of the site works without a server. Elsewhere this file does nothing.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    #frame = document.createElement("iframe");
    #isLoaded = false;
    #waiting = [];

    constructor(address) {
      super();
      this.#frame.hidden = true;
      document.body.append(this.#frame);
      const inside = this.#frame.contentWindow;
      inside.postMessage = (data) => this.#emit(this, data);
      const script = inside.document.createElement("script");
      script.src = new URL(address, location.href).href;
      script.onload = () => {
        this.#isLoaded = true;
        for (const data of this.#waiting.splice(0)) this.#emit(inside, data);
      };
      script.onerror = () => this.dispatchEvent(new Event("error"));
      inside.document.body.append(script);
    }

    set onmessage(listener) {
      this.addEventListener("message", listener);
    }

    postMessage(data) {
      if (this.#isLoaded) this.#emit(this.#frame.contentWindow, data);
      else this.#waiting.push(data);
    }

    terminate() {
      this.#frame.remove();
    }

    // Messages arrive later, as those of a worker do.
    #emit(target, data) {
      setTimeout(() => target.dispatchEvent(new MessageEvent("message", { data })), 0);
    }
  };
}
