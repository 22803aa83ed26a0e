// Two ways to look at the numbers behind a motion: where it faces, from above, and one feature at a time.

const INK = "#39424e", SOFT = "#7a8491", LINE = "#dde2e9", LABELS = 132, HEAD = 62;

function floats(view) {
  const bytes = new Uint8Array(view.buffer ?? view, view.byteOffset ?? 0, view.byteLength);
  return new Float32Array(bytes.slice().buffer);
}

function make(parent, tag, name, text = "") {
  const found = document.createElement(tag);
  found.className = name;
  found.textContent = text;
  parent.append(found);
  return found;
}

// A canvas that stays sharp on any screen; draw(g, width, height) is called with CSS pixels.
function board(parent, width, height) {
  const canvas = make(parent, "canvas", "mk-board"), scale = Math.max(2, window.devicePixelRatio || 1);
  Object.assign(canvas, { width: width * scale, height: height * scale });
  Object.assign(canvas.style, { width: `${width}px`, height: `${height}px` });
  const g = canvas.getContext("2d");
  return { canvas, draw(paint) { g.setTransform(scale, 0, 0, scale, 0, 0); g.clearRect(0, 0, width, height); paint(g, width, height); } };
}

function line(g, points, colour, width, dash = []) {
  g.beginPath();
  points.forEach(([x, y], n) => (n ? g.lineTo(x, y) : g.moveTo(x, y)));
  Object.assign(g, { strokeStyle: colour, lineWidth: width, lineCap: "round", lineJoin: "round" });
  g.setLineDash(dash);
  g.stroke();
  g.setLineDash([]);
}

function disc(g, [x, y], radius, fill, edge = null, width = 1.5) {
  g.beginPath();
  g.arc(x, y, radius, 0, 2 * Math.PI);
  if (fill) { g.fillStyle = fill; g.fill(); }
  if (edge) { g.strokeStyle = edge; g.lineWidth = width; g.stroke(); }
}

function arrow(g, from, to, colour, width) {
  const angle = Math.atan2(to[1] - from[1], to[0] - from[0]), size = 3.2 * width;
  const tip = (turn) => [to[0] - size * Math.cos(angle + turn), to[1] - size * Math.sin(angle + turn)];
  line(g, [from, to], colour, width);
  line(g, [tip(0.5), to, tip(-0.5)], colour, width);
}

function words(g, text, x, y, { colour = SOFT, size = 11, align = "left", weight = "400" } = {}) {
  Object.assign(g, { fillStyle: colour, font: `${weight} ${size}px system-ui, sans-serif`, textAlign: align });
  g.fillText(text, x, y);
}

// Bones as thick lines, the farthest first. seen(j) gives [x, y, depth] in pixels; scale: pixels a metre.
function drawBody(g, look, seen, scale) {
  const order = look.bones.map(([p, c]) => [seen(p), seen(c), c]).sort((a, b) => a[0][2] + a[1][2] - b[0][2] - b[1][2]);
  for (const [a, b, child] of order) {
    const width = Math.max(3, 2 * scale * look.radii[child]);
    line(g, [a, b], look.edges[child], width + 1.6);
    line(g, [a, b], look.colours[child], width);
    if (child === look.head) disc(g, b, scale * look.head_radius, look.colours[child], look.edges[child]);
  }
}

// What both views share: the clip, a play button, a slider over frames, a line of text.
class View {
  constructor(model, el) {
    this.model = model;
    this.look = JSON.parse(model.get("_look"));
    this.points = floats(model.get("_points"));
    this.root = make(el, "div", "mk-inspect");
    this.stage = make(this.root, "div", "mk-stage");
    this.controls();
    this.build();
    this.follow = () => this.update();
    model.on("change:frame change:number", this.follow);
    this.update();
  }

