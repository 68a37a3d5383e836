// What a headset shows, in WebGL 2: each eye sees the picture of the robot's eye on its side, as
// wide as the camera saw it and where the camera looked; the commanded hands in it; a panel.

const HALF_HEIGHT = Math.tan(Math.PI / 3); // of a picture at distance 1: the cameras see 120°
const PANEL = { width: 0.64, height: 0.2, position: [0, -0.34, -0.9] }; // before the head [m]
const HAND = 0.03; // half the size of the mark at a commanded hand [m]
const COLOURS = { left: [0.37, 0.72, 1, 1], right: [1, 0.64, 0.36, 1] };

const VERTEX = `#version 300 es
in vec3 place; in vec2 across; uniform mat4 matrix; out vec2 at;
void main() { at = across; gl_Position = matrix * vec4(place, 1.0); }`;
const FRAGMENT = `#version 300 es
precision mediump float; in vec2 at; uniform sampler2D picture; uniform vec4 colour; out vec4 seen;
void main() { seen = colour.a > 0.0 ? colour : texture(picture, at); }`;

// Two triangles, then the three axes of a mark: place and texture coordinates.
const CORNERS = new Float32Array([
  -1, -1, 0, 0, 1, 1, -1, 0, 1, 1, -1, 1, 0, 0, 0, 1, 1, 0, 1, 0,
  -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0,
]);

export class Scene {
  /** Make a session's layer and what is drawn into it. */
  static async make(session) {
    const gl = document.createElement("canvas").getContext("webgl2", { xrCompatible: true, antialias: false });
    if (!gl) throw new Error("this browser has no WebGL 2");
    await gl.makeXRCompatible?.();
    await session.updateRenderState({ baseLayer: new XRWebGLLayer(session, gl) });
    return new Scene(gl);
  }

  constructor(gl) {
    this.gl = gl;
    this.program = program(gl);
    this.matrix = gl.getUniformLocation(this.program, "matrix");
    this.colour = gl.getUniformLocation(this.program, "colour");
    this.textures = { left: texture(gl), right: texture(gl), panel: texture(gl) };
    this.header = null;
    this.hasPanel = false;
    gl.useProgram(this.program);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, CORNERS, gl.STATIC_DRAW);
    for (const [name, size, offset] of [["place", 3, 0], ["across", 2, 12]]) {
      const attribute = gl.getAttribLocation(this.program, name);
      gl.enableVertexAttribArray(attribute);
      gl.vertexAttribPointer(attribute, size, gl.FLOAT, false, 20, offset);
    }
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  show({ header, left, right }) {
    this.header = { ...header, aspect: left.width / left.height };
    this.#upload("left", left);
    this.#upload("right", right);
    left.close();
    right.close();
  }

  showPanel(canvas) {
    this.hasPanel = true;
    this.#upload("panel", canvas);
  }

  /** Draw a frame; `yaw` is the heading of the pictures [rad]. */
  draw(session, pose, yaw, hands) {
    const { gl } = this, layer = session.renderState.baseLayer;
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.framebuffer);
    gl.clearColor(0.02, 0.03, 0.04, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    for (const view of pose.views) {
      const port = layer.getViewport(view);
      if (!port.width) continue;
      gl.viewport(port.x, port.y, port.width, port.height);
      // A view without an eye is that of a device with one display.
      this.#view(view, pose, view.eye === "right" ? "right" : "left", yaw, hands);
    }
  }

  free() {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  #view(view, pose, eye, yaw, hands) {
    const { gl, header } = this;
    if (header) {
      // Around the eye itself: the pictures already hold the distance of the robot's eyes.
      const looked = product(view.projectionMatrix, turned(view.transform.inverse.matrix), heading(yaw), pitch(-header.neck));
      this.#quad(product(looked, placed([0, 0, -1], header.aspect * HALF_HEIGHT, HALF_HEIGHT)), eye);
      for (const side of hands ? ["left", "right"] : []) this.#mark(looked, hands[side].seen[eye], COLOURS[side]);
    }
    if (this.hasPanel) {
      const before = product(view.projectionMatrix, view.transform.inverse.matrix, pose.transform.matrix);
      gl.enable(gl.BLEND);
      this.#quad(product(before, placed(PANEL.position, PANEL.width / 2, PANEL.height / 2)), "panel");
      gl.disable(gl.BLEND);
    }
  }

  #quad(matrix, name) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.textures[name]);
    gl.uniform4f(this.colour, 0, 0, 0, 0);
    gl.uniformMatrix4fv(this.matrix, false, matrix);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /** `seen` is in the camera's axes: x right, y down, z ahead. */
  #mark(looked, [x, y, z], colour) {
    const { gl } = this;
    if (z < 0.05) return;
    gl.uniform4f(this.colour, ...colour);
    gl.uniformMatrix4fv(this.matrix, false, product(looked, placed([x, -y, -z], HAND, HAND, HAND)));
    gl.drawArrays(gl.LINES, 4, 6);
  }

  #upload(name, source) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.textures[name]);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, source);
  }
}

function program(gl) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(`WebGL: ${gl.getProgramInfoLog(made)}`);
  return made;
}

function texture(gl) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([0, 0, 0, 255]));
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.LINEAR);
  for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, wrap, gl.CLAMP_TO_EDGE);
  return made;
}

// Matrices are column by column, as WebGL wants them.

function product(...matrices) {
  return matrices.reduce((a, b) => {
    const c = new Float32Array(16);
    for (let column = 0; column < 4; column++) {
      for (let row = 0; row < 4; row++) {
        for (let k = 0; k < 4; k++) c[4 * column + row] += a[4 * k + row] * b[4 * column + k];
      }
    }
    return c;
  });
}

function turned(matrix) {
  const m = new Float32Array(matrix);
  m[12] = m[13] = m[14] = 0;
  return m;
}

function placed([x, y, z], width, height, depth = 1) {
  return new Float32Array([width, 0, 0, 0, 0, height, 0, 0, 0, 0, depth, 0, x, y, z, 1]);
}

function heading(angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return new Float32Array([c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, 0, 0, 0, 1]);
}

function pitch(angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return new Float32Array([1, 0, 0, 0, 0, c, s, 0, 0, -s, c, 0, 0, 0, 0, 1]);
}
