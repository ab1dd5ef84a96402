// The picture of a camera of the cell, the newest one, with its age in it. While it is looked at, each command says which
// picture it answers: the console applies none that was made on one older than 250 ms.

const RETRY_MS = 1000;
const HEAD_BYTES = 16;
const STALE_S = 0.25; // the console's limit for a picture

export class Camera {
  // onPicture: called with this after each picture.
  constructor(onPicture) {
    this.onPicture = onPicture;
    this.name = "";
    this.gone();
  }

  gone() {
    this.picture = null;
    this.us = 0; // as the console counts
    this.ofMs = -Infinity; // when the picture is of, by this page's clock
  }

  // name: of the cell's camera, empty for none.
  look(name) {
    this.name = name;
    const old = this.socket;
    this.socket = null;
    old?.close();
    this.gone();
    if (name) this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/api/cameras/${this.name}`);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.addEventListener("message", async ({ data }) => {
      const [cameMs, head] = [performance.now(), new DataView(data)];
      const picture = await createImageBitmap(new Blob([new Uint8Array(data, HEAD_BYTES)], { type: "image/jpeg" }));
      if (socket !== this.socket) return;
      this.picture?.close();
      [this.picture, this.us, this.ofMs] = [picture, head.getFloat64(0, true), cameMs - head.getFloat64(8, true)];
      this.onPicture(this);
      socket.send("shown");
    });
    socket.addEventListener("close", () => socket === this.socket && setTimeout(() => socket === this.socket && this.connect(), RETRY_MS));
  }

  get ageS() {
    return (performance.now() - this.ofMs) / 1000;
  }

  get stale() {
    return this.name !== "" && this.ageS > STALE_S;
  }

  // One line about its age.
  get line() {
    if (!this.name) return "";
    if (this.picture === null) return `${this.name}: no picture yet: nothing is applied`;
    const age = this.stale ? `${this.ageS.toFixed(1)} s old: nothing is applied` : `${Math.round(1000 * this.ageS)} ms`;
    return `${this.name} ${age}`;
  }
}

// Puts a camera into a figure: the picture, its age, and a list of the cell's cameras to choose from.
export function showCamera(figure, choice, live) {
  const canvas = figure.querySelector("canvas");
  const caption = figure.querySelector("figcaption");
  const tell = (camera) => {
    caption.textContent = camera.line;
    figure.dataset.stale = String(camera.stale);
  };
  const camera = new Camera((seen) => {
    const { width, height } = seen.picture;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    canvas.getContext("2d").drawImage(seen.picture, 0, 0);
    tell(seen);
  });
  const look = () => {
    camera.look(choice.value);
    figure.hidden = choice.value === "";
  };
  choice.addEventListener("change", look);
  live.onView(() => tell(camera));
  look();
  return camera;
}
