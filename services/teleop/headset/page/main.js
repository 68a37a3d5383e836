// The operator's page: keys, pointer and headset become messages; status and pictures are shown.

import { Link } from "./link.js";
import { Pictures } from "./pictures.js";
import { Keys } from "./keys.js";
import { Eyes } from "./eyes.js";
import { show, showFigures } from "./status.js";

const [token, ...options] = location.hash.slice(1).split("&");
const element = (id) => document.getElementById(id);
const OLD = 700; // ms after which a picture counts as old

let status = null;
let headset = null; // the module of the WebXR session, while one is on
let last = null; // the picture that is shown
let age = NaN; // of the last picture when it was drawn [ms]
let wasConnected = false;

const link = new Link({
  token,
  onStatus(told) {
    status = told;
    show(told);
    eyes.mark(told);
    headset?.tell(told);
  },
  onPicture: (data, at) => pictures.receive(data, at),
  onChange(text) {
    const connected = text === "connected";
    element("connection").textContent = text;
    element("connection").className = `pill ${connected ? "good" : "bad"}`;
    if (connected && !wasConnected) pictures.restart();
    wasConnected = connected;
    document.body.classList.toggle("offline", !connected);
  },
});

const pictures = new Pictures(
  (picture) => {
    age = picture.header.age + link.roundTrip / 2 + performance.now() - picture.header.at;
    if (headset) headset.show(picture);
    else eyes.draw(picture);
    last = performance.now();
    link.send("shown", { picture: picture.header.number });
  },
  (header) => link.send("shown", { picture: header.number }),
);

new Keys((key) => link.send("key", { key }));
const eyes = new Eyes({
  drag: (fields) => link.send("drag", fields),
  key: (key) => link.send("key", { key }),
});

setInterval(() => {
  const old = last === null || performance.now() - last > OLD;
  eyes.isOld(old);
  const why = status?.cameras || (link.open ? "no picture comes" : "no connection");
  element("no-picture").hidden = !old;
  element("no-picture").textContent = last === null ? why : `${why}; this one is ${((performance.now() - last) / 1000).toFixed(1)} s old`;
  showFigures({ roundTrip: link.open ? link.roundTrip : NaN, age: old ? NaN : age });
}, 200);

async function offerHeadset() {
  const possible = await navigator.xr?.isSessionSupported("immersive-vr").catch(() => false);
  element("enter-vr").hidden = !possible;
}

element("enter-vr").addEventListener("click", async () => {
  const { Headset } = await import("./headset.js");
  try {
    headset = await Headset.enter({
      link,
      emulated: options.includes("emulated"),
      figures: () => ({ roundTrip: link.roundTrip, age }),
      onEnd() { headset = null; },
    });
    if (status) headset.tell(status);
  } catch (error) {
    element("notice").textContent = `VR cannot be entered: ${error.message}`;
  }
});
navigator.xr?.addEventListener?.("devicechange", offerHeadset);
offerHeadset();

if (!token) element("connection").textContent = "the link lacks its token: open it as it was printed";
if (!isSecureContext) element("notice").textContent = "This address is not a secure context, so a headset cannot enter VR here; use https or localhost.";
