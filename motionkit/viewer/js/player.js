// The player around a stage: clock, controls, keyboard, labels, and the exchange of frame, playing and speed with Python.

const LOOKS = {
  light: { tileA: [0.945, 0.953, 0.965], tileB: [0.893, 0.909, 0.93], dim: [0.25, 0.31, 0.42, 0.62] },
  dark: { tileA: [0.165, 0.187, 0.216], tileB: [0.2, 0.225, 0.258], dim: [0.03, 0.04, 0.055, 0.8] },
};
const ICONS = {
  play: '<path d="M7 4.5v15l13-7.5z"/>',
  pause: '<path d="M6 4.5h4.2v15H6zm7.8 0H18v15h-4.2z"/>',
  loop: '<path d="M7 7h9v2.6L20.5 6 16 2.4V5H5v7h2zm10 10H8v-2.6L3.500 18 8 21.600V19h11v-7h-2z"/>',
  follow: '<path d="M12 3.500a4 4 0 1 1 0 8 4 4 0 0 1 0-8zM4.500 20.500c0-4.400 3.300-7 7.500-7s7.500 2.600 7.500 7z"/>',
  home: '<path d="M4 4h6v2H6v4H4zm10 0h6v6h-2V6h-4zM4 14h2v4h4v2H4zm14 0h2v6h-6v-2h4z"/>',
};
const SPEEDS = [0.1, 0.25, 0.5, 1, 1.5, 2, 4];
const SEND_EVERY = 120; // ms between two reports of the frame to Python

const icon = (name) => `<svg viewBox="0 0 24 24" width="18" height="18" aria-hidden="true">${ICONS[name]}</svg>`;

function build(root, height) {
  root.className = "mk-player";
  root.tabIndex = 0;
  root.setAttribute("role", "application");
  root.setAttribute("aria-label", "Motion player. Space plays and pauses, arrow keys step through frames.");
  root.innerHTML = `<div class="mk-view"><canvas></canvas><div class="mk-labels"></div></div>
    <div class="mk-bar">
      <button class="mk-play" title="Play or pause (space)"></button>
      <input class="mk-scrub" type="range" min="0" step="any" aria-label="Time">
      <output class="mk-read"></output>
      <select class="mk-speed" title="Speed" aria-label="Speed"></select>
      <button class="mk-loop" title="Play again from the start at the end">${icon("loop")}</button>
      <button class="mk-follow" title="Let the camera follow">${icon("follow")}</button>
      <button class="mk-home" title="First view (double click)">${icon("home")}</button>
    </div>`;
  const find = (name) => root.querySelector(name);
  find(".mk-view").style.height = `${height}px`;
  return { root, view: find(".mk-view"), canvas: find("canvas"), labels: find(".mk-labels"), play: find(".mk-play"), scrub: find(".mk-scrub"),
    read: find(".mk-read"), speed: find(".mk-speed"), loop: find(".mk-loop"), follow: find(".mk-follow"), home: find(".mk-home") };
}

function isDark() {
  const { body } = document, jupyter = body.dataset.jpThemeLight;
  if (jupyter) return jupyter === "false";
  if (body.dataset.vscodeThemeKind) return !body.dataset.vscodeThemeKind.includes("light");
  return matchMedia("(prefers-color-scheme: dark)").matches;
}

class Player {
  constructor(root, model) {
    this.model = model; this.camera = new Camera(); this.ui = build(root, model.get("height"));
    this.time = 0; this.sent = 0; this.drawn = 0; this.stats = { frames: 0, busy: 0 };
    try { this.view = new GlView(this.ui.canvas); } catch (error) {
      // A canvas that has refused WebGL still gives a plain 2D context, unless it was half made: then a fresh one.
      const fresh = this.ui.canvas.cloneNode(); this.ui.canvas.replaceWith(fresh); this.ui.canvas = fresh;
      this.view = new FlatView(fresh);
      this.stats.why = String(error);
    }
    this.stats.kind = this.view.constructor.name;
    this.undo = [];
    this.listen(); this.restyle(); this.load(true); this.seek(model.get("frame") / this.stage.fps);
    this.showPlaying(); this.showSpeed(); this.showLoop(); this.resize();
  }

  load(first) {
    this.stage = new Stage(this.model.get("_data"));
    this.ui.scrub.max = this.stage.end;
    this.ui.labels.replaceChildren(...this.stage.motions.map((m) => {
      const label = document.createElement("span");
      label.textContent = m.label; label.style.setProperty("--mk-role", m.role); label.hidden = !m.label;
      return label;
    }));
    if (first || this.stage.motions.length !== this.standing) this.camera.home(this.stage);
    this.camera.fitted = "";
    this.standing = this.stage.motions.length;
    this.time = Math.min(this.time, this.stage.end);
    this.ui.follow.classList.toggle("mk-on", this.camera.follow);
    this.restyle();
  }

