// What traffic lights show at stop lines and crossings: bars in the colours of the signal.

const SHOWS = { g: "go", y: "caution", u: "caution", r: "stop" }; // others are off or blink
const BAR = 0.7; // m that a bar is thick
const LEAST_BAR = 2.5; // px

class Signals {
  constructor(signals, origin) {
    this.all = signals.map(({ id, times, states, bars }) => {
      let ms = 0;
      return {
        id, states, now: -1, begin: times.map((more) => (ms += more) / 1000),
        bars: bars.map(([link, ...ends]) => [link, ...ends.map((cm, k) => cm / 100 - origin[k % 2])]),
      };
    });
    this.paths = new Map();
    this.canvas = document.createElement("canvas");
  }

  // Of the state that is shown at `time`, the number; -1 before the first one.
  stateAt(signal, time) {
    let low = 0, high = signal.begin.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (signal.begin[middle] <= time + 1e-6) low = middle + 1; else high = middle;
    }
    return low - 1;
  }

  // Puts the bars by colour together anew where a signal has changed; whether one has.
  place(time) {
    let changed = false;
    for (const signal of this.all) {
      const now = this.stateAt(signal, time);
      changed ||= now !== signal.now;
      signal.now = now;
    }
    if (!changed) return false;
    this.paths = new Map();
    for (const { bars, states, now } of this.all) {
      if (now < 0) continue;
      for (const [link, x0, y0, x1, y1] of bars) {
        const colour = SHOWS[states[now][link]?.toLowerCase()] ?? "off";
        if (!this.paths.has(colour)) this.paths.set(colour, new Path2D());
        const path = this.paths.get(colour);
        path.moveTo(x0, y0);
        path.lineTo(x1, y1);
      }
    }
    return true;
  }

  // Puts a picture of the bars on `to`; it is painted anew when a signal or the view has changed.
  draw(to, view, colours, time) {
    if (!this.all.length) return;
    const { width, height } = to.canvas, key = `${view.x} ${view.y} ${view.scale} ${width} ${height}`;
    if (this.place(time) || key !== this.key || colours !== this.colours) this.paint(width, height, view, colours);
    [this.key, this.colours] = [key, colours];
    to.setTransform(1, 0, 0, 1, 0, 0);
    to.drawImage(this.canvas, 0, 0);
  }

  paint(width, height, view, colours) {
    [this.canvas.width, this.canvas.height] = [width, height];
    const on = this.canvas.getContext("2d");
    on.setTransform(...transform(view, width, height));
    on.lineWidth = Math.max(BAR, LEAST_BAR / view.scale);
    for (const [colour, path] of this.paths) {
      on.strokeStyle = colours[colour];
      on.stroke(path);
    }
  }
}
