// What each command says of itself: its sender, its number, when it was made, and which picture it answers. The console
// does not apply one that is old, out of order, or made on an old picture.

const letters = (bytes) => [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");

export class Commands {
  constructor(live) {
    this.sender = letters(crypto.getRandomValues(new Uint8Array(8)));
    this.sequence = 0;
    this.picture = 0;
    this.seenMs = 0;
    this.camera = null; // whose picture is looked at too
    // a view is seen with the picture after it, which a hidden page does not get
    live.onView(({ number }) => requestAnimationFrame(() => this.saw(number)));
  }

  saw(number) {
    if (number <= this.picture) return;
    this.picture = number;
    this.seenMs = performance.now();
  }

  stamped(message) {
    this.sequence += 1;
    const stamp = { sender: this.sender, sequence: this.sequence, made_ms: performance.now(), picture: this.picture, seen_ms: this.seenMs };
    if (this.camera?.name) stamp.camera_us = this.camera.us;
    return { ...message, stamp };
  }
}

// One line of how fast a hand is followed and seen, and of what was not applied. hand: of the live view.
export function latencyLine({ latency, dropped }) {
  const [old, order, picture, other] = dropped;
  const lost = [[old, "too old"], [order, "out of order"], [picture, "on an old picture"], [other, "otherwise"]];
  const words = lost.filter(([count]) => count > 0).map(([count, why]) => `${count} ${why}`);
  const figures = ([middle, high]) => `${middle.toFixed(0)} ms (${high.toFixed(0)})`;
  return [
    latency && `Hand to torque ${figures(latency.to_torque_ms)}, torque to picture ${figures(latency.to_picture_ms)}`,
    words.length > 0 && `not applied: ${words.join(", ")}`,
  ].filter(Boolean).join("; ");
}