  // Adds a listener and remembers how to take it away again.
  on(target, name, act, options) {
    target.addEventListener(name, act, options);
    this.undo.push(() => target.removeEventListener(name, act, options));
  }

  listen() {
    const { ui, model } = this;
    this.on(ui.play, "click", () => this.setPlaying(!model.get("playing")));
    this.on(ui.scrub, "input", () => { this.seek(Number(ui.scrub.value)); this.report(true); });
    this.on(ui.speed, "change", () => this.tell({ speed: Number(ui.speed.value) }));
    this.on(ui.loop, "click", () => { this.tell({ loop: !model.get("loop") }); this.showLoop(); });
    this.on(ui.follow, "click", () => this.setFollow(!this.camera.follow));
    this.on(ui.home, "click", () => this.goHome());
    this.on(ui.view, "dblclick", () => this.goHome());
    this.on(ui.view, "pointerdown", () => ui.root.focus({ preventScroll: true }));
    this.on(ui.root, "keydown", (e) => this.key(e));
    steer(ui.canvas, this.camera, () => this.wake(), () => ui.root.contains(document.activeElement));
    const heard = { frame: () => this.hearFrame(), playing: () => this.showPlaying(), speed: () => this.showSpeed(), loop: () => this.showLoop(),
      _data: () => { this.load(false); this.wake(); }, height: () => { ui.view.style.height = `${model.get("height")}px`; } };
    for (const [name, act] of Object.entries(heard)) {
      model.on(`change:${name}`, act);
      this.undo.push(() => model.off(`change:${name}`, act));
    }
    this.watch();
  }

  watch() {
    const size = new ResizeObserver(() => this.resize()); size.observe(this.ui.view);
    const sight = new IntersectionObserver(([e]) => { this.hidden = !e.isIntersecting; this.wake(); }); sight.observe(this.ui.view);
    const theme = new MutationObserver(() => { this.restyle(); this.wake(); });
    theme.observe(document.body, { attributes: true, attributeFilter: ["data-jp-theme-light", "data-vscode-theme-kind", "class"] });
    const scheme = matchMedia("(prefers-color-scheme: dark)");
    this.on(scheme, "change", () => { this.restyle(); this.wake(); });
    this.on(this.ui.canvas, "webglcontextlost", (e) => e.preventDefault());
    this.on(this.ui.canvas, "webglcontextrestored", () => { this.view = new GlView(this.ui.canvas); this.wake(); });
    this.undo.push(() => { size.disconnect(); sight.disconnect(); theme.disconnect(); });
  }

  restyle() {
    const dark = isDark();
    this.ui.root.classList.toggle("mk-dark", dark);
    this.theme = { ...LOOKS[dark ? "dark" : "light"], dark };
    if (!this.stage) return;
    const { height, motions } = this.stage, [x, , z] = motions[0].left, turn = Math.atan2(-z, x) - 0.75;
    const wide = motions.length > 1 ? Math.hypot(...[0, 2].map((k) => motions[0].path[k] - motions.at(-1).path[k])) : 0;
    const light = [Math.sin(turn) * 0.5, 0.82, Math.cos(turn) * 0.5], size = Math.hypot(...light);
    Object.assign(this.theme, { light: light.map((v) => v / size), reach: 1.5 * height + 0.65 * wide, span: 5.5 * height + 1.5 * wide,
      tile: height > 0.5 ? 0.5 : height / 3 });
  }

  key(event) {
    const step = event.shiftKey ? 10 : 1, frame = this.frame();
    const acts = { " ": () => this.setPlaying(!this.model.get("playing")), ArrowLeft: () => this.stepTo(frame - step),
      ArrowRight: () => this.stepTo(frame + step), Home: () => this.stepTo(0), End: () => this.stepTo(this.stage.frames - 1) };
    if (!acts[event.key] || event.target === this.ui.speed || event.ctrlKey || event.metaKey || event.altKey) return;
    // The notebook has its own meaning for these keys, and a focused button would be pressed by the space bar.
    event.preventDefault(); event.stopPropagation();
    acts[event.key]();
  }

  frame() { return clamp(Math.round(this.time * this.stage.fps), 0, this.stage.frames - 1); }
  stepTo(frame) { this.setPlaying(false); this.seek(clamp(frame, 0, this.stage.frames - 1) / this.stage.fps); this.report(true); }
  seek(time) { this.time = clamp(time, 0, this.stage.end); this.wake(); }
  setFollow(on) { this.camera.follow = on; this.ui.follow.classList.toggle("mk-on", on); this.wake(); }
  goHome() { this.camera.home(this.stage); this.setFollow(this.camera.follow); }

  setPlaying(on) {
    if (on && this.time >= this.stage.end - 1e-6) this.time = 0;
    this.tell({ playing: on, frame: this.frame() });
    this.showPlaying();
  }

