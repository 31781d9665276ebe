// Browsers start no worker for a page that is opened from a folder (file:); the search then runs in a hidden frame instead.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.waiting = [];
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.appendChild(frame);
      this.inside = frame.contentWindow;
      this.inside.answer = data => {
        const event = new MessageEvent("message", { data });
        this.dispatchEvent(event);
        if (this.onmessage) this.onmessage(event);
      };
      this.inside.ready = () => { for (const data of this.waiting.splice(0)) this.send(data); this.loaded = true; };
      this.inside.document.open();
      this.inside.document.write(`<script>
        window.postMessage = data => answer(data);
        window.importScripts = (...urls) => Promise.all(urls.map(url => new Promise((done, failed) => {
          const script = document.createElement("script");
          Object.assign(script, { src: new URL(url, ${JSON.stringify(String(url))}).href, onload: done, onerror: failed });
          document.head.appendChild(script);
        })));
      <\/script><script src="${url}" onload="ready()"><\/script>`);
      this.inside.document.close();
    }
    send(data) { this.inside.dispatchEvent(new MessageEvent("message", { data })); }
    postMessage(data) { this.loaded ? this.send(data) : this.waiting.push(data); }
    terminate() { this.inside.frameElement.remove(); }
  };
}
