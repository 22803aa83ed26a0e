// The stage: what stands where at a given time, and what the camera sees of it. No drawing here.

const STRIDE = 12; // floats for one drawn part: a.xyz, radius a, b.xyz, radius b, r, g, b, kind
const SOLID = 0, MARK = 1, GLOW = 2;
const TRAIL_SECONDS = 1.2;

const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const hexToRgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);

function unpack(view) {
  const bytes = new Uint8Array(view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));
  const length = new DataView(bytes.buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  const base = 4 + length;
  for (const m of head.motions) {
    m.path = new Float32Array(bytes.buffer, base + m.root, m.frames * 3);
    m.relative = new Int16Array(bytes.buffer, base + m.around, m.frames * m.joints * 3);
    m.contacts = m.touch < 0 ? null : new Uint8Array(bytes.buffer, base + m.touch, m.frames * m.marks.length);
    m.rgb = m.colours.map(hexToRgb);
    m.end = (m.frames - 1) / m.fps;
    m.pose = new Float32Array(m.joints * 3);
  }
  return head;
}

// Joint positions between frames, straight lines; the first and last pose are held outside the motion.
function poseAt(m, time, out) {
  const x = clamp(time * m.fps, 0, m.frames - 1);
  const low = Math.floor(x), high = Math.min(low + 1, m.frames - 1), share = x - low;
  const n = m.joints * 3;
  for (let k = 0; k < 3; k++) {
    const root = m.path[low * 3 + k] * (1 - share) + m.path[high * 3 + k] * share;
    for (let i = k; i < n; i += 3) {
      const a = m.relative[low * n + i], b = m.relative[high * n + i];
      out[i] = root + (a + (b - a) * share) * m.scale;
    }
  }
  return out;
}

// Where the characters are as a whole, every 1/20 s, smoothed over about a second so that the camera stays calm.
function smoothPath(motions, end) {
  const rate = 20, count = Math.max(1, Math.ceil(end * rate) + 1), raw = [];
  for (let i = 0; i < count; i++) {
    const sum = [0, 0, 0];
    for (const m of motions) {
      const p = poseAt(m, i / rate, m.pose);
      for (let k = 0; k < 3; k++) {
        let low = Infinity, high = -Infinity;
        for (const j of m.drawn) { low = Math.min(low, p[3 * j + k]); high = Math.max(high, p[3 * j + k]); }
        sum[k] += (low + high) / 2 / motions.length;
      }
    }
    raw.push(sum);
  }
  const height = raw.reduce((s, p) => s + p[1], 0) / count, reach = rate;
  const path = raw.map((_, i) => {
    let weight = 0, x = 0, z = 0;
    for (let d = -reach; d <= reach; d++) {
      // The ends are continued by point reflection, so that the camera neither lags nor leads there.
      const j = i + d, e = clamp(j, 0, count - 1), w = Math.exp(-4.5 * (d / reach) ** 2), mirror = clamp(2 * e - j, 0, count - 1);
      const px = j === e ? raw[j][0] : 2 * raw[e][0] - raw[mirror][0], pz = j === e ? raw[j][2] : 2 * raw[e][2] - raw[mirror][2];
      x += w * px; z += w * pz; weight += w;
    }
    return [x / weight, height, z / weight];
  });
  return (time) => {
    const x = clamp(time * rate, 0, count - 1), low = Math.floor(x), high = Math.min(low + 1, count - 1), s = x - low;
    return path[low].map((v, k) => v * (1 - s) + path[high][k] * s);
  };
}

class Stage {
  constructor(view) {
    this.head = unpack(view);
    this.motions = this.head.motions;
    this.end = Math.max(...this.motions.map((m) => m.end));
    this.fps = this.motions[0].fps;
    this.frames = Math.round(this.end * this.fps) + 1;
    this.height = Math.max(...this.motions.map((m) => m.height));
    this.path = smoothPath(this.motions, this.end);
    for (const m of this.motions) m.top = this.reach(m) + 0.2 * m.height;
    const parts = this.motions.reduce((n, m) => n + m.bones.length + m.joints + 2 + m.marks.length
      + m.trails.length * (Math.ceil(TRAIL_SECONDS * m.fps) + 2), 0);
    this.parts = new Float32Array(parts * STRIDE);
  }

  // How high the character's head comes at most, or its highest joint where it has no head.
  reach(m) {
    const joints = m.head >= 0 ? [m.head] : m.drawn;
    let top = 0;
    for (let i = 0; i <= 40; i++) {
      const p = poseAt(m, m.end * i / 40, m.pose);
      for (const j of joints) top = Math.max(top, p[3 * j + 1]);
    }
    return top;
  }