  controls() {
    const bar = make(this.root, "div", "mk-row"), { frames, fps } = this.look;
    this.button = make(bar, "button", "mk-go", "▶");
    this.button.title = "play";
    this.slider = this.range(bar, "frame", frames - 1);
    this.said = make(this.root, "div", "mk-said");
    this.button.onclick = () => {
      this.clock = this.clock ? null : { at: performance.now(), frame: this.model.get("frame") };
      this.button.textContent = this.clock ? "❚❚" : "▶";
      if (this.clock) requestAnimationFrame(() => this.tick());
    };
    this.tick = () => {
      if (!this.clock) return;
      const gone = Math.floor(((performance.now() - this.clock.at) / 1000) * fps);
      this.put("frame", (this.clock.frame + gone) % frames);
      requestAnimationFrame(() => this.tick());
    };
  }

  range(parent, name, most) {
    make(parent, "label", "mk-name", name);
    const slider = make(parent, "input", `mk-range mk-${name}`);
    Object.assign(slider, { type: "range", min: 0, max: most, step: 1 });
    slider.oninput = () => this.put(name, Number(slider.value));
    return slider;
  }

  put(name, value) {
    if (this.model.get(name) === value) return;
    this.model.set(name, value);
    this.update();
    clearTimeout(this.later); // the kernel need not hear of every frame that passes
    this.later = setTimeout(() => this.model.save_changes(), 120);
  }

  at(frame, joint) {
    const n = 3 * (frame * this.look.joints + joint);
    return [this.points[n], this.points[n + 1], this.points[n + 2]];
  }

  update() {
    this.slider.value = this.model.get("frame");
    this.paint(this.model.get("frame"));
  }

  close() {
    this.clock = null;
    this.model.off("change:frame change:number", this.follow);
  }
}

class Facing extends View {
  build() {
    this.world = board(this.stage, 380, 340);
    this.body = board(this.stage, 340, 340);
  }

  paint(frame) {
    const { box, root, yaw, colour } = this.look, [x0, z0, size] = box, angle = yaw[frame];
    const [px, , pz] = this.at(frame, this.look.pelvis), c = Math.cos(angle), s = Math.sin(angle);
    this.world.draw((g, w, h) => {
      const k = Math.min(w, h - 24) / size;
      this.seenFromAbove(g, frame, k, (x, z) => [w / 2 - (x - x0) * k, (h + 24) / 2 - (z - z0) * k]);
      words(g, "as the world sees it", 10, 17, { colour: INK, size: 12.5, weight: "600" });
    });
    this.body.draw((g, w, h) => {
      const k = h / 2.1, turn = (x, z) => [c * (x - px) - s * (z - pz), s * (x - px) + c * (z - pz)];
      this.seenFromAbove(g, frame, k, (x, z) => { const [a, b] = turn(x, z); return [w / 2 - a * k, 0.58 * h - b * k]; });
      words(g, "as the body sees it", 10, 17, { colour: INK, size: 12.5, weight: "600" });
    });
    const [turn, left, ahead, height] = root.map((row) => row[frame]), degrees = (v) => `${((v * 180) / Math.PI).toFixed(1)}°`;
    this.said.innerHTML = `frame <b>${frame}</b> · faces <b>${degrees(angle)}</b> · turns <b>${degrees(turn)}</b> a frame · ` +
      `goes <b>${(1000 * left).toFixed(0)} mm</b> left and <b>${(1000 * ahead).toFixed(0)} mm</b> ahead a frame · pelvis at <b>${height.toFixed(2)} m</b>`;
    this.root.style.setProperty("--mk-tint", colour);
  }

  seenFromAbove(g, frame, k, to) {
    const { box, yaw, colour, deep, pelvis, frames } = this.look, [x0, z0, size] = box, reach = size / 2 + 2;
    for (let n = Math.floor(-reach / 0.5); n <= reach / 0.5; n++) {
      const at = 0.5 * n, x = Math.round(x0 * 2) / 2 + at, z = Math.round(z0 * 2) / 2 + at;
      line(g, [to(x, z0 - reach), to(x, z0 + reach)], LINE, 1);
      line(g, [to(x0 - reach, z), to(x0 + reach, z)], LINE, 1);
    }
    const path = Array.from({ length: frames }, (_, n) => this.at(n, pelvis)).map(([x, , z]) => to(x, z));
    line(g, path, colour, 1.5, [1, 5]);
    line(g, path.slice(0, frame + 1), colour, 3);
    drawBody(g, this.look, (j) => { const [x, y, z] = this.at(frame, j); return [...to(x, z), y]; }, k);
    const [x, , z] = this.at(frame, pelvis), d = 0.62;
    arrow(g, to(x, z), to(x + d * Math.sin(yaw[frame]), z + d * Math.cos(yaw[frame])), deep, 4);
  }
}

