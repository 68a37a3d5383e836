// The two pictures of the desktop page, the commanded hands in them, and dragging these.

const SVG = "http://www.w3.org/2000/svg";
const HEIGHT = 300; // of the overlay's coordinates; its origin is the centre of the picture
const RADIUS = 16;
const WHEEL = 0.02, SHIFT = 0.5; // metres ahead: for a notch, for the height of the picture
const SIDES = ["left", "right"];

export class Eyes {
  /** @param {{drag: Function, key: Function}} send */
  constructor(send) {
    this.send = send;
    this.drag = null;
    this.figures = [...document.querySelectorAll(".eye")].map((figure) => this.#prepare(figure));
  }

  draw({ left, right }) {
    for (const { eye, canvas, context } of this.figures) {
      const bitmap = eye === "left" ? left : right;
      if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
        canvas.width = bitmap.width;
        canvas.height = bitmap.height;
      }
      context.transferFromImageBitmap(bitmap);
    }
  }

  isOld(old) {
    for (const { figure } of this.figures) figure.classList.toggle("old", old);
  }

  /** Draw the commanded hands of a status. */
  mark(status) {
    for (const { eye, hands } of this.figures) {
      for (const side of SIDES) {
        const { picture, closure, error } = status.hands[side];
        const at = picture[eye];
        const { group, ring, text } = hands[side];
        group.style.display = at ? "" : "none";
        if (!at) continue;
        group.setAttribute("transform", `translate(${at[0] * HEIGHT} ${at[1] * HEIGHT})`);
        ring.setAttribute("stroke-dasharray", status.operator.has_robot ? "none" : "4 4");
        text.textContent = `${side} ${Math.round(100 * closure)} %${error > 0.02 ? ` · ${Math.round(100 * error)} cm off` : ""}`;
      }
    }
  }

  #prepare(figure) {
    const canvas = figure.querySelector("canvas"), overlay = figure.querySelector("svg");
    const hands = Object.fromEntries(SIDES.map((side) => [side, this.#hand(overlay, side)]));
    return { figure, eye: figure.dataset.eye, canvas, overlay, hands, context: canvas.getContext("bitmaprenderer") };
  }

  #hand(overlay, side) {
    const group = overlay.appendChild(document.createElementNS(SVG, "g"));
    group.style.display = "none";
    const ring = group.appendChild(document.createElementNS(SVG, "circle"));
    ring.setAttribute("r", RADIUS);
    ring.setAttribute("class", `hand ${side}`);
    const cross = group.appendChild(document.createElementNS(SVG, "path"));
    cross.setAttribute("d", "M-5 0H5M0-5V5");
    cross.setAttribute("class", side);
    const text = group.appendChild(document.createElementNS(SVG, "text"));
    text.setAttribute("class", side);
    text.setAttribute("y", RADIUS + 13);
    text.setAttribute("text-anchor", "middle");
    ring.addEventListener("pointerdown", (event) => this.#begin(event, overlay, ring, side));
    ring.addEventListener("pointermove", (event) => this.#move(event));
    ring.addEventListener("lostpointercapture", () => this.#end());
    ring.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    ring.addEventListener("dblclick", () => {
      this.send.key(side === "left" ? "1" : "2");
      this.send.key("g");
    });
    return { group, ring, text };
  }

  #begin(event, overlay, ring, side) {
    if (event.button !== 0) return;
    event.preventDefault();
    ring.setPointerCapture(event.pointerId);
    ring.classList.add("dragged");
    const { height } = overlay.getBoundingClientRect();
    this.drag = { ring, side, height, x: event.clientX, y: event.clientY, across: 0, down: 0, ahead: 0 };
    this.#send(true);
  }

  #move(event) {
    const { drag } = this;
    if (!drag) return;
    const dx = (event.clientX - drag.x) / drag.height, dy = (event.clientY - drag.y) / drag.height;
    drag.x = event.clientX;
    drag.y = event.clientY;
    if (event.shiftKey) drag.ahead -= SHIFT * dy;
    else {
      drag.across += dx;
      drag.down += dy;
    }
    this.#sendSoon();
  }

  #wheel(event) {
    if (!this.drag) return;
    event.preventDefault();
    this.drag.ahead -= WHEEL * Math.sign(event.deltaY);
    this.#sendSoon();
  }

  #end() {
    this.drag?.ring.classList.remove("dragged");
    this.drag = null;
  }

  /** Send at most once a frame. */
  #sendSoon() {
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => {
      this.pending = 0;
      if (this.drag) this.#send(false);
    });
  }

  #send(begins) {
    const limit = (value, most) => Math.max(-most, Math.min(most, value));
    const { side, across, down, ahead } = this.drag;
    this.send.drag({ side, begins, across: limit(across, 4), down: limit(down, 4), ahead: limit(ahead, 2) });
  }
}
