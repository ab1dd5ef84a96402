// The room of a headset and the world of the arms. WebXR's axes: x to the right, y up, z towards the person. The world's:
// x ahead of the arms, y to the left, z up.

const rotated = ([x, y, z], turn) => {
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  return [c * x - s * y, s * x + c * y, z];
};

// The middle of the pads of the arms, m.
export const middleOf = (pads) => [0, 1, 2].map((k) => pads.reduce((sum, pad) => sum + pad[k], 0) / pads.length);

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

  // The controllers, one or two points of the room, are where the pads are. pads: of the arms, in the world. One point
  // does not say which way a person looks: that stays as it is.
  align(points, pads) {
    if (points.length === 1) {
      this.put(points[0], pads);
      return;
    }
    const [left, right] = points;
    this.turn = 0;
    this.origin = null;
    const [a, b] = [this.direction(left), this.direction(right)];
    const angle = (from, to) => Math.atan2(from[1] - to[1], from[0] - to[0]);
    this.turn = angle(pads[0], pads[1]) - angle(a, b);
    this.put({ x: (left.x + right.x) / 2, y: (left.y + right.y) / 2, z: (left.z + right.z) / 2 }, pads);
  }

  // The middle between the pads, or the only one, is at a point of the room.
  put(point, pads) {
    const at = this.direction(point);
    const middle = middleOf(pads);
    this.origin = [0, 1, 2].map((k) => middle[k] - at[k]);
  }
}