class Features extends View {
  build() {
    const { parts, size } = this.look;
    this.values = floats(this.model.get("_values"));
    this.skeleton = board(this.stage, 180, 330);
    this.side = make(this.stage, "div", "mk-side");
    const rows = parts.reduce((sum, p) => sum + p.components.length, 0);
    this.cell = [Math.min(17, 400 / (this.look.joints + 1)), Math.min(17, 250 / rows)];
    this.keys = board(this.side, LABELS + this.cell[0] * (this.look.joints + 1) + 4, HEAD + 4 + rows * this.cell[1] + 8 * parts.length);
    this.curve = board(this.side, LABELS + this.cell[0] * (this.look.joints + 1) + 4, 84);
    this.keys.canvas.onmousemove = this.keys.canvas.onclick = (event) => this.choose(event);
    const drag = (event) => { if (event.buttons || event.type === "click") this.put("frame", this.frameAt(event)); };
    this.curve.canvas.onmousemove = this.curve.canvas.onclick = drag;
    this.place();
    const bar = make(this.root, "div", "mk-row");
    this.which = this.range(bar, "number", size - 1);
    this.root.append(this.said);
  }

  // Where each number's key lies: a column for the whole body and one for each joint, rows by component.
  place() {
    const { parts, joints_of } = this.look, [w, h] = this.cell;
    this.boxes = [];
    let top = HEAD;
    for (const part of parts) {
      const many = part.components.length;
      part.top = top;
      for (let n = part.start; n < part.stop; n++) {
        const column = joints_of[n] === null ? 0 : joints_of[n] + 1;
        this.boxes[n] = [LABELS + column * w, top + ((n - part.start) % many) * h];
      }
      top += many * h + 8;
    }
  }

  choose(event) {
    const x = event.offsetX, y = event.offsetY, [w, h] = this.cell;
    const found = this.boxes.findIndex(([a, b]) => x >= a && x < a + w && y >= b && y < b + h);
    if (found >= 0) this.put("number", found);
  }

  frameAt(event) {
    const part = (event.offsetX - LABELS) / (this.curve.canvas.clientWidth - LABELS - 6);
    return Math.round(Math.min(Math.max(part, 0), 1) * (this.look.frames - 1));
  }

  paint(frame) {
    const { describe, size, joints_of, mark } = this.look, number = this.model.get("number");
    const value = this.values[frame * size + number];
    this.which.value = number;
    this.skeleton.draw((g, w, h) => this.paintSkeleton(g, w, h, frame, number));
    this.keys.draw((g) => this.paintKeys(g, frame, number));
    this.curve.draw((g, w, h) => this.paintCurve(g, w, h, frame, number));
    this.said.innerHTML = `number <b style="color: ${mark}">${number}</b>: <b></b> = ${value.toFixed(4)} in frame ${frame}`;
    this.said.children[1].textContent = describe[number];
    this.said.dataset.joint = joints_of[number] === null ? "" : this.look.names[joints_of[number]];
  }

  paintSkeleton(g, w, h, frame, number) {
    const { view, floor, tall, joints_of, axis_of, mark, pelvis, names } = this.look, k = (h - 60) / tall;
    const to = (p) => view.map((row) => row[0] * p[0] + row[1] * p[1] + row[2] * p[2]);
    const seen = (p) => { const [a, b, c] = to(p); return [w / 2 + a * k, h - 26 - (b - floor) * k, c]; };
    disc(g, seen([0, 0, 0]), 0, null);
    drawBody(g, this.look, (j) => seen(this.at(frame, j)), k);
    const joint = joints_of[number], at = this.at(frame, joint === null ? pelvis : joint), axis = axis_of[number];
    if (axis !== null) {
      const tip = at.map((v, n) => v + (n === axis ? 0.34 : 0)), back = at.map((v, n) => v - (n === axis ? 0.12 : 0));
      arrow(g, seen(back), seen(tip), mark, 3);
      const [x, y] = seen(at.map((v, n) => v + (n === axis ? 0.46 : 0)));
      words(g, "xyz"[axis], x, y + 4, { colour: mark, size: 13, align: "center", weight: "700" });
    }
    disc(g, seen(at), 7, "rgba(255,255,255,0.75)", mark, 3);
    words(g, joint === null ? "the whole body" : names[joint], w / 2, h - 5, { colour: mark, size: 13, align: "center", weight: "600" });
  }