  // Where a character stands as a whole, for its label.
  standing(m, time) {
    m.follow ||= smoothPath([m], m.end);
    return m.follow(Math.min(time, m.end));
  }

  put(a, ra, b, rb, rgb, kind) {
    const o = this.count++ * STRIDE, p = this.parts;
    p[o] = a[0]; p[o + 1] = a[1]; p[o + 2] = a[2]; p[o + 3] = ra;
    p[o + 4] = b[0]; p[o + 5] = b[1]; p[o + 6] = b[2]; p[o + 7] = rb;
    p[o + 8] = rgb[0]; p[o + 9] = rgb[1]; p[o + 10] = rgb[2]; p[o + 11] = kind;
  }

  // Fills `parts` for a time: first what casts shadows (bones, heads, lone joints), then joints, contact marks and trails.
  pose(time) {
    this.count = 0;
    for (const m of this.motions) this.limbs(m, poseAt(m, time, m.pose));
    this.casting = this.count;
    for (const m of this.motions) {
      if (m.bones.length) this.joints(m, 0.92);
      this.contactMarks(m, time);
      this.trails(m, time);
    }
  }

  limbs(m, pose) {
    const at = (j) => [pose[3 * j], pose[3 * j + 1], pose[3 * j + 2]];
    // Bones are a little thinner than the joints they end in, like the limbs of a wooden mannequin.
    for (const [parent, child] of m.bones) this.put(at(parent), m.radii[parent] * 0.88, at(child), m.radii[child] * 0.88, m.rgb[child], SOLID);
    if (m.head >= 0) this.headBall(m, at(m.head), at(m.headParent));
    if (!m.bones.length) this.joints(m, 1);
  }

  joints(m, shade) {
    for (const j of m.drawn) {
      const p = m.pose.subarray(3 * j, 3 * j + 3);
      this.put(p, m.radii[j], p, m.radii[j], m.rgb[j].map((c) => c * shade), SOLID);
    }
  }

  headBall(m, head, neck) {
    const d = head.map((v, k) => v - neck[k]), length = Math.hypot(...d) || 1, r = m.headRadius;
    const a = head.map((v, k) => v + d[k] / length * r * 0.55), b = head.map((v, k) => v + d[k] / length * r * 1.15);
    this.put(a, r * 0.86, b, r, m.rgb[m.head], SOLID);
  }

  contactMarks(m, time) {
    if (!m.contacts) return;
    const frame = clamp(Math.round(time * m.fps), 0, m.frames - 1), rgb = hexToRgb(this.head.contact);
    m.marks.forEach((joint, k) => {
      if (!m.contacts[frame * m.marks.length + k]) return;
      const p = [m.pose[3 * joint], m.pose[3 * joint + 1], m.pose[3 * joint + 2]];
      const y = Math.max(0.004, p[1] - m.radii[joint] * 1.5 - 0.02 * m.height);
      this.put([p[0], y, p[2]], 0.055 * m.height, [p[0], y, p[2]], 0.055 * m.height, rgb, MARK);
    });
  }

  trails(m, time) {
    const now = clamp(time, 0, m.end), first = Math.max(0, now - TRAIL_SECONDS), step = 1 / m.fps;
    const old = new Float32Array(m.joints * 3), times = [];
    for (let t = now; t > first; t -= step) times.push(t);
    times.push(first);
    const poses = m.trails.length ? times.map((t) => poseAt(m, t, old).slice()) : [];
    for (const joint of m.trails) {
      for (let i = 1; i < poses.length; i++) {
        const a = poses[i - 1].subarray(3 * joint, 3 * joint + 3), b = poses[i].subarray(3 * joint, 3 * joint + 3);
        const thick = (k) => 0.011 * m.height * (1 - k / poses.length) ** 0.7;
        this.put(a, thick(i - 1), b, thick(i), m.rgb[joint].map((c) => 0.25 + 0.75 * c), GLOW);
      }
    }
  }

  // How far the camera must stand back, looking along `basis`, to see everybody all the time.
  distance(basis, tanX, tanY, follow) {
    let far = 0.5 * this.height;
    const count = 24, still = this.path(this.end / 2);
    for (let i = 0; i <= count; i++) {
      const time = this.end * i / count, target = follow ? this.path(time) : still;
      for (const m of this.motions) {
        const p = poseAt(m, time, m.pose), pad = 0.1 * m.height;
        for (const j of m.drawn) {
          const d = [0, 1, 2].map((k) => p[3 * j + k] - target[k]);
          const [x, y, z] = basis.map((axis) => axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2]);
          far = Math.max(far, z + (Math.abs(x) + pad) / tanX, z + (Math.abs(y) + 2 * pad) / tanY);
        }
      }
    }
    return far;
  }
}
