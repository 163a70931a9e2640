// The network: shapes put together by colour and width, and a picture of them that is drawn anew when the view changes.

const LAYERS = ["junction0", "walkingarea", "sidewalk", "cycleway", "road", "junction", "crossing", "rail"];
const MARK = 0.12; // m of each side of a lane that its marking takes

class Ground {
  constructor(shapes, origin) {
    const groups = new Map();
    let [x0, y0, x1, y1] = [Infinity, Infinity, -Infinity, -Infinity];
    for (const [what, width, ...points] of shapes) {
      const layer = what === "junction" && !width ? "junction0" : what;
      const key = `${layer} ${width}`;
      if (!groups.has(key)) groups.set(key, { layer, what, width, path: new Path2D() });
      const path = groups.get(key).path;
      let x = 0, y = 0;
      for (let i = 0; i < points.length; i += 2) {
        x += points[i]; y += points[i + 1];
        const px = x / 100 - origin[0], py = y / 100 - origin[1];
        if (i) path.lineTo(px, py); else path.moveTo(px, py);
        x0 = Math.min(x0, px - width); x1 = Math.max(x1, px + width);
        y0 = Math.min(y0, py - width); y1 = Math.max(y1, py + width);
      }
      if (!width) path.closePath();
    }
    this.groups = [...groups.values()].sort((a, b) => LAYERS.indexOf(a.layer) - LAYERS.indexOf(b.layer));
    this.bounds = [x0, y0, x1, y1];
    this.canvas = document.createElement("canvas");
    this.cost = 0; // ms of the last painting
  }

  // Which kinds of ground there are, for the legend.
  kinds() {
    return [...new Set(this.groups.map((group) => group.what))];
  }

  // Puts the ground on `to`. After a change of the view the old picture is moved and scaled until there is time to paint.
  draw(to, view, colours, moving) {
    const { width, height } = to.canvas, canvas = this.canvas, old = this.view;
    const same = old && old.x === view.x && old.y === view.y && old.scale === view.scale && this.colours === colours &&
      canvas.width === width && canvas.height === height;
    if (!same && !(moving && old && this.cost > 12)) this.paint(width, height, view, colours);
    const zoom = view.scale / this.view.scale;
    to.setTransform(1, 0, 0, 1, 0, 0);
    to.fillStyle = colours.back;
    to.fillRect(0, 0, width, height);
    to.drawImage(
      canvas,
      width / 2 - (canvas.width / 2) * zoom + (this.view.x - view.x) * view.scale,
      height / 2 - (canvas.height / 2) * zoom - (this.view.y - view.y) * view.scale,
      canvas.width * zoom, canvas.height * zoom);
    return same || this.view.scale === view.scale;
  }

  paint(width, height, view, colours) {
    const start = performance.now(), canvas = this.canvas;
    canvas.width = width; canvas.height = height;
    const on = canvas.getContext("2d", { alpha: false });
    on.fillStyle = colours.back;
    on.fillRect(0, 0, width, height);
    on.setTransform(...transform(view, width, height));
    on.lineJoin = "round";
    const stroke = (group, colour, line) => {
      on.strokeStyle = colour;
      on.lineWidth = line;
      on.stroke(group.path);
    };
    const fine = view.scale > 2.5;
    for (const group of fine ? this.groups : []) {
      if (group.layer === "road" && group.width) stroke(group, colours.mark, group.width);
    }
    for (const group of this.groups) {
      const colour = colours[group.what];
      if (!group.width) {
        on.fillStyle = colour;
        on.fill(group.path, "evenodd");
      } else if (group.layer === "crossing" && fine) {
        on.setLineDash([0.5, 0.5]);
        stroke(group, colour, group.width);
        on.setLineDash([]);
      } else {
        on.globalAlpha = group.layer === "crossing" ? 0.5 : 1; // as bright as its stripes seen from far away
        stroke(group, colour, fine && group.layer === "road" ? group.width - 2 * MARK : group.width);
        on.globalAlpha = 1;
      }
    }
    this.view = { ...view };
    this.colours = colours;
    this.cost = performance.now() - start;
  }
}

// The canvas transformation for a view: metres east and north of the origin become pixels, north up.
function transform(view, width, height) {
  return [view.scale, 0, 0, -view.scale, width / 2 - view.x * view.scale, height / 2 + view.y * view.scale];
}
