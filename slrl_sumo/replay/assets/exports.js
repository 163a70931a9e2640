// What leaves the page: a link to a moment and a road user, a picture, a video.

const FRAMES = 30; // per second of a video

// #t=12.4&id=car.3&x=…&y=…&scale=…&colour=speed: time in s, the selected road user, the middle of the view in m.
function readFragment(page) {
  const given = new URLSearchParams(location.hash.slice(1)), number = (name) => parseFloat(given.get(name));
  const [ox, oy] = page.trace.origin;
  if (Object.hasOwn(COLOURINGS, given.get("colour") ?? "")) {
    $("colour").value = page.state.colour = given.get("colour");
    page.fillLegend();
  }
  if (Number.isFinite(number("t"))) {
    page.play(false);
    page.seek(number("t"));
  }
  const user = page.trace.users.id.indexOf(given.get("id"));
  if (user >= 0) {
    page.select(user);
    page.scene.place(page.state.time);
    const i = page.scene.find(user);
    if (i >= 0) {
      const near = Math.min(page.canvas.width, page.canvas.height) / (2 * CLOSE_UP);
      page.view = { x: page.scene.x[i], y: page.scene.y[i], scale: Math.max(page.view.scale, near) };
    }
  }
  if (number("scale") > 0 && Number.isFinite(number("x") + number("y"))) {
    page.view = { x: number("x") - ox, y: number("y") - oy, scale: number("scale") * page.ratio };
  }
  page.touch();
}

function writeFragment(page) {
  const { state, view, trace } = page, [ox, oy] = trace.origin;
  const words = new URLSearchParams({
    t: state.time.toFixed(1), x: (view.x + ox).toFixed(1), y: (view.y + oy).toFixed(1),
    scale: (view.scale / page.ratio).toFixed(3), colour: state.colour,
  });
  if (state.selected >= 0) words.set("id", trace.users.id[state.selected]);
  location.hash = words;
  navigator.clipboard?.writeText(location.href).catch(() => {}); // files may not use it in every browser
}

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function fileName(page, ending) {
  return `${page.trace.title.replace(/[^\w.-]+/g, "_")}-${page.state.time.toFixed(1)}s.${ending}`;
}

// The scene with its title and clock.
function savePicture(page) {
  const { width, height } = page.canvas, copy = document.createElement("canvas");
  [copy.width, copy.height] = [width, height];
  const on = copy.getContext("2d"), size = Math.round(15 * page.ratio);
  on.drawImage(page.canvas, 0, 0);
  on.font = `${size}px system-ui, sans-serif`;
  on.fillStyle = page.colours.text;
  on.fillText(`${page.trace.title}  ${clock(page.state.time)}`, size, 1.6 * size);
  copy.toBlob((blob) => save(blob, fileName(page, "png")));
}

// Plays, and records what is drawn until the end or until pressed again.
function recordVideo(page) {
  if (page.recorder) {
    page.recorder.stop();
    return;
  }
  const parts = [], stream = page.canvas.captureStream(FRAMES);
  const type = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm"].find((t) => MediaRecorder.isTypeSupported(t));
  const recorder = (page.recorder = new MediaRecorder(stream, { mimeType: type, videoBitsPerSecond: 8e6 }));
  recorder.addEventListener("dataavailable", (e) => parts.push(e.data));
  recorder.addEventListener("stop", () => {
    page.recorder = null;
    page.play(false);
    $("video").classList.remove("recording");
    $("video").textContent = "video";
    stream.getTracks().forEach((track) => track.stop());
    save(new Blob(parts, { type: "video/webm" }), fileName(page, "webm"));
  });
  $("video").classList.add("recording");
  $("video").textContent = "stop";
  recorder.start();
  page.play(true);
}
