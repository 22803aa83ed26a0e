// Frames that come from Python one by one, drawn as they come, and what is wished for them: style, mix, intensity.

const PAD = 164, MOST = 1.5, RING = 60; // pixels; of the intensity; frames that speeds are averaged over

// A stage whose poses are told: `tell` takes the joints of all characters, [M, J, 3].
class LiveStage extends Stage {
  constructor(view) {
    super(view);
    this.whole = this.path; this.focus = this.path(0); this.path = () => this.focus;
  }

  tell(points) {
    const middle = [0, 0], [x, y, z] = this.focus;
    let at = 0;
    for (const m of this.motions) {
      m.pose.set(points.subarray(at, at += m.pose.length));
      m.place = [m.pose[0], 0, m.pose[2]];
      middle[0] += m.pose[0] / this.motions.length; middle[1] += m.pose[2] / this.motions.length;
    }
    // The camera comes after them in a third of a second, so that it stays calm.
    this.focus = [x + 0.05 * (middle[0] - x), y, z + 0.05 * (middle[1] - z)];
  }

  distance(...seen) {
    const now = this.path;
    this.path = this.whole;
    const far = super.distance(...seen);
    this.path = now;
    return far;
  }

  pose() {
    this.count = 0;
    for (const m of this.motions) this.limbs(m, m.pose);
    this.casting = this.count;
    for (const m of this.motions) this.joints(m, 0.92);
  }

  standing(m) { return m.place || [m.pose[0], 0, m.pose[2]]; }
}

function buildLive(root, model) {
  const styles = model.get("styles"), options = styles.map((s) => `<option>${s}</option>`).join("");
  root.className = "mk-player mk-live";
  root.innerHTML = `<div class="mk-row"><div class="mk-view"><canvas></canvas><div class="mk-labels"></div></div>
    <div class="mk-side"><div class="mk-dial" role="radiogroup" aria-label="Style">${styles.map((s) => `<button>${s}</button>`).join("")}</div>
      <div class="mk-pad" tabindex="0" role="slider" aria-label="Mix of two styles, left and right; intensity, up and down"><canvas></canvas></div>
      <div class="mk-two"><select class="mk-left" aria-label="Left style">${options}</select><select class="mk-right" aria-label="Right style">${options}</select></div>
      <label class="mk-strong">intensity <input type="range" min="0" max="${MOST}" step="0.01"><output></output></label></div></div>
    <div class="mk-bar"><button class="mk-play" title="Play or pause"></button><output class="mk-said"></output>
      <button class="mk-home" title="First view">${icon("home")}</button></div>`;
  const find = (name) => root.querySelector(name);
  find(".mk-view").style.height = `${model.get("height")}px`;
  return { root, view: find(".mk-view"), canvas: find(".mk-view canvas"), labels: find(".mk-labels"), play: find(".mk-play"), said: find(".mk-said"),
    home: find(".mk-home"), dial: [...find(".mk-dial").children], pad: find(".mk-pad"), ink: find(".mk-pad canvas"),
    left: find(".mk-left"), right: find(".mk-right"), strong: find(".mk-strong input"), told: find(".mk-strong output") };
}

class Live extends View {
  constructor(root, model) {
    super(buildLive(root, model));
    this.model = model; this.time = 0; this.came = []; this.stats.came = 0;
    this.stage = new LiveStage(model.get("_data"));
    for (const m of this.stage.motions) poseAt(m, 0, m.pose);
    this.nameAll(); this.restyle(); this.camera.home(this.stage); this.listen(); this.resize(); this.showWish(); this.showPlaying();
    model.send({ hello: true });
  }

  listen() {
    const { ui, model } = this, set = (values) => { Object.entries(values).forEach((pair) => model.set(...pair)); model.save_changes(); this.showWish(); };
    this.on(ui.play, "click", () => { set({ playing: !model.get("playing") }); this.showPlaying(); model.send({ hello: true }); });
    this.on(ui.home, "click", () => { this.camera.home(this.stage); this.wake(); });
    this.on(ui.left, "change", () => set({ left: ui.left.value }));
    this.on(ui.right, "change", () => set({ right: ui.right.value }));
    this.on(ui.strong, "input", () => set({ strength: Number(ui.strong.value) }));
    ui.dial.forEach((chip) => this.on(chip, "click", () => set(model.get("mix") > 0.5 ? { right: chip.textContent, mix: 1 } : { left: chip.textContent, mix: 0 })));
    const drag = (e) => {
      const box = ui.ink.getBoundingClientRect(), x = (e.clientX - box.left) / box.width, y = 1 - (e.clientY - box.top) / box.height;
      set({ mix: Math.round(100 * clamp(x, 0, 1)) / 100, strength: Math.round(100 * MOST * clamp(y, 0, 1)) / 100 });
    };
    this.on(ui.pad, "pointerdown", (e) => { ui.pad.setPointerCapture(e.pointerId); drag(e); });
    this.on(ui.pad, "pointermove", (e) => e.buttons && drag(e));
    this.on(ui.pad, "keydown", (e) => {
      const step = { ArrowLeft: [-0.05, 0], ArrowRight: [0.05, 0], ArrowUp: [0, 0.05], ArrowDown: [0, -0.05] }[e.key];
      if (!step) return;
      e.preventDefault(); e.stopPropagation();
      set({ mix: clamp(model.get("mix") + step[0], 0, 1), strength: clamp(model.get("strength") + step[1], 0, MOST) });
    });
    steer(ui.canvas, this.camera, () => this.wake(), () => ui.root.contains(document.activeElement));
    const hear = (message, buffers) => this.hear(message, buffers), wish = () => this.showWish(), play = () => this.showPlaying();
    model.on("msg:custom", hear);
    this.undo.push(() => model.off("msg:custom", hear));
    for (const [name, act] of [["left", wish], ["right", wish], ["mix", wish], ["strength", wish], ["playing", play]]) {
      model.on(`change:${name}`, act);
      this.undo.push(() => model.off(`change:${name}`, act));
    }
    this.watch();
  }

