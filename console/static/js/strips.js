// The last ten seconds of a number of each arm, on a canvas: as the robot said it, a gap where it said nothing.

const SECONDS = 10;

export class Strip {
  // least: the range that is always shown, so that noise does not fill the picture.
  constructor(canvas, least) {
    this.canvas = canvas;
    this.least = least;
    this.points = [];
  }

  add(timeMs, left, right) {
    this.points.push([timeMs, left, right]);
    while (this.points.length && timeMs - this.points[0][0] > SECONDS * 1000) this.points.shift();
    this.draw(timeMs);
  }

  draw(nowMs) {
    const { canvas } = this;
    const ratio = window.devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const style = getComputedStyle(canvas);
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const most = Math.max(this.least, ...this.points.flatMap(([, left, right]) => [left ?? 0, right ?? 0])) * 1.1;
    pen.strokeStyle = style.getPropertyValue("--line");
    pen.lineWidth = 1;
    pen.strokeRect(0.5, 0.5, width - 1, height - 1);
    for (const [index, name] of [[1, "--left"], [2, "--right"]]) {
      pen.strokeStyle = style.getPropertyValue(name);
      pen.lineWidth = 1.5;
      pen.beginPath();
      let going = false;
      for (const point of this.points) {
        const value = point[index];
        if (value === null) {
          going = false;
          continue;
        }
        const x = width - ((nowMs - point[0]) / (SECONDS * 1000)) * width;
        const y = height - 2 - (value / most) * (height - 4);
        if (going) pen.lineTo(x, y);
        else pen.moveTo(x, y);
        going = true;
      }
      pen.stroke();
    }
  }
}
