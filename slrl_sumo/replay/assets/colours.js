// What the colours of road users mean: type, speed, waiting time, learned or not, mode.

const SPEEDS = [0.1, 2, 5, 8, 11, 14, 20], WAITS = [1, 5, 15, 30, 60, 120];
// Viridis and a red scale in steps, light enough on dark and dark enough on light ground.
const SPEED_COLOURS = ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"];
const WAIT_COLOURS = ["#9aa5b1", "#ffd166", "#f8a13f", "#f07030", "#dd3f34", "#b0173f", "#7a0050"];
const GREY = "#9aa5b1";

function nameOf(trace, user) {
  return trace.classes[trace.users.class[user]] || trace.types[trace.users.kind[user]];
}

// s that each road user has stood at its row without a break.
function standingTimes(trace) {
  const out = new Float32Array(trace.user.length);
  for (const run of trace.runs) {
    for (let row = run.row + 1; row < run.row + run.count; row++) {
      if (trace.speed[row] < 0.1) out[row] = out[row - 1] + trace.time[trace.step[row]] - trace.time[trace.step[row - 1]];
    }
  }
  return out;
}

function step(limits, value) {
  const found = limits.findIndex((limit) => value < limit);
  return found < 0 ? limits.length : found;
}

function scale(limits, colours, unit) {
  return colours.map((colour, k) => {
    if (!k) return [`below ${limits[0]} ${unit}`, colour];
    return [k < limits.length ? `${limits[k - 1]} to ${limits[k]} ${unit}` : `${limits[k - 1]} ${unit} and more`, colour];
  });
}

function modeColour(mode) {
  return `hsl(${(mode * 137.5) % 360} 70% 52%)`;
}

const COLOURINGS = {
  type: {
    of: (scene, row, colours) => colours[nameOf(scene.trace, scene.trace.user[row])],
    legend: (trace) => [...new Set(trace.users.id.map((_, user) => nameOf(trace, user)))]
      .map((name) => [name, `var(--${name})`]),
  },
  speed: {
    of: (scene, row) => SPEED_COLOURS[step(SPEEDS, scene.trace.speed[row])],
    legend: () => scale(SPEEDS, SPEED_COLOURS, "m/s"),
  },
  waiting: {
    of: (scene, row) => WAIT_COLOURS[step(WAITS, scene.waited[row])],
    legend: () => scale(WAITS, WAIT_COLOURS, "s stood"),
  },
  learned: {
    of: (scene, row, colours) => (scene.trace.state[row] ? colours.accent : GREY),
    legend: () => [["learned", "var(--accent)"], ["moved by SUMO", GREY]],
  },
  mode: {
    of: (scene, row) => (scene.trace.state[row] > 1 ? modeColour(scene.trace.state[row] - 2) : GREY),
    legend: (trace) => {
      const modes = [...new Set(trace.state)].filter((state) => state > 1).map((state) => state - 2).sort((a, b) => a - b);
      return [...modes.map((mode) => [`mode ${mode}`, modeColour(mode)]), ["no mode", GREY]];
    },
  },
};
