// The room of a headset and the world of the arms. WebXR's axes: x to the right, y up, z towards the person. The world's:
// x ahead of the arms, y to the left, z up.

const rotated = ([x, y, z], turn) => {
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  return [c * x - s * y, s * x + c * y, z];
};

export class Frames {
  // turn: about the vertical, rad, of a person who does not look along the world's x; origin: the room's, in the world, m.
  constructor() {
    this.turn = 0;
    this.origin = null;
  }

  // A direction, or a quaternion's vector.
  direction({ x, y, z }) {
    return rotated([-z, -x, y], this.turn);
  }

  place(point) {
    return this.direction(point).map((value, k) => value + (this.origin?.[k] ?? 0));
  }

  // Column-major: from the world to the room.
  get matrix() {
    const [c, s] = [Math.cos(this.turn), Math.sin(this.turn)];
    const [x, y, z] = this.origin ?? [0, 0, 0];
    const rows = [[s, -c, 0], [0, 0, 1], [-c, -s, 0]]; // of room from world: x = -left, y = up, z = -ahead
    const shift = rows.map((row) => -(row[0] * x + row[1] * y + row[2] * z));
    return [0, 1, 2].flatMap((column) => [rows[0][column], rows[1][column], rows[2][column], 0]).concat(shift, 1);
  }

  // The controllers, in the room, are where the pads are. pads: of (left, right), in the world.
  align(left, right, pads) {
    this.turn = 0;
    this.origin = null;
    const [a, b] = [this.direction(left), this.direction(right)];
    const angle = (from, to) => Math.atan2(from[1] - to[1], from[0] - to[0]);
    this.turn = angle(pads[0], pads[1]) - angle(a, b);
    this.put({ x: (left.x + right.x) / 2, y: (left.y + right.y) / 2, z: (left.z + right.z) / 2 }, pads);
  }

  // The middle between the pads is at a point of the room.
  put(point, pads) {
    const at = this.direction(point);
    this.origin = [0, 1, 2].map((k) => (pads[0][k] + pads[1][k]) / 2 - at[k]);
  }
}
