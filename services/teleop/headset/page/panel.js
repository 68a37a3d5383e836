// The panel in the headset: what the person has to know, drawn on a canvas.

import { whatItDoes, whoHasIt } from "./status.js";

const COLOURS = { good: "#62d089", warn: "#f2b35b", bad: "#ff6b6f", "": "#e6ebf0" };
const PERIOD = 100; // ms between two drawings

export class Panel {
  constructor() {
    this.canvas = Object.assign(document.createElement("canvas"), { width: 768, height: 240 });
    this.context = this.canvas.getContext("2d");
    this.due = 0;
    this.drawn = "";
  }

  /** Draw anew if something has changed; returns whether it has. */
  draw(status, text, { roundTrip, age }) {
    const now = performance.now();
    if (now < this.due) return false;
    this.due = now + PERIOD;
    const lines = [
      status.stop ? [status.stop.toUpperCase(), "bad"] : whatItDoes(status),
      whoHasIt(status),
      [figures(roundTrip, age, status), ""],
      [text, "warn"],
    ];
    const drawn = JSON.stringify(lines);
    if (drawn === this.drawn) return false;
    this.drawn = drawn;
    const { context: c, canvas } = this;
    c.clearRect(0, 0, canvas.width, canvas.height);
    c.fillStyle = "#10151ae0";
    c.beginPath();
    c.roundRect(0, 0, canvas.width, canvas.height, 24);
    c.fill();
    c.font = "600 38px system-ui, sans-serif";
    c.textBaseline = "middle";
    lines.forEach(([line, look], row) => {
      c.fillStyle = COLOURS[look];
      c.fillText(line, 24, 34 + 57 * row, canvas.width - 48);
    });
    return true;
  }
}

function figures(roundTrip, age, { hands, cameras }) {
  const ms = (value) => (Number.isFinite(value) ? `${value.toFixed(0)} ms` : "–");
  const grip = (side) => `${Math.round(100 * hands[side].closure)} %`;
  return `link ${ms(roundTrip)}   picture ${cameras ? "NONE" : ms(age)}   grips ${grip("left")} / ${grip("right")}`;
}
