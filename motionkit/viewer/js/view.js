// What every 3D view is made of: a canvas with a camera, the look of the page around it, labels over the characters.

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

const icon = (name) => `<svg viewBox="0 0 24 24" width="18" height="18" aria-hidden="true">${ICONS[name]}</svg>`;

function isDark() {
  const { body } = document, jupyter = body.dataset.jpThemeLight;
  if (jupyter) return jupyter === "false";
  if (body.dataset.vscodeThemeKind) return !body.dataset.vscodeThemeKind.includes("light");
  return matchMedia("(prefers-color-scheme: dark)").matches;
}

class View {
  // ui: { root, view, canvas, labels }, elements of the page.
  constructor(ui) {
    this.ui = ui; this.camera = new Camera(); this.undo = []; this.stats = { frames: 0, busy: 0 };
    try { this.view = new GlView(ui.canvas); } catch (error) {
      // A canvas that has refused WebGL still gives a plain 2D context, unless it was half made: then a fresh one.
      const fresh = ui.canvas.cloneNode(); ui.canvas.replaceWith(fresh); ui.canvas = fresh;
      this.view = new FlatView(fresh);
      this.stats.why = String(error);
    }
    this.stats.kind = this.view.constructor.name;
  }

  // Adds a listener and remembers how to take it away again.
  on(target, name, act, options) {
    target.addEventListener(name, act, options);
    this.undo.push(() => target.removeEventListener(name, act, options));
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

  nameAll() {
    this.ui.labels.replaceChildren(...this.stage.motions.map((m) => {
      const label = document.createElement("span");
      label.textContent = m.label; label.style.setProperty("--mk-role", m.role); label.hidden = !m.label;
      return label;
    }));
  }

  resize() {
    const { canvas, view } = this.ui, ratio = Math.min(window.devicePixelRatio || 1, 2) * (this.coarse && this.moving() ? 0.7 : 1);
    const width = Math.max(1, Math.round(view.clientWidth * ratio)), height = Math.max(1, Math.round(view.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    this.wake();
  }

  wake() { if (!this.waiting && !this.gone) this.waiting = requestAnimationFrame((now) => this.tick(now)); }

  moving() { return this.model.get("playing"); }

  // Where a picture takes too long (no graphics card), moving pictures are drawn coarser; a paused one never is.
  pace(now) {
    if (this.last === undefined) { this.slow = 0; return; }
    this.slow = 0.93 * this.slow + 0.07 * Math.min(now - this.last, 100);
    if (this.coarse || this.slow < 26) return;
    this.coarse = true;
    this.resize();
  }

  // Everybody at this time, as the camera sees them, with their labels.
  picture() {
    const { stage, camera, time, ui: { canvas } } = this;
    stage.pose(time);
    camera.update(stage, time, canvas.width, canvas.height);
    this.view.draw(stage, camera, this.theme, stage.path(time));
    this.placeLabels();
  }

  // Labels stand over their characters; one that would cover another moves up.
  placeLabels() {
    const { clientWidth: width, clientHeight: height } = this.ui.view, taken = [];
    this.stage.motions.forEach((m, i) => {
      const label = this.ui.labels.children[i];
      if (!m.label) return;
      m.labelWidth ||= label.offsetWidth;
      const p = this.stage.standing(m, this.time);
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
