// The player around a stage: clock, controls, keyboard, and the exchange of frame, playing and speed with Python.

const SPEEDS = [0.1, 0.25, 0.5, 1, 1.5, 2, 4];
const SEND_EVERY = 120; // ms between two reports of the frame to Python

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

class Player extends View {
  constructor(root, model) {
    super(build(root, model.get("height")));
    this.model = model;
    this.time = 0; this.sent = 0; this.drawn = 0;
    this.listen(); this.restyle(); this.load(true); this.seek(model.get("frame") / this.stage.fps);
    this.showPlaying(); this.showSpeed(); this.showLoop(); this.resize();
  }

  load(first) {
    this.stage = new Stage(this.model.get("_data"));
    this.ui.scrub.max = this.stage.end;
    this.nameAll();
    if (first || this.stage.motions.length !== this.standing) this.camera.home(this.stage);
    this.camera.fitted = "";
    this.standing = this.stage.motions.length;
    this.time = Math.min(this.time, this.stage.end);
    this.ui.follow.classList.toggle("mk-on", this.camera.follow);
    this.restyle();
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

  advance(seconds) {
    const { end } = this.stage;
    this.time += Math.min(seconds, 0.5);
    if (this.time <= end) return;
    if (this.model.get("loop") && end > 0) this.time %= end;
    else { this.time = end; this.tell({ playing: false, frame: this.frame() }); this.showPlaying(); }
  }

  paint() {
    const { stage, ui, time } = this;
    this.picture();
    ui.scrub.value = time;
    ui.scrub.style.setProperty("--mk-done", `${100 * time / (stage.end || 1)}%`);
    ui.read.textContent = `${time.toFixed(2)} s · frame ${this.frame()} of ${stage.frames - 1}`;
  }
}