  paintKeys(g, frame, number) {
    const { parts, size, means, spreads, colours, joints, joints_of, mark, names, never } = this.look, [w, h] = this.cell;
    for (let j = -1; j < joints; j++) {  // names of the columns, upright; the colour tells the side
      const lit = (joints_of[number] ?? -1) === j, name = j < 0 ? "body" : names[j].replace(/^(left|right)_/, "");
      g.save();
      g.translate(LABELS + (j + 1.5) * w + 3.5, HEAD - 5);
      g.rotate(-Math.PI / 2);
      words(g, name, 0, 0, { colour: lit ? mark : j < 0 ? INK : colours[j], size: 10, weight: lit ? "700" : "400" });
      g.restore();
    }
    for (const part of parts) {
      words(g, part.name, 4, part.top + 0.5 * h + 4, { colour: INK, size: 12, weight: "600" });
      part.components.forEach((c, n) => words(g, c, LABELS - 6, part.top + (n + 0.5) * h + 3.5, { size: Math.min(10, h - 2), align: "right" }));
    }
    this.boxes.forEach(([x, y], n) => {
      const z = spreads[n] ? Math.max(-1, Math.min(1, (this.values[frame * size + n] - means[n]) / spreads[n] / 2)) : 0;
      const far = z > 0 ? [221, 115, 49] : [43, 108, 168], part = Math.abs(z);
      g.fillStyle = spreads[n] ? `rgb(${far.map((v) => Math.round(247 + (v - 247) * part)).join()})` : never;
      g.fillRect(x + 0.75, y + 0.75, w - 1.5, h - 1.5);
    });
    const [x, y] = this.boxes[number];
    Object.assign(g, { strokeStyle: mark, lineWidth: 2.5 });
    g.strokeRect(x - 0.5, y - 0.5, w + 1, h + 1);
  }

  paintCurve(g, w, h, frame, number) {
    const { frames, size, mark } = this.look, all = Array.from({ length: frames }, (_, f) => this.values[f * size + number]);
    const low = Math.min(...all), high = Math.max(...all), span = Math.max(high - low, 1e-6), wide = (w - LABELS - 6) / Math.max(frames - 1, 1);
    const to = (f) => [LABELS + f * wide, high - low < 1e-6 ? h / 2 : h - 10 - ((all[f] - low) / span) * (h - 20)];
    line(g, [[LABELS, h - 4], [w - 6, h - 4]], LINE, 1);
    line(g, all.map((_, f) => to(f)), INK, 1.8);
    line(g, [[LABELS + frame * wide, 2], [LABELS + frame * wide, h - 4]], mark, 1);
    disc(g, to(frame), 4.5, mark);
    words(g, high.toPrecision(3), LABELS - 6, 14, { size: 10, align: "right" });
    words(g, low.toPrecision(3), LABELS - 6, h - 6, { size: 10, align: "right" });
    words(g, "over time", 4, h / 2 + 4, { colour: INK, size: 12, weight: "600" });
  }
}

function hideStill(name) {
  // The still picture is for pages without a kernel; a rule hides it as long as the live view is there.
  const style = document.createElement("style");
  style.textContent = `.${name}, .jp-OutputArea-child:has(.${name}) { display: none !important; }`;
  document.head.append(style);
  return () => style.remove();
}

function render({ model, el }) {
  const view = model.get("_kind") === "facing" ? new Facing(model, el) : new Features(model, el), show = hideStill(model.get("_still"));
  return () => { view.close(); show(); };
}

export default { render };
