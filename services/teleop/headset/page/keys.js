// Keyboard and buttons. Keys are named as in the keyboard operator; the server decides what they do.

const NAMES = {
  " ": "space", ArrowUp: "up", ArrowDown: "down", ArrowLeft: "left", ArrowRight: "right",
  Enter: "Enter", Backspace: "Backspace", Delete: "Delete",
};
const STOPS = new Set(["x", "X", "Backspace", "Delete"]);
const REPEATED = new Set([..."ikjluotyfvzcnm", "up", "down", "left", "right"]);
const FIRST_REPEAT = 300, REPEAT = 80; // ms, of a button that is held

export class Keys {
  /** @param {(key: string) => void} send */
  constructor(send) {
    this.send = send;
    addEventListener("keydown", (event) => this.#down(event));
    for (const button of document.querySelectorAll("button[data-key]")) this.#bind(button);
  }

  #down(event) {
    const key = NAMES[event.key] ?? this.#letter(event);
    if (!key) return;
    const stops = STOPS.has(key);
    // A button that has the focus is pressed by these two.
    const presses = event.target instanceof HTMLButtonElement && (key === "Enter" || key === "space");
    if (!stops && (presses || event.ctrlKey || event.metaKey || event.altKey)) return;
    event.preventDefault();
    if (event.repeat && !REPEATED.has(key)) return;
    this.send(key);
  }

  /** The letter of a key; in layouts of other scripts that of its place on the keyboard. */
  #letter({ key, code }) {
    if (key.length !== 1) return null;
    if (/^[\x21-\x7e]$/.test(key)) return key.toLowerCase();
    const placed = /^(?:Key([A-Z])|Digit([0-9]))$/.exec(code);
    return placed ? (placed[1] ?? placed[2]).toLowerCase() : null;
  }

  #bind(button) {
    const { key } = button.dataset;
    // Otherwise Enter and space would press a button that was clicked, and not take or pause.
    button.addEventListener("pointerup", () => button.blur());
    if (!("repeats" in button.dataset)) {
      button.addEventListener("click", () => this.send(key));
      return;
    }
    let timer = 0;
    const stop = () => { clearTimeout(timer); timer = 0; };
    const repeat = () => { this.send(key); timer = setTimeout(repeat, REPEAT); };
    button.addEventListener("pointerdown", () => {
      this.send(key);
      timer = setTimeout(repeat, FIRST_REPEAT);
    });
    for (const end of ["pointerup", "pointerleave", "pointercancel", "blur"]) button.addEventListener(end, stop);
    // A click without a pointer comes from the keyboard or from an assistive tool.
    button.addEventListener("click", ({ detail }) => { if (detail === 0) this.send(key); });
  }
}
