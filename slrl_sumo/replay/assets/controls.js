// The page: what people press, drag and read.

const RATES = [0.25, 0.5, 1, 2, 5, 10, 20];
const TRAILS = [0, 5, 15, 60];
const CLOSE_UP = 60; // m that are seen round a conflict
const GROUND_NAMES = {
  road: "carriageway", junction: "junction", sidewalk: "sidewalk", walkingarea: "walking area", crossing: "crossing",
  cycleway: "cycle lane", rail: "rails",
};
const $ = (id) => document.getElementById(id);

function element(tag, text, parent) {
  const made = document.createElement(tag);
  made.textContent = text; // never as HTML: ids may hold anything
  parent?.append(made);
  return made;
}

class Page {
  constructor(trace) {
    this.trace = trace;
    this.canvas = $("scene");
    this.on = this.canvas.getContext("2d", { alpha: false });
    this.ground = new Ground(trace.ground, trace.origin);
    this.signals = new Signals(trace.signals, trace.origin);
    this.scene = new Scene(trace);
    this.colourings = COLOURINGS;
    this.conflicts = trace.conflicts.map(([near, a, b, time, end, x, y, value]) => ({
      kind: near ? "near miss" : "collision", a, b, time, end, value, x: x - trace.origin[0], y: y - trace.origin[1],
    }));
    [this.begin, this.end] = [trace.time[0], trace.time[trace.time.length - 1]];
    this.state = { time: this.begin, playing: false, rate: 1, trail: 5, selected: -1, conflict: null, colour: "type" };
    this.pointer = null; // where the mouse is, px
    this.moved = 0; // when the view was last moved, ms
    this.frames = 0;
    $("side").hidden = this.narrow(); // there the list covers the scene
    this.fillBar();
    this.fillSide();
    this.listen();
    this.readColours();
    this.resize();
    this.fit();
    readFragment(this);
  }

  fillBar() {
    for (const rate of RATES) element("option", `${rate}×`, $("speed")).value = rate;
    for (const s of TRAILS) element("option", s ? `${s} s` : "off", $("trails")).value = s;
    $("speed").value = this.state.rate;
    $("trails").value = this.state.trail;
    [$("slider").min, $("slider").max] = [this.begin, this.end];
    $("name").textContent = $("name").title = this.trace.title;
    document.title = `${this.trace.title} – replay`;
    for (const name of Object.keys(COLOURINGS)) element("option", name, $("colour")).value = name;
    this.fillLegend();
  }

  fillLegend() {
    const legend = $("legend");
    legend.replaceChildren();
    const row = (text, style) => {
      const line = element("div", "", legend), swatch = element("i", "", line);
      Object.assign(swatch.style, style);
      element("span", text, line);
    };
    for (const [text, colour] of COLOURINGS[this.state.colour].legend(this.trace)) row(text, { background: colour });
    if (this.scene.learned.includes(1)) row("learned: outlined", { border: "2px solid var(--outline)" });
    if (this.signals.all.length) {
      row("signals", { background: "linear-gradient(90deg, var(--stop) 34%, var(--caution) 34% 67%, var(--go) 67%)" });
    }
    for (const what of this.ground.kinds()) {
      row(GROUND_NAMES[what], { background: `var(--${what})`, border: "1px solid var(--line)" });
    }
  }

  fillSide() {
    for (const [word, text] of Object.entries(this.trace.definitions)) {
      element("dt", word, $("definitions"));
      element("dd", text, $("definitions"));
    }
    const check = (text, on) => {
      const label = document.createElement("label"), box = document.createElement("input");
      [box.type, box.checked] = ["checkbox", on];
      label.append(box, text);
      $("filters").append(label);
      box.addEventListener("change", () => this.list());
      return box;
    };
    const many = (kind) => this.conflicts.filter((c) => c.kind === kind).length;
    this.shown = {
      collision: check(`collisions (${many("collision")})`, true),
      "near miss": check(`near misses (${many("near miss")})`, true),
    };
    this.onlyLearned = check("only with learned road users", false);
    const { users, types } = this.trace;
    for (const c of this.conflicts) {
      const item = document.createElement("li");
      c.button = element("button", `${clock(c.time)}  ${c.kind}`, item);
      c.button.className = c.kind === "collision" ? "collision" : "near";
      const kinds = [c.a, c.b].map((user) => types[users.kind[user]]).join(" × ");
      const figure = c.kind === "collision"
        ? (c.value > 0.05 ? `closing at ${c.value.toFixed(1)}\u00a0m/s` : "side by side or parting")
        : `time to collision ${c.value.toFixed(2)}\u00a0s`;
      element("small", `${kinds}, ${figure}`, c.button);
      element("small", `${users.id[c.a]} × ${users.id[c.b]}`, c.button);
      c.button.addEventListener("click", () => this.jump(c));
      c.item = item;
    }
    this.list();
    for (const note of this.trace.notes) element("p", `note: ${note}`, $("notes"));
    $("notes").hidden = !this.trace.notes.length;
    $("unlisted").hidden = !this.trace.unlisted;
    $("unlisted").textContent = `${this.trace.unlisted} further near misses, less close ones, are not listed.`;
  }

