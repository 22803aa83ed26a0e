// An orbiting camera with a long lens, and the four-by-four matrices that it needs (column-major, as WebGL wants them).

const FIELD = 26 * Math.PI / 180;
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

function multiply(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) {
    let s = 0;
    for (let k = 0; k < 4; k++) s += a[4 * k + r] * b[4 * c + k];
    out[4 * c + r] = s;
  }
  return out;
}

class Camera {
  constructor() { this.zoom = 1; this.pan = [0, 0, 0]; this.follow = true; this.fitted = ""; this.yaw = 0; this.pitch = 0; }

  // Three quarters from the front of the first character; flatter to the front where several stand in a row.
  home(stage) {
    const [x, , z] = stage.motions[0].left;
    const turn = stage.motions.length > 1 ? 0.42 : 0.66;
    this.yaw = Math.atan2(-z, x) + turn;
    this.pitch = stage.motions.length > 1 ? 0.2 : 0.17;
    this.zoom = 1; this.pan = [0, 0, 0]; this.fitted = "";
    this.follow = stage.head.follow;
  }

  basis() {
    const [sy, cy, sp, cp] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
    return [[cy, 0, -sy], [-sy * sp, cp, -cy * sp], [sy * cp, sp, cy * cp]]; // right, up, back
  }

  // The distance is found once for a picture's shape and view, and kept while the user orbits.
  update(stage, time, width, height) {
    const tanY = Math.tan(FIELD / 2), tanX = tanY * width / height, key = `${(width / height).toFixed(2)} ${this.follow}`;
    if (this.fitted !== key) { this.away = stage.distance(this.basis(), tanX, tanY, this.follow) * 1.02; this.fitted = key; }
    const target = stage.path(this.follow ? time : stage.end / 2).map((v, k) => v + this.pan[k]);
    const [right, up, back] = this.basis(), away = this.away / this.zoom;
    // Never under the floor: a low camera slides up instead.
    const eye = target.map((v, k) => v + back[k] * away);
    eye[1] = Math.max(eye[1], 0.05);
    const near = away * 0.05, far = away * 6 + 30;
    const view = new Float32Array([right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
      -dot(right, eye), -dot(up, eye), -dot(back, eye), 1]);
    const lens = new Float32Array([1 / tanX, 0, 0, 0, 0, 1 / tanY, 0, 0, 0, 0, (far + near) / (near - far), -1,
      0, 0, 2 * far * near / (near - far), 0]);
    Object.assign(this, { eye, target, view, matrix: multiply(lens, view), scale: height / (2 * tanY) });
  }

  // A point in space to pixels of a width x height picture, with its depth in metres.
  project(p, width, height) {
    const m = this.matrix, w = m[3] * p[0] + m[7] * p[1] + m[11] * p[2] + m[15];
    const x = (m[0] * p[0] + m[4] * p[1] + m[8] * p[2] + m[12]) / w, y = (m[1] * p[0] + m[5] * p[1] + m[9] * p[2] + m[13]) / w;
    return [(x + 1) / 2 * width, (1 - y) / 2 * height, w];
  }

  orbit(dx, dy) {
    this.yaw -= dx * 0.008;
    this.pitch = clamp(this.pitch + dy * 0.006, -0.05, 1.5);
  }

  shift(dx, dy, height) {
    const [right, up] = this.basis(), metres = 2 * Math.tan(FIELD / 2) * this.away / this.zoom / height;
    this.pan = this.pan.map((v, k) => v - right[k] * dx * metres + up[k] * dy * metres);
  }
}

// Drag to orbit, right or shift drag (or two fingers) to pan, wheel with ctrl or on a focused view (or pinch) to zoom.
function steer(canvas, camera, redraw, isActive) {
  const fingers = new Map();
  const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    fingers.set(e.pointerId, { x: e.clientX, y: e.clientY });
  });
  canvas.addEventListener("pointermove", (e) => {
    const last = fingers.get(e.pointerId);
    if (!last) return;
    const dx = e.clientX - last.x, dy = e.clientY - last.y, before = fingers.size === 2 ? spread() : 0;
    fingers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    if (fingers.size === 2) {
      camera.zoom = clamp(camera.zoom * spread() / Math.max(before, 1), 0.15, 12);
      camera.shift(dx / 2, dy / 2, canvas.clientHeight);
    } else if (e.shiftKey || e.buttons & 6) camera.shift(dx, dy, canvas.clientHeight);
    else camera.orbit(dx, dy);
    redraw();
  });
  const lift = (e) => fingers.delete(e.pointerId);
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => {
    // A page scrolled past the view must go on scrolling; zooming is for whoever clicked into it.
    if (!e.ctrlKey && !isActive()) return;
    e.preventDefault();
    camera.zoom = clamp(camera.zoom * Math.exp(-e.deltaY * 0.0012), 0.15, 12);
    redraw();
  }, { passive: false });
}
