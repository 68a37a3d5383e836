// A WebXR session: the robot's eyes for the operator's, controllers as samples, haptics, a panel.

import { Scene } from "./scene.js";
import { Panel } from "./panel.js";
import { notice } from "./status.js";

const NOWHERE = { position: [0, 0, 0], quaternion: [1, 0, 0, 0], tracked: false };
const ENGAGED = 0.6; // squeeze at which the server engages a clutch, for the haptic answer only
const FOLLOW_FROM = 0.7, FOLLOW_TO = 0.05, FOLLOW_RATE = 2.5; // rad, rad, 1/s
const PULSES = { refused: [0.9, 180], granted: [0.5, 80], engaged: [0.3, 25] };

export class Headset {
  /** Enter VR by the person's click.
   *  @param {{link: object, emulated: boolean, figures: Function, onEnd: Function}} options */
  static async enter(options) {
    const session = await navigator.xr.requestSession("immersive-vr", { requiredFeatures: ["local-floor"] });
    try {
      const scene = await Scene.make(session);
      const floor = await session.requestReferenceSpace("local-floor");
      return new Headset(session, scene, floor, options);
    } catch (error) {
      await session.end();
      throw error;
    }
  }

  constructor(session, scene, floor, options) {
    Object.assign(this, { session, scene, floor, options });
    this.panel = new Panel();
    this.status = null;
    this.yaw = null; // heading of the pictures [rad]
    this.following = false;
    this.time = 0;
    this.squeezed = { left: false, right: false };
    session.addEventListener("end", () => this.#ended());
    floor.addEventListener("reset", () => { this.yaw = null; });
    session.requestAnimationFrame((time, frame) => this.#frame(time, frame));
  }

  /** Show a decoded picture. */
  show(picture) { this.scene.show(picture); }

  /** Take in a status of the server. */
  tell(status) {
    const before = this.status;
    this.status = status;
    if (!before || !status.you.drives) return;
    if (status.you.refusals > before.you.refusals) this.#pulse("refused");
    if (status.operator.has_robot && !before.operator.has_robot) this.#pulse("granted");
  }

  #ended() {
    this.scene.free();
    this.options.onEnd();
  }

  #frame(time, frame) {
    this.session.requestAnimationFrame((later, next) => this.#frame(later, next));
    const pose = frame.getViewerPose(this.floor);
    // Behind a system menu the controllers are not this page's.
    if (this.session.visibilityState === "visible") this.options.link.send("sample", this.#sample(frame, pose));
    if (!pose) return;
    this.#turn(pose.transform.orientation, Math.min(0.1, (time - this.time) / 1000));
    this.time = time;
    const { status } = this;
    if (status && this.panel.draw(status, notice(status), this.options.figures())) this.scene.showPanel(this.panel.canvas);
    this.scene.draw(this.session, pose, this.yaw, status?.hands);
  }

  /** Keep the pictures where they are, but not behind a person who has turned away. */
  #turn({ x, y, z, w }, dt) {
    const heading = Math.atan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y));
    this.yaw ??= heading;
    const off = Math.atan2(Math.sin(heading - this.yaw), Math.cos(heading - this.yaw));
    if (Math.abs(off) > FOLLOW_FROM) this.following = true;
    if (Math.abs(off) < FOLLOW_TO) this.following = false;
    if (this.following) this.yaw += off * Math.min(1, FOLLOW_RATE * dt);
  }

  #sample(frame, pose) {
    const sample = { head: this.#pose(pose), left: { ...NOWHERE }, right: { ...NOWHERE } };
    for (const source of this.session.inputSources) {
      if (!(source.handedness in this.squeezed) || !source.gripSpace || !source.gamepad) continue;
      sample[source.handedness] = {
        ...this.#pose(frame.getPose(source.gripSpace, this.floor)), ...buttons(source.gamepad),
      };
    }
    for (const side of ["left", "right"]) {
      const squeezed = sample[side].squeeze >= ENGAGED;
      if (squeezed && !this.squeezed[side] && this.status?.operator.has_robot) this.#pulse("engaged", side);
      this.squeezed[side] = squeezed;
    }
    return sample;
  }

  #pose(pose) {
    if (!pose) return NOWHERE;
    const { position: p, orientation: q } = pose.transform;
    // A position that the headset only guesses must not move a hand; emulated headsets say so of all.
    const tracked = this.options.emulated || !pose.emulatedPosition;
    return { position: [p.x, p.y, p.z], quaternion: [q.w, q.x, q.y, q.z].map(unit), tracked };
  }

  #pulse(name, only = null) {
    for (const source of this.session.inputSources) {
      if (only === null || source.handedness === only) source.gamepad?.hapticActuators?.[0]?.pulse?.(...PULSES[name]);
    }
  }
}

const unit = (value) => Math.max(-1, Math.min(1, value || 0));
const share = (button) => Math.max(0, Math.min(1, button?.value || 0));

/** Buttons of the profile xr-standard: trigger, squeeze, touchpad, thumb stick, A or X, B or Y. */
function buttons({ buttons: all, axes }) {
  const pressed = (index) => Boolean(all[index]?.pressed);
  return {
    trigger: share(all[0]), squeeze: share(all[1]), stick_pressed: pressed(3), lower: pressed(4),
    upper: pressed(5), stick: [unit(axes[2]), unit(-axes[3])],
  };
}