  // The pad is painted in the page's colours, which are known once it is part of the page.
  restyle() {
    super.restyle();
    requestAnimationFrame(() => { if (!this.gone) this.showWish(); });
  }

  hear(message, [buffer]) {
    const bytes = new Uint8Array(buffer.buffer ?? buffer, buffer.byteOffset ?? 0, buffer.byteLength);
    this.stage.tell(new Float32Array(bytes.slice().buffer));
    this.model.send({ seen: message.n });
    this.stats.came += 1;
    this.came.push(performance.now());
    if (this.came.length > RING) this.came.shift();
    this.message = message;
    this.wake();
  }

  tick() {
    this.waiting = 0;
    if (this.gone || this.hidden || !this.ui.view.clientWidth) return;
    const start = performance.now();
    if (this.moving()) this.pace(start);
    this.last = start;
    this.picture();
    this.stats.frames += 1; this.stats.busy += performance.now() - start;
    this.showMessage(start);
  }

  showMessage(now) {
    const { came, message } = this;
    if (!message || now - (this.wrote || 0) < 250) return;
    this.wrote = now;
    this.rate = came.length > 1 ? 1000 * (came.length - 1) / (came.at(-1) - came[0]) : 0;
    this.ui.said.textContent = `${this.rate.toFixed(0)} frames/s come in · ${message.ms.toFixed(2)} ms for one · ${message.trip.toFixed(0)} ms there and back`
      + ` · input: ${message.label}`;
  }

  showPlaying() { this.ui.play.innerHTML = icon(this.model.get("playing") ? "pause" : "play"); this.last = undefined; this.came = []; this.wake(); }

  showWish() {
    const { ui, model } = this, [left, right, mix, strength] = ["left", "right", "mix", "strength"].map((name) => model.get(name));
    ui.left.value = left; ui.right.value = right; ui.strong.value = strength;
    const beyond = strength > 1 ? " extrapolated" : "";
    ui.told.textContent = `${strength.toFixed(2)}${beyond}`;
    const shares = { [left]: 1 - mix };
    shares[right] = (shares[right] || 0) + mix;
    ui.dial.forEach((chip) => { const share = shares[chip.textContent] || 0; chip.style.setProperty("--mk-share", `${(100 * share).toFixed(0)}%`); chip.setAttribute("aria-pressed", share > 0.5); });
    const name = mix <= 0 ? left : mix >= 1 ? right : `${Math.round(100 * (1 - mix))} % ${left}, ${Math.round(100 * mix)} % ${right}`;
    const label = this.ui.labels.lastElementChild, m = this.stage.motions.at(-1);
    if (label) { label.textContent = name; m.labelWidth = 0; }
    this.drawPad(mix, strength, left, right);
    this.wake();
  }

  drawPad(mix, strength, left, right) {
    const { ink, root } = this.ui, ratio = Math.max(2, window.devicePixelRatio || 1), g = ink.getContext("2d"), css = getComputedStyle(root);
    const colour = (name) => css.getPropertyValue(name).trim(), y = (s) => PAD - PAD * s / MOST;
    ink.width = ink.height = PAD * ratio; ink.style.width = ink.style.height = `${PAD}px`;
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.fillStyle = colour("--mk-low"); g.fillRect(0, 0, PAD, PAD);
    g.fillStyle = colour("--mk-line"); g.fillRect(0, 0, PAD, y(1)); // beyond what was learned from
    Object.assign(g, { strokeStyle: colour("--mk-soft"), lineWidth: 1, fillStyle: colour("--mk-soft"), font: "11px system-ui, sans-serif" });
    g.setLineDash([3, 3]);
    for (const [a, b] of [[[0, y(1)], [PAD, y(1)]], [[PAD / 2, 0], [PAD / 2, PAD]]]) { g.beginPath(); g.moveTo(...a); g.lineTo(...b); g.stroke(); }
    g.setLineDash([]);
    const say = (text, x, y, side) => { g.textAlign = side; g.fillText(text, x, y); };
    say("beyond", PAD / 2 + 5, 13, "left"); say("all of it", PAD / 2 + 5, y(1) + 13, "left"); say("neutral", PAD / 2 + 5, PAD - 6, "left");
    say(left, 6, y(0.5), "left"); say(right, PAD - 6, y(0.5), "right");
    g.beginPath(); g.arc(clamp(mix * PAD, 7, PAD - 7), clamp(y(strength), 7, PAD - 7), 7, 0, 2 * Math.PI);
    g.fillStyle = colour("--mk-accent"); g.fill(); g.lineWidth = 2; g.strokeStyle = colour("--mk-bar"); g.stroke();
  }

  close() { this.model.send({ bye: true }); super.close(); }
}

function render({ model, el }) {
  const root = document.createElement("div"), live = new Live(root, model);
  el.append(root);
  root.motionkit = live;
  return () => live.close();
}

export default { render };
