"use strict";
// Unpacks what analysis/compact.py has packed.

async function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  const raw = new Uint8Array(await new Response(stream).arrayBuffer());
  const length = new DataView(raw.buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(raw.subarray(4, 4 + length)));
  let at = 4 + length;
  const streams = head.streams.map((size) => raw.subarray(at, (at += size)));
  return { ...head, ...readRows(head, streams) };
}

// Reads zigzag base-128 numbers one after the other. Numbers reach 2**35: bit operations of JavaScript end at 2**31.
function reader(bytes) {
  let at = 0;
  return () => {
    let value = 0, scale = 1, byte;
    do {
      byte = bytes[at++];
      value += (byte & 127) * scale;
      scale *= 128;
    } while (byte > 127);
    return value % 2 ? -(value + 1) / 2 : value / 2;
  };
}

// One typed array per column, over all rows of all runs. `last` says that a row is the last one of its run: between it
// and the road user's next row nothing is known. `rows` lists, from `begin[step]` to `begin[step + 1]`, the road users that are there.
function readRows(head, streams) {
  const [user, first, count, dx, dy, turn, slip, state] = streams.map(reader);
  const ms = Float64Array.from(head.times);
  for (let i = 1; i < ms.length; i++) ms[i] += ms[i - 1];
  const runs = [];
  let total = 0, number = 0;
  for (let at = 0; at < streams[0].length; ) {
    while (streams[0][at++] > 127);
    number += user();
    runs.push({ user: number, step: first(), row: total, count: count() });
    total += runs[runs.length - 1].count;
  }
  const out = {
    time: ms.map((t) => t / 1000), runs,
    user: new Uint32Array(total), step: new Uint32Array(total), last: new Uint8Array(total),
    x: new Float32Array(total), y: new Float32Array(total), heading: new Float32Array(total),
    speed: new Float32Array(total), state: new Uint8Array(total),
    rows: new Uint32Array(total), begin: new Uint32Array(ms.length + 1),
  };
  const { metre, turn: whole, speed: perSpeed } = head.units;
  let origin = null; // the first position: from it Float32 holds 1 cm up to 80 km, where coordinates may be UTM's
  for (const run of runs) {
    let x = 0, y = 0, vx = 0, vy = 0, heading = 0, learned = 0;
    for (let k = 0; k < run.count; k++) {
      const row = run.row + k, step = run.step + k;
      let travelled = 0;
      if (k === 0) { x = dx(); y = dy(); heading = turn(); learned = state(); } else {
        if (k === 1) { vx = dx(); vy = dy(); } else { vx += dx(); vy += dy(); }
        x += vx; y += vy; heading += turn(); learned += state();
        travelled = Math.floor(
          (Math.sqrt(vx * vx + vy * vy) * ((1000 * perSpeed) / metre)) / (ms[step] - ms[step - 1]) + 0.5);
      }
      origin ??= [x, y];
      out.user[row] = run.user;
      out.step[row] = step;
      out.x[row] = (x - origin[0]) / metre;
      out.y[row] = (y - origin[1]) / metre;
      out.heading[row] = (heading * 2 * Math.PI) / whole;
      out.speed[row] = (travelled + slip()) / perSpeed;
      out.state[row] = learned;
      out.begin[step + 1]++;
    }
    out.last[run.row + run.count - 1] = 1;
  }
  for (let i = 0; i < ms.length; i++) out.begin[i + 1] += out.begin[i];
  const next = out.begin.slice();
  for (let row = 0; row < total; row++) out.rows[next[out.step[row]]++] = row;
  out.origin = origin.map((v) => v / metre);
  return out;
}
