// Connection to the server: messages with this page's clock, reconnection, round trip time.

const ALIVE_PERIOD = 100; // ms, well below the server's limit of silence
const LONGEST_WAIT = 2000; // ms between two attempts to connect
const FULL = 16384; // bytes that wait in the browser; above it samples are left out

export class Link {
  /** @param {{token: string, onStatus: Function, onPicture: Function, onChange: Function}} options */
  constructor(options) {
    this.options = options;
    this.roundTrips = [];
    this.wait = 300;
    this.lastSent = 0;
    this.socket = null;
    this.hidden = document.hidden;
    this.echoed = -1;
    setInterval(() => this.#beat(), ALIVE_PERIOD);
    document.addEventListener("visibilitychange", () => this.#look(!document.hidden));
    addEventListener("pagehide", () => this.#look(false));
    addEventListener("pageshow", () => this.#look(!document.hidden));
    this.#connect();
  }

  /** Median round trip of the last seconds [ms]; NaN before the first. */
  get roundTrip() {
    const sorted = [...this.roundTrips].sort((a, b) => a - b);
    return sorted.length ? sorted[sorted.length >> 1] : NaN;
  }

  get open() { return this.socket?.readyState === WebSocket.OPEN; }

  /** Send a message; returns whether it was sent. Samples are left out while the link is full. */
  send(type, fields = {}) {
    if (!this.open || (type === "sample" && this.socket.bufferedAmount > FULL)) return false;
    this.lastSent = performance.now();
    this.socket.send(JSON.stringify({ type, t: this.lastSent, ...fields }));
    return true;
  }

  #look(visible) {
    if (this.hidden === !visible) return;
    this.hidden = !visible;
    this.send(visible ? "alive" : "away");
  }

  #beat() {
    // A page that nobody sees must not keep the robot.
    if (!this.hidden && performance.now() - this.lastSent > 0.8 * ALIVE_PERIOD) this.send("alive");
  }

  #connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/socket?token=${encodeURIComponent(this.options.token)}`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    let opened = false;
    socket.onopen = () => {
      opened = true;
      this.wait = 300;
      this.roundTrips.length = 0;
      this.options.onChange("connected");
      this.send(this.hidden ? "away" : "alive");
    };
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.#status(JSON.parse(data));
      else this.options.onPicture(data, performance.now());
    };
    socket.onclose = async ({ code, reason }) => {
      const text = opened ? `lost (${reason || code})` : await this.#whyNot();
      this.options.onChange(text);
      setTimeout(() => this.#connect(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
    };
  }

  #status(status) {
    const echo = status.you.echo;
    if (echo && echo.t !== this.echoed) {
      this.echoed = echo.t;
      this.roundTrips.push(Math.max(0, performance.now() - echo.t - echo.held));
      if (this.roundTrips.length > 40) this.roundTrips.shift();
    }
    this.options.onStatus(status);
  }

  /** A refused WebSocket does not say why; the same request as a POST does. */
  async #whyNot() {
    try {
      const path = `/socket?token=${encodeURIComponent(this.options.token)}`;
      const answer = await fetch(path, { method: "POST", cache: "no-store" });
      return answer.status === 204 ? "connecting" : await answer.text();
    } catch {
      return "the server does not answer";
    }
  }
}
