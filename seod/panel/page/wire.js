// The WebSocket: questions and answers, notifications, binary blocks (seod/panel/wire.py), and coming back.

export const LIVE = 1, SWEEP = 2, ANSWER = 3;
const HEAD = 32;
const AGAIN_MS = 400;
const ANSWER_MS = 30000;

export class Wire {
  constructor(about) {
    this.about = about;
    this.waiting = new Map();
    this.asked = new Map();
    this.heard = new Map();
    this.number = 0;
    this.onBlocks = () => {};
    this.onOpen = () => {};
    this.onClose = () => {};
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws`, ["seod.panel.1", `csrf.${this.about.csrf}`]);
    socket.binaryType = "arraybuffer";
    this.opened = false;
    socket.onopen = () => { this.opened = true; this.socket = socket; this.onOpen(); };
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = () => this.closed();
  }

  closed() {
    const was = this.socket;
    this.socket = null;
    for (const { reject } of this.waiting.values()) reject(new Error("the connection to the panel is lost"));
    this.waiting.clear();
    if (was) this.onClose();
    setTimeout(() => this.renew(), AGAIN_MS);
  }

  // A panel that was started again knows no old session: then the page is loaded anew, or asks for the token.
  async renew() {
    try {
      const answer = await fetch("/api/about");
      if (answer.status === 401) { location.assign("/"); return; }
      Object.assign(this.about, await answer.json());
    } catch (error) { setTimeout(() => this.renew(), AGAIN_MS); return; }
    this.open();
  }

  take(data) {
    if (typeof data !== "string") { this.takeBlocks(data); return; }
    const message = JSON.parse(data);
    if (message.method) {
      for (const hear of this.heard.get(message.method) || []) hear(message.params);
      return;
    }
    const asked = this.waiting.get(message.id);
    this.waiting.delete(message.id);
    if (!asked) return;
    clearTimeout(asked.timer);
    if (message.error !== undefined) asked.reject(new Error(message.error));
    else asked.resolve(message.result);
  }

  takeBlocks(buffer) {
    const view = new DataView(buffer), shown = [];
    for (let at = 0; at + HEAD <= buffer.byteLength;) {
      const rows = view.getUint16(at + 2, true), columns = view.getUint32(at + 4, true);
      const block = {
        kind: view.getUint8(at), axis: view.getUint8(at + 1), rows, columns,
        number: view.getUint32(at + 8, true), start: view.getFloat64(at + 16, true), step: view.getFloat64(at + 24, true),
        table: new Float32Array(buffer, at + HEAD, rows * columns),
      };
      at += HEAD + 4 * rows * columns;
      const asked = block.kind === ANSWER && this.asked.get(block.number);
      if (asked) { this.asked.delete(block.number); asked(block); } else shown.push(block);
    }
    if (shown.length) this.onBlocks(shown);
  }

  hear(topic, what) {
    if (!this.heard.has(topic)) this.heard.set(topic, []);
    this.heard.get(topic).push(what);
  }

  ask(method, params = {}) {
    if (!this.socket) return Promise.reject(new Error("there is no connection to the panel"));
    const id = ++this.number;
    this.socket.send(JSON.stringify({ id, method, params }));
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => {
        this.waiting.delete(id);
        reject(new Error(`${method} was not answered`));
      }, ANSWER_MS);
      this.waiting.set(id, { resolve, reject, timer });
    });
  }

  // A part of the past, as a block.
  history(axis, start, end, columns) {
    const number = ++this.number;
    return new Promise((resolve, reject) => {
      this.asked.set(number, resolve);
      this.ask("history", { axis, start, end, columns, number }).catch((error) => {
        this.asked.delete(number);
        reject(error);
      });
    });
  }
}

// Requests over HTTP that change something say that they come from this page.
export async function request(about, method, path, body) {
  const answer = await fetch(path, {
    method, body: body === undefined ? undefined : JSON.stringify(body),
    headers: { "x-seod-csrf": about.csrf, "content-type": "application/json" },
  });
  const text = await answer.text();
  let said;
  try { said = JSON.parse(text); } catch (error) { said = { error: text }; }
  if (!answer.ok) throw new Error(said.error || answer.statusText);
  return said;
}
