// Draws a stage on a plain 2D canvas: for browsers that give no WebGL2 (or no more of it).

class FlatView {
  constructor(canvas) { this.canvas = canvas; this.ink = canvas.getContext("2d"); }

  draw(stage, camera, theme, focus) {
    const { ink, canvas: { width, height } } = this;
    ink.clearRect(0, 0, width, height);
    const css = (rgb, alpha = 1) => `rgba(${rgb.map((c) => Math.round(255 * c)).join(",")},${alpha})`;
    const see = (p) => camera.project(p, width, height);
    this.floor(see, theme, focus, css);
    const parts = [];
    for (let i = 0; i < stage.count; i++) {
      const p = stage.parts.subarray(i * STRIDE, (i + 1) * STRIDE);
      const a = see(p.subarray(0, 3)), b = see(p.subarray(4, 7)), thick = (p[3] + p[7]) * camera.scale / ((a[2] + b[2]) / 2);
      if (a[2] <= 0 || b[2] <= 0) continue;
      if (i < stage.casting) this.line(see([p[0], 0, p[2]]), see([p[4], 0, p[6]]), thick, css(theme.dim.slice(0, 3), 0.1));
      parts.push({ a, b, thick, rgb: [p[8], p[9], p[10]], depth: (a[2] + b[2]) / 2 });
    }
    parts.sort((p, q) => q.depth - p.depth);
    for (const p of parts) {
      this.line(p.a, p.b, p.thick, css(p.rgb.map((c) => c * 0.72)));
      this.line(p.a, p.b, p.thick * 0.72, css(p.rgb));
    }
  }

  floor(see, theme, focus, css) {
    const step = theme.tile, reach = 7, [x0, z0] = [focus[0], focus[2]].map((v) => Math.round(v / step) * step);
    for (let i = -reach; i <= reach; i++) {
      const d = i * step, r = reach * step;
      for (const [p, q] of [[[x0 + d, 0, z0 - r], [x0 + d, 0, z0 + r]], [[x0 - r, 0, z0 + d], [x0 + r, 0, z0 + d]]]) {
        const a = see(p), b = see(q);
        if (a[2] > 0 && b[2] > 0) this.line(a, b, 1.5, css(theme.tileB, 1));
      }
    }
  }

  line(a, b, width, style) {
    const ink = this.ink;
    ink.beginPath(); ink.lineCap = "round"; ink.lineWidth = Math.max(width, 0.5); ink.strokeStyle = style;
    ink.moveTo(a[0], a[1]); ink.lineTo(b[0] + 0.01, b[1]); ink.stroke();
  }

  free() {}
}
