// What a person sees in the headset: pads, their ghosts and the object where they are, and a board with a few lines.

import { SIDES } from "../arms.js";
import { middleOf } from "./frames.js";

const VERTEX = `attribute vec3 place; uniform mat4 see, model; varying vec3 at; void main() { at = place; gl_Position = see * model * vec4(place, 1.0); }`;
const FRAGMENT = `precision mediump float; varying vec3 at; uniform vec4 colour; uniform sampler2D board; uniform float written;
void main() {
  vec3 side = step(0.4999, abs(at));
  vec4 plain = vec4(colour.rgb * (0.6 + 0.4 * side.z + 0.2 * side.y), colour.a);
  gl_FragColor = written > 0.5 ? texture2D(board, vec2(0.5 - at.y, 0.5 - at.z)) : plain;
}`;
const PAD_M = [0.09, 0.02, 0.09];
const OBJECT_M = [0.12, 0.12, 0.12];
const BOARD_M = [0.001, 0.64, 0.2];
const BOARD_PX = [1024, 320];
const PICTURE_M = 0.48; // how wide a camera's picture is
const ABOVE_M = 0.3;
const READ_MS = 200; // between two writings of the board: a person reads no faster, and each one holds a picture up
const COLOURS = { left: [0.29, 0.56, 0.89, 1], right: [0.93, 0.6, 0.25, 1], object: [0.65, 0.6, 0.5, 1] };
const GHOST = 0.35;
const GROUNDS = { held: [0.03, 0.2, 0.09, 1], ready: [0.06, 0.08, 0.14, 1], idle: [0.07, 0.07, 0.07, 1], fault: [0.35, 0.04, 0.04, 1] };

const multiply = (a, b) => Array.from({ length: 16 }, (_, k) => [0, 1, 2, 3].reduce((sum, i) => sum + a[4 * i + (k % 4)] * b[4 * Math.floor(k / 4) + i], 0));

// From a pose (position, wxyz) and a box's edges; column-major.
function model([x, y, z, w, i, j, k], edges) {
  const columns = [
    [1 - 2 * (j * j + k * k), 2 * (i * j + w * k), 2 * (i * k - w * j)],
    [2 * (i * j - w * k), 1 - 2 * (i * i + k * k), 2 * (j * k + w * i)],
    [2 * (i * k + w * j), 2 * (j * k - w * i), 1 - 2 * (i * i + j * j)],
  ];
  return [...columns.flatMap((column, n) => [...column.map((value) => value * edges[n]), 0]), x, y, z, 1];
}

function cube() {
  const corners = [];
  for (const [n, sign] of [0, 1, 2].flatMap((axis) => [[axis, -0.5], [axis, 0.5]])) {
    const corner = (a, b) => [0, 1, 2].map((axis) => (axis === n ? sign : axis === (n + 1) % 3 ? a : b));
    const [p, q, r, s] = [corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)];
    corners.push(...p, ...q, ...r, ...p, ...r, ...s);
  }
  return new Float32Array(corners);
}

export class Room {
  constructor(gl) {
    this.gl = gl;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    this.at = Object.fromEntries(["see", "model", "colour", "written"].map((name) => [name, gl.getUniformLocation(program, name)]));
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, cube(), gl.STATIC_DRAW);
    const place = gl.getAttribLocation(program, "place");
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
    this.textures = ["board", "camera"].map(() => {
      const texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
      for (const way of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, way, gl.CLAMP_TO_EDGE); // of any size
      return texture;
    });
    this.board = new OffscreenCanvas(...BOARD_PX).getContext("2d");
    this.written = null;
    this.writtenMs = -Infinity;
  }

  // state: one of GROUNDS; clear: the real room is seen behind; lines: of the board; places: of the live view; picture: a camera's, null for
  // none.
  draw(frame, space, frames, { state, clear, lines, places, picture }) {
    const { gl } = this;
    const layer = frame.session.renderState.baseLayer;
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.framebuffer);
    gl.clearColor(...(clear ? [0, 0, 0, 0] : GROUNDS[state]));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const pose = frame.getViewerPose(space);
    if (!pose || !places) return;
    if (frames.origin === null) {
      const { x, y, z } = pose.transform.position;
      frames.put({ x, y: y - 0.4, z: z - 0.7 }, places.pads);
    }
    this.write(lines);
    this.show(picture);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    for (const view of pose.views) {
      const { x, y, width, height } = layer.getViewport(view);
      gl.viewport(x, y, width, height);
      const see = multiply(view.projectionMatrix, multiply(view.transform.inverse.matrix, frames.matrix));
      gl.uniformMatrix4fv(this.at.see, false, see);
      this.boxes(places);
      if (picture) this.hang(places, picture);
    }
  }

  boxes({ pads, told, object }) {
    if (object) this.box(object, OBJECT_M, COLOURS.object);
    for (const [k, side] of SIDES.entries()) this.box(pads[k], PAD_M, COLOURS[side]);
    const middle = middleOf(pads);
    this.gl.bindTexture(this.gl.TEXTURE_2D, this.textures[0]);
    this.box([middle[0], middle[1], middle[2] + ABOVE_M, 1, 0, 0, 0], BOARD_M, [0, 0, 0, 1], 1);
    for (const [k, side] of SIDES.entries()) told && this.box(told[k], PAD_M, [...COLOURS[side].slice(0, 3), GHOST]);
  }

  // The camera's picture stands above the board.
  hang({ pads }, { width, height }) {
    const middle = middleOf(pads);
    const high = (PICTURE_M * height) / width;
    this.gl.bindTexture(this.gl.TEXTURE_2D, this.textures[1]);
    this.box([middle[0], middle[1], middle[2] + ABOVE_M + (BOARD_M[2] + high) / 2, 1, 0, 0, 0], [0.001, PICTURE_M, high], [0, 0, 0, 1], 1);
  }

  show(picture) {
    if (!picture || picture === this.shown) return;
    this.shown = picture;
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.textures[1]);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, picture);
  }

  box(pose, edges, colour, written = 0) {
    const { gl } = this;
    gl.uniformMatrix4fv(this.at.model, false, model(pose, edges));
    gl.uniform4fv(this.at.colour, colour);
    gl.uniform1f(this.at.written, written);
    gl.drawArrays(gl.TRIANGLES, 0, 36);
  }

  write(lines) {
    const [text, now] = [lines.join("\n"), performance.now()];
    if (text === this.written || now - this.writtenMs < READ_MS) return;
    [this.written, this.writtenMs] = [text, now];
    const { gl, board } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.textures[0]);
    const [width, height] = BOARD_PX;
    board.fillStyle = "#10151c";
    board.fillRect(0, 0, width, height);
    board.fillStyle = "#eef2f6";
    board.font = "36px sans-serif";
    for (const [k, line] of lines.entries()) board.fillText(line, 24, 56 + 56 * k, width - 48);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, board.canvas);
  }
}
