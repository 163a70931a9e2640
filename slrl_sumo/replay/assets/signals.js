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

  // The bars by colour; they are put together anew only when a signal has changed.
  place(time) {
    let changed = false;
    for (const signal of this.all) {
      const now = this.stateAt(signal, time);
      changed ||= now !== signal.now;
      signal.now = now;
    }
    if (!changed) return;
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
  }

  draw(on, view, colours, time) {
    if (!this.all.length) return;
    this.place(time);
    on.setTransform(...transform(view, on.canvas.width, on.canvas.height));
    on.lineWidth = Math.max(BAR, LEAST_BAR / view.scale);
    for (const [colour, path] of this.paths) {
      on.strokeStyle = colours[colour];
      on.stroke(path);
    }
  }
}