  // Puts those conflicts that are wanted into the list and on the timeline.
  list() {
    const learned = this.scene.learned;
    this.listed = this.conflicts.filter(
      (c) => this.shown[c.kind].checked && (!this.onlyLearned.checked || learned[c.a] || learned[c.b]));
    $("conflicts").replaceChildren(...this.listed.map((c) => c.item));
    if (!this.listed.length) element("li", "none", $("conflicts"));
    this.drawMarks();
    this.wake();
  }

  drawMarks() {
    const canvas = $("marks"), ratio = devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    const on = canvas.getContext("2d"), span = Math.max(this.end - this.begin, 1e-9), knob = 8 * ratio;
    for (const kind of ["near miss", "collision"]) {
      on.fillStyle = kind === "collision" ? this.colours?.collision : this.colours?.near;
      for (const c of this.listed ?? []) {
        if (c.kind !== kind) continue;
        on.fillRect(knob + ((c.time - this.begin) / span) * (canvas.width - 2 * knob) - ratio / 2, 0, 1.5 * ratio, canvas.height);
      }
    }
  }

  readColours() {
    const style = getComputedStyle(document.documentElement), names = [
      ..."back text road mark junction sidewalk walkingarea crossing cycleway rail".split(" "),
      ..."car bicycle pedestrian bus tram lorry motorcycle outline edge collision near accent stop caution go off".split(" "),
    ];
    this.colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    this.drawMarks();
    this.wake();
  }

