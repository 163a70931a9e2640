// Everything that moves: positions of all road users at a moment, and how they are drawn.

const SMALLEST = 5; // px that a road user is long at least, so that it is seen
const NEAR_POINTER = 5; // px round a box in which the pointer still means it
const TRAIL_STEP = 0.35; // s between two points of a trail at least
const TRAIL_BEND = 5; // px between them at least, for 10 m/s
const MANY = 1000; // road users in view
const PATHS = 256; // trails that are drawn at once: browsers take longer for one path of thousands
const DOT = 8; // px: who is shorter is a square, which is drawn ten times as fast as a box, and looks the same

class Scene {
  constructor(trace) {
    this.trace = trace;
    const most = trace.begin.reduce((m, b, i, all) => Math.max(m, i ? b - all[i - 1] : 0), 0);
    for (const name of ["x", "y", "heading"]) this[name] = new Float32Array(most);
    this.row = new Uint32Array(most);
    this.count = 0;
    const { user, state } = trace;
    this.waited = standingTimes(trace);
    this.learned = new Uint8Array(trace.users.id.length); // at any time
    for (let row = 0; row < user.length; row++) if (state[row]) this.learned[user[row]] = 1;
  }

  // The last time step that is not after `time`.
  stepAt(time) {
    const all = this.trace.time;
    let low = 0, high = all.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (all[middle] <= time) low = middle; else high = middle - 1;
    }
    return low;
  }

  // Interpolates all positions at `time`, on the straight line between two steps.
  place(time) {
    const t = this.trace, step = this.stepAt(time);
    const share = step + 1 < t.time.length ? (time - t.time[step]) / (t.time[step + 1] - t.time[step]) : 0;
    let n = 0;
    for (let i = t.begin[step]; i < t.begin[step + 1]; i++, n++) {
      const row = t.rows[i], f = t.last[row] ? 0 : share, next = t.last[row] ? row : row + 1;
      this.row[n] = row;
      this.x[n] = t.x[row] + f * (t.x[next] - t.x[row]);
      this.y[n] = t.y[row] + f * (t.y[next] - t.y[row]);
      this.heading[n] = t.heading[row] + f * (t.heading[next] - t.heading[row]);
    }
    this.count = n;
    this.step = step;
  }

  // Length and width as drawn, m.
  size(user, scale) {
    const { length, width } = this.trace.users;
    return [Math.max(length[user], SMALLEST / scale), Math.max(width[user], (0.7 * SMALLEST) / scale)];
  }

  draw(on, view, colours, options) {
    const { width, height } = on.canvas, t = this.trace, scale = view.scale, pixel = 1 / scale;
    on.setTransform(...transform(view, width, height));
    on.lineJoin = "round";
    const reachX = width / 2 / scale, reachY = height / 2 / scale;
    const visible = [];
    for (let i = 0; i < this.count; i++) {
      const margin = 0.5 * t.users.length[t.user[this.row[i]]] + 3 + 60 * pixel;
      if (Math.abs(this.x[i] - view.x) < reachX + margin && Math.abs(this.y[i] - view.y) < reachY + margin) visible.push(i);
    }
    if (options.trail) this.drawTrails(on, visible, colours, options, pixel);
    if (options.selected >= 0) this.drawWay(on, options.selected, colours, pixel);
    const colouring = COLOURINGS[options.colour], boxes = new Map(), dots = new Map(), learned = new Path2D();
    for (const i of visible) {
      const user = t.user[this.row[i]], colour = colouring.of(this, this.row[i], colours);
      if (t.users.length[user] * scale < DOT) {
        const same = dots.get(colour);
        if (same) same.push(i); else dots.set(colour, [i]);
        continue;
      }
      if (!boxes.has(colour)) boxes.set(colour, new Path2D());
      this.outline(boxes.get(colour), i, ...this.size(user, scale));
      if (t.state[this.row[i]]) this.outline(learned, i, ...this.size(user, scale));
    }
    this.drawDots(on, dots, colours, pixel);
    on.lineWidth = Math.min(1, scale / 8) * pixel;
    on.strokeStyle = colours.edge;
    for (const [colour, path] of boxes) {
      on.fillStyle = colour;
      on.fill(path);
      if (scale > 3) on.stroke(path);
    }
    on.lineWidth = Math.min(2, 0.7 + scale / 12) * pixel;
    on.strokeStyle = colours.outline;
    on.stroke(learned);
    this.drawMarks(on, colours, options, scale);
  }

  // Squares of road users by colour, learned ones on larger squares.
  drawDots(on, dots, colours, pixel) {
    const side = 0.84 * SMALLEST * pixel, rim = side + 1.6 * pixel;
    on.fillStyle = colours.outline;
    for (const some of dots.values()) {
      for (const i of some) {
        if (this.trace.state[this.row[i]]) on.fillRect(this.x[i] - rim / 2, this.y[i] - rim / 2, rim, rim);
      }
    }
    for (const [colour, some] of dots) {
      on.fillStyle = colour;
      for (const i of some) on.fillRect(this.x[i] - side / 2, this.y[i] - side / 2, side, side);
    }
  }

  // A box with its front corners cut, so that one sees where it goes.
  outline(path, i, length, width) {
    const c = Math.cos(this.heading[i]), s = Math.sin(this.heading[i]), x = this.x[i], y = this.y[i];
    const l = length / 2, w = width / 2, cut = Math.min(0.35 * length, 0.55 * width), narrow = 0.4 * w;
    const corners = [-l, -w, l - cut, -w, l, -narrow, l, narrow, l - cut, w, -l, w];
    for (let k = 0; k < 12; k += 2) {
      const px = x + c * corners[k] - s * corners[k + 1], py = y + s * corners[k] + c * corners[k + 1];
      if (k) path.lineTo(px, py); else path.moveTo(px, py);
    }
    path.closePath();
  }

  drawTrails(on, visible, colours, options, pixel) {
    const t = this.trace, paths = t.types.map(() => new Path2D());
    const stroke = (kind) => {
      on.strokeStyle = colours[t.types[kind]];
      on.stroke(paths[kind]);
      paths[kind] = new Path2D();
    };
    on.globalAlpha = 0.55;
    on.lineWidth = (visible.length > MANY ? 1 : 1.6) * pixel; // the thinnest lines are drawn much faster
    const step = Math.max(TRAIL_STEP, (TRAIL_BEND * pixel) / 10);
    for (const [number, i] of visible.entries()) {
      if (number % PATHS === PATHS - 1) t.types.forEach((_, kind) => stroke(kind));
      const path = paths[t.users.kind[t.user[this.row[i]]]];
      let row = this.row[i], drawn = Infinity;
      path.moveTo(this.x[i], this.y[i]);
      for (;; row--) {
        const time = t.time[t.step[row]];
        if (options.time - time > options.trail) break;
        if (drawn - time >= step) {
          path.lineTo(t.x[row], t.y[row]);
          drawn = time;
        }
        if (row === 0 || t.last[row - 1]) break;
      }
    }
    t.types.forEach((_, kind) => stroke(kind));
    on.globalAlpha = 1;
  }

  // The whole path of one road user.
  drawWay(on, user, colours, pixel) {
    const t = this.trace;
    on.beginPath();
    for (const run of t.runs) {
      if (run.user !== user) continue;
      for (let row = run.row; row < run.row + run.count; row++) {
        if (row === run.row) on.moveTo(t.x[row], t.y[row]); else on.lineTo(t.x[row], t.y[row]);
      }
    }
    on.lineWidth = 2 * pixel;
    on.strokeStyle = colours.accent;
    on.setLineDash([6 * pixel, 4 * pixel]);
    on.stroke();
    on.setLineDash([]);
  }

  // Rings round the selected road user, and round the two of a conflict.
  drawMarks(on, colours, options, scale) {
    const ring = (user, colour) => {
      const i = this.find(user);
      if (i < 0) return;
      on.beginPath();
      on.arc(this.x[i], this.y[i], 0.5 * Math.hypot(...this.size(user, scale)) + 6 / scale, 0, 7);
      on.lineWidth = 2.5 / scale;
      on.strokeStyle = colour;
      on.stroke();
    };
    if (options.conflict) {
      const { a, b, kind } = options.conflict, colour = kind === "collision" ? colours.collision : colours.near;
      ring(a, colour);
      ring(b, colour);
    }
    if (options.selected >= 0) ring(options.selected, colours.accent);
  }

  // The place of a road user in this frame, -1 where it is not there.
  find(user) {
    for (let i = 0; i < this.count; i++) if (this.trace.user[this.row[i]] === user) return i;
    return -1;
  }

  // The road user at a point (m), -1 where there is none.
  at(x, y, scale) {
    let best = -1, nearest = Infinity;
    for (let i = 0; i < this.count; i++) {
      const user = this.trace.user[this.row[i]], [length, width] = this.size(user, scale);
      const dx = x - this.x[i], dy = y - this.y[i], c = Math.cos(this.heading[i]), s = Math.sin(this.heading[i]);
      const along = Math.max(Math.abs(c * dx + s * dy) - length / 2, 0);
      const across = Math.max(Math.abs(c * dy - s * dx) - width / 2, 0);
      const away = Math.hypot(along, across), order = away + 1e-3 * Math.hypot(dx, dy);
      if (away <= NEAR_POINTER / scale && order < nearest) [best, nearest] = [user, order];
    }
    return best;
  }

  // What is known about a road user, as lines of text.
  describe(user) {
    const t = this.trace, vtype = t.vtypes[t.users.vtype[user]], name = nameOf(t, user);
    const lines = [t.users.id[user], vtype && vtype !== name ? `${name} (${vtype})` : name];
    const i = this.find(user);
    if (i < 0) return [...lines, "not here now"];
    const row = this.row[i], speed = t.speed[row], state = t.state[row];
    lines.push(`${speed.toFixed(1)} m/s (${(3.6 * speed).toFixed(0)} km/h)`);
    if (this.waited[row] >= 1) lines.push(`has stood for ${this.waited[row].toFixed(0)} s`);
    if (state > 1) lines.push(`mode ${state - 2}`);
    if (state) lines.push("learned"); else if (t.marks_learned) lines.push("moved by SUMO");
    return lines;
  }
}