  // To Python. What comes back by it, at once or as an echo, is our own and is not listened to.
  tell(values) {
    this.telling = true;
    for (const [name, value] of Object.entries(values)) this.model.set(name, value);
    this.model.save_changes();
    this.telling = false;
  }

  report(always) {
    const now = performance.now();
    if (!always && now - this.sent < SEND_EVERY) return;
    this.sent = now;
    if (this.model.get("frame") !== this.frame()) this.tell({ frame: this.frame() });
  }

  hearFrame() {
    const told = this.model.get("frame");
    // Another view of the same player reports while it plays; following each report would make this one stutter.
    if (this.telling || (this.model.get("playing") && Math.abs(told - this.frame()) < 0.3 * this.stage.fps)) return;
    this.seek(told / this.stage.fps);
  }

  showPlaying() {
    const on = this.model.get("playing");
    this.ui.play.innerHTML = icon(on ? "pause" : "play");
    this.last = undefined;
    if (this.coarse) this.resize();
    this.wake();
  }

  showLoop() { this.ui.loop.classList.toggle("mk-on", this.model.get("loop")); }

  showSpeed() {
    const now = this.model.get("speed");
    this.ui.speed.replaceChildren(...[...new Set([...SPEEDS, now])].sort((a, b) => a - b).map((s) => new Option(`${s}×`, s, false, s === now)));
  }

  resize() {
    const { canvas, view } = this.ui, ratio = Math.min(window.devicePixelRatio || 1, 2) * (this.coarse && this.model.get("playing") ? 0.7 : 1);
    const width = Math.max(1, Math.round(view.clientWidth * ratio)), height = Math.max(1, Math.round(view.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    this.wake();
  }

  wake() { if (!this.waiting && !this.gone) this.waiting = requestAnimationFrame((now) => this.tick(now)); }

  tick(now) {
    this.waiting = 0;
    if (this.gone || this.hidden || !this.ui.view.clientWidth) { this.last = undefined; return; }
    const playing = this.model.get("playing");
    if (playing && this.last !== undefined) this.advance((now - this.last) / 1000 * this.model.get("speed"));
    if (playing) this.pace(now);
    this.last = now;
    const start = performance.now();
    this.paint();
    this.stats.frames += 1; this.stats.busy += performance.now() - start;
    if (this.model.get("playing")) { this.report(false); this.wake(); }
  }

  // Where a picture takes too long (no graphics card), moving pictures are drawn coarser; a paused one never is.
  pace(now) {
    if (this.last === undefined) { this.slow = 0; return; }
    this.slow = 0.93 * this.slow + 0.07 * Math.min(now - this.last, 100);
    if (this.coarse || this.slow < 26) return;
    this.coarse = true;
    this.resize();
  }

  advance(seconds) {
    const { end } = this.stage;
    this.time += Math.min(seconds, 0.5);
    if (this.time <= end) return;
    if (this.model.get("loop") && end > 0) this.time %= end;
    else { this.time = end; this.tell({ playing: false, frame: this.frame() }); this.showPlaying(); }
  }

  paint() {
    const { stage, camera, ui, time } = this, { canvas } = ui;
    stage.pose(time);
    camera.update(stage, time, canvas.width, canvas.height);
    const focus = stage.path(time);
    this.view.draw(stage, camera, this.theme, focus);
    this.placeLabels();
    ui.scrub.value = time;
    ui.scrub.style.setProperty("--mk-done", `${100 * time / (stage.end || 1)}%`);
    ui.read.textContent = `${time.toFixed(2)} s · frame ${this.frame()} of ${stage.frames - 1}`;
  }

  // Labels stand over their characters; one that would cover another moves up.
  placeLabels() {
    const { clientWidth: width, clientHeight: height } = this.ui.view, taken = [];
    this.stage.motions.forEach((m, i) => {
      const label = this.ui.labels.children[i];
      if (!m.label) return;
      m.follow ||= smoothPath([m], m.end);
      m.labelWidth ||= label.offsetWidth;
      const p = m.follow(Math.min(this.time, m.end));
      let [x, y, depth] = this.camera.project([p[0], m.top, p[2]], width, height);
      const half = m.labelWidth / 2 + 4, meets = (t) => Math.abs(t.x - x) < t.half + half && Math.abs(t.y - y) < 26;
      x = clamp(x, half, width - half);
      for (let tries = 0; tries < taken.length && taken.some(meets); tries++) y = Math.min(...taken.filter(meets).map((t) => t.y)) - 26;
      y = Math.max(y, 14);
      taken.push({ x, y, half });
      label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
      label.style.opacity = depth > 0 ? 1 : 0;
    });
  }

  close() {
    this.gone = true;
    cancelAnimationFrame(this.waiting);
    this.undo.forEach((act) => act());
    this.view.free();
  }
}