  resize() {
    this.ratio = devicePixelRatio || 1;
    const width = Math.max(1, Math.round(this.canvas.clientWidth * this.ratio));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * this.ratio));
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    this.drawMarks();
    this.wake();
  }

  // The whole network in view.
  fit() {
    const [x0, y0, x1, y1] = this.ground.bounds, { width, height } = this.canvas;
    this.view = {
      x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale: 0.94 * Math.min(width / (x1 - x0 || 1), height / (y1 - y0 || 1)),
    };
    this.smallest = this.view.scale / 8;
    this.wake();
  }

  // px of the canvas's CSS box to metres from the origin, and back.
  toGround(px, py) {
    const { x, y, scale } = this.view;
    return [x + (px * this.ratio - this.canvas.width / 2) / scale, y - (py * this.ratio - this.canvas.height / 2) / scale];
  }

  toScreen(x, y) {
    const view = this.view;
    return [
      ((x - view.x) * view.scale + this.canvas.width / 2) / this.ratio,
      (this.canvas.height / 2 - (y - view.y) * view.scale) / this.ratio,
    ];
  }

  // Zooms so that what lies under a point (px) stays there.
  zoom(factor, px = this.canvas.clientWidth / 2, py = this.canvas.clientHeight / 2) {
    const [x, y] = this.toGround(px, py);
    this.view.scale = Math.min(Math.max(this.view.scale * factor, this.smallest), 200 * this.ratio);
    const [nx, ny] = this.toGround(px, py);
    this.view.x += x - nx;
    this.view.y += y - ny;
    this.touch();
  }

  pan(dx, dy) {
    this.view.x -= (dx * this.ratio) / this.view.scale;
    this.view.y += (dy * this.ratio) / this.view.scale;
    this.touch();
  }

  touch() {
    this.moved = performance.now();
    this.wake();
  }

  play(on) {
    if (on && this.state.time >= this.end) this.state.time = this.begin;
    this.state.playing = on;
    $("play").textContent = on ? "pause" : "play";
    this.before = null;
    this.wake();
  }

  seek(time) {
    this.state.time = Math.min(Math.max(time, this.begin), this.end);
    this.wake();
  }

  // Some time steps of the trace on or back.
  stepBy(count) {
    this.play(false);
    const all = this.trace.time, step = this.scene.stepAt(this.state.time + 1e-9);
    const between = count < 0 && this.state.time > all[step] + 1e-6 ? 1 : 0;
    this.seek(all[Math.min(Math.max(step + count + between, 0), all.length - 1)]);
  }

  jump(conflict) {
    this.play(false);
    this.seek(conflict.time);
    this.state.conflict?.button.classList.remove("current");
    this.state.conflict = conflict;
    conflict.button.classList.add("current");
    const near = Math.min(this.canvas.width, this.canvas.height) / CLOSE_UP;
    this.view = { x: conflict.x, y: conflict.y, scale: Math.max(this.view.scale, near) };
    if (this.narrow()) $("side").hidden = true;
    this.touch();
  }

  jumpBy(count) {
    if (!this.listed.length) return;
    const at = this.listed.indexOf(this.state.conflict);
    const next = this.listed[(at < 0 ? (count > 0 ? 0 : -1) : at + count + this.listed.length) % this.listed.length];
    this.jump(next ?? this.listed.at(-1));
    (next ?? this.listed.at(-1)).button.scrollIntoView({ block: "nearest" });
  }

  // Draws a frame soon; goes on by itself while something moves.
  wake() {
    this.pending ??= requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.pending = null;
    const state = this.state;
    if (state.playing) {
      if (this.before !== null) state.time += Math.min((now - this.before) / 1000, 0.25) * state.rate;
      this.before = now;
      if (state.time >= this.end) {
        state.time = this.end;
        this.play(false);
        this.recorder?.stop();
      }
    }
    if (!this.view) return;
    const moving = performance.now() - this.moved < 120;
    this.ground.draw(this.on, this.view, this.colours, moving);
    this.signals.draw(this.on, this.view, this.colours, state.time);
    this.scene.place(state.time);
    this.scene.draw(this.on, this.view, this.colours, state);
    this.write();
    this.frames++;
    if (state.playing || moving) this.wake();
  }

  // Clock, numbers, scale and tooltip.
  write() {
    const { time } = this.state, slider = $("slider");
    set($("clock"), clock(time));
    set($("count"), `${time.toFixed(1)} s · ${this.scene.count} road users`);
    if (document.activeElement !== slider || this.state.playing) slider.value = time;
    const metres = niceLength((110 * this.ratio) / this.view.scale);
    $("scale-bar").style.width = `${(metres * this.view.scale) / this.ratio}px`;
    set($("scale-text"), metres >= 1000 ? `${metres / 1000} km` : `${metres} m`);
    const { pointer } = this;
    const hovered = pointer ? this.scene.at(...this.toGround(...pointer), this.view.scale) : -1;
    const user = hovered >= 0 ? hovered : this.state.selected, i = user >= 0 ? this.scene.find(user) : -1;
    const tip = $("tooltip");
    tip.hidden = user < 0 || (hovered < 0 && i < 0);
    if (tip.hidden) return;
    set(tip, this.scene.describe(user).join("\n"));
    const [px, py] = hovered >= 0 ? pointer : this.toScreen(this.scene.x[i], this.scene.y[i]);
    const { clientWidth, clientHeight } = this.canvas;
    tip.style.left = `${Math.max(0, Math.min(px + 14, clientWidth - tip.offsetWidth - 4))}px`;
    tip.style.top = `${Math.max(0, Math.min(py + 14, clientHeight - tip.offsetHeight - 4))}px`;
  }

  listen() {
    $("play").addEventListener("click", () => this.play(!this.state.playing));
    $("speed").addEventListener("change", (e) => (this.state.rate = Number(e.target.value)));
    $("trails").addEventListener("change", (e) => {
      this.state.trail = Number(e.target.value);
      this.wake();
    });
    $("slider").addEventListener("input", (e) => this.seek(Number(e.target.value)));
    $("colour").addEventListener("change", (e) => {
      this.state.colour = e.target.value;
      this.fillLegend();
      this.wake();
    });
    $("link").addEventListener("click", () => writeFragment(this));
    $("picture").addEventListener("click", () => savePicture(this));
    $("video").addEventListener("click", () => recordVideo(this));
    addEventListener("hashchange", () => readFragment(this));
    $("fit").addEventListener("click", () => this.fit());
    $("zoom-in").addEventListener("click", () => this.zoom(1.5));
    $("zoom-out").addEventListener("click", () => this.zoom(1 / 1.5));
    $("panel").addEventListener("click", () => this.togglePanel());
    $("explain").addEventListener("click", () => {
      const hidden = ($("definitions").hidden = !$("definitions").hidden);
      $("explain").setAttribute("aria-expanded", String(!hidden));
    });
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.readColours());
    document.addEventListener("keydown", (e) => this.key(e));
    this.listenToPointers();
  }

  narrow() {
    return matchMedia("(max-width: 760px)").matches;
  }

  togglePanel() {
    $("side").hidden = !$("side").hidden;
  }

  key(event) {
    const tag = event.target.tagName;
    // Lists and check boxes keep their keys; so does a button its space.
    if (event.ctrlKey || event.metaKey || event.altKey || tag === "SELECT") return;
    if (event.key === " " && ["BUTTON", "INPUT"].includes(tag) && event.target.id !== "slider") return;
    const second = (s) => this.seek(this.state.time + s);
    const actions = {
      " ": () => this.play(!this.state.playing),
      ArrowRight: () => (event.shiftKey ? second(5) : this.stepBy(1)),
      ArrowLeft: () => (event.shiftKey ? second(-5) : this.stepBy(-1)),
      ArrowUp: () => this.zoom(1.25), ArrowDown: () => this.zoom(1 / 1.25),
      Home: () => this.seek(this.begin), End: () => this.seek(this.end),
      "+": () => this.zoom(1.5), "=": () => this.zoom(1.5), "-": () => this.zoom(1 / 1.5),
      f: () => this.fit(), c: () => this.togglePanel(), n: () => this.jumpBy(1), p: () => this.jumpBy(-1),
      l: () => writeFragment(this), s: () => savePicture(this), v: () => recordVideo(this),
      Escape: () => this.select(-1),
    };
    const action = actions[event.key.length > 1 ? event.key : event.key.toLowerCase()];
    if (!action) return;
    event.preventDefault();
    action();
  }

  select(user) {
    this.state.selected = user;
    this.wake();
  }

  listenToPointers() {
    const canvas = this.canvas, held = new Map();
    let dragged = 0;
    const place = (e) => {
      const box = canvas.getBoundingClientRect();
      return [e.clientX - box.left, e.clientY - box.top];
    };
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      const pixels = e.deltaY * (e.deltaMode === 1 ? 16 : e.deltaMode === 2 ? 400 : 1);
      this.zoom(Math.exp(-Math.max(-240, Math.min(240, pixels)) * (e.ctrlKey ? 0.01 : 0.0016)), ...place(e));
    }, { passive: false });
    canvas.addEventListener("pointerdown", (e) => {
      canvas.setPointerCapture(e.pointerId);
      held.set(e.pointerId, place(e));
      if (held.size === 1) dragged = 0;
      this.pointer = e.pointerType === "mouse" ? place(e) : null;
    });
    canvas.addEventListener("pointermove", (e) => {
      const now = place(e), before = held.get(e.pointerId);
      if (e.pointerType === "mouse") this.pointer = now;
      if (!before) return this.wake();
      const others = [...held].filter(([id]) => id !== e.pointerId);
      held.set(e.pointerId, now);
      dragged += Math.hypot(now[0] - before[0], now[1] - before[1]);
      if (others.length) { // two fingers: their middle stays where it is on the ground, their distance zooms
        const other = others[0][1], apart = (p) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 10);
        const middle = (p) => [(p[0] + other[0]) / 2, (p[1] + other[1]) / 2];
        this.pan(middle(now)[0] - middle(before)[0], middle(now)[1] - middle(before)[1]);
        this.zoom(apart(now) / apart(before), ...middle(now));
      } else if (dragged > 3) {
        canvas.classList.add("dragging");
        this.pan(now[0] - before[0], now[1] - before[1]);
      }
    });
    const release = (e) => {
      if (e.type === "pointerup" && held.has(e.pointerId) && held.size === 1 && dragged <= 3) {
        this.select(this.scene.at(...this.toGround(...place(e)), this.view.scale));
      }
      held.delete(e.pointerId);
      canvas.classList.remove("dragging");
    };
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
    canvas.addEventListener("pointerleave", () => {
      this.pointer = null;
      this.wake();
    });
  }
}

function set(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

// Simulation time as people read it: 1:02.4, or 1:01:02.4 from an hour on.
function clock(seconds) {
  const tenths = Math.round(seconds * 10), minutes = Math.floor(tenths / 600);
  const rest = ((tenths % 600) / 10).toFixed(1).padStart(4, "0"), two = (n) => String(n).padStart(2, "0");
  return minutes < 60 ? `${minutes}:${rest}` : `${Math.floor(minutes / 60)}:${two(minutes % 60)}:${rest}`;
}

// The largest of 1, 2, 5, 10 … metres that is not longer.
function niceLength(metres) {
  const power = 10 ** Math.floor(Math.log10(metres));
  return [5, 2, 1].map((n) => n * power).find((n) => n <= metres) ?? power;
}

var page; // of the window, where other scripts find it
unpack($("data").textContent.trim()).then((trace) => {
  $("data").remove();
  page = new Page(trace);
  document.documentElement.dataset.ready = "yes";
}).catch((error) => {
  $("problem").hidden = false;
  $("problem").textContent = typeof DecompressionStream === "undefined"
    ? "This browser is too old for the page: it needs Chrome 103, Firefox 113 or Safari 16.4, or later ones."
    : `The page cannot be shown: ${error}`;
  throw error;
});
