// The shaders of the WebGL view. Each part (a rounded cone between two points) is one quad: the fragment shader finds
// where the line of sight meets the cone. So a picture costs a few hundred triangles, and edges are smooth without MSAA,
// which keeps it quick where the graphics card is only imitated in software.

const PART_TABLE = `
uniform highp sampler2D parts;  // three texels a part: a and its radius, b and its radius, colour and kind
flat out vec4 partA; flat out vec4 partB; flat out vec4 tint;
vec2 corner() {
  int part = gl_VertexID / 6, k = gl_VertexID % 6;
  partA = texelFetch(parts, ivec2(0, part), 0);
  partB = texelFetch(parts, ivec2(1, part), 0);
  tint = texelFetch(parts, ivec2(2, part), 0);
  return vec2(k == 1 || k == 4 || k == 5 ? 1. : -1., k == 2 || k == 3 || k == 5 ? 1. : -1.);
}`;

const BODY_VERTEX = `#version 300 es
precision highp float;
${PART_TABLE}
uniform mat4 camera; uniform vec3 eye;
out vec3 place;
void main() {
  vec2 c = corner();
  vec3 middle = (partA.xyz + partB.xyz) * .5, d = partB.xyz - partA.xyz, sight = normalize(middle - eye);
  float wide = max(partA.w, partB.w) * 1.12 + .004 * distance(middle, eye);
  if (tint.w > .5 && tint.w < 1.5) {
    place = partA.xyz + vec3(c.x, 0., c.y) * partA.w * 1.1;
  } else {
    vec3 along = d - sight * dot(d, sight);
    float len = length(along);
    along = len > 1e-5 ? along / len : normalize(cross(sight, abs(sight.y) < .9 ? vec3(0., 1., 0.) : vec3(1., 0., 0.)));
    place = middle + along * c.x * (len * .53 + wide) + cross(sight, along) * c.y * (wide + .04 * len);
  }
  gl_Position = camera * vec4(place, 1.);
}`;

const BODY_FRAGMENT = `#version 300 es
precision highp float;
flat in vec4 partA; flat in vec4 partB; flat in vec4 tint;
in vec3 place;
uniform mat4 camera; uniform vec3 eye; uniform vec3 light; uniform float pixel; uniform float dark; uniform float body;
out vec4 paint;

// Where the ray meets the rounded cone: how far, the normal, and the radius of the sphere that touches there.
// Along the axis u at x, off it by r, the cone is r cos + x sin = ra, where sin = (ra - rb) / length. The sphere that
// touches it there sits on the axis at f; outside 0 < f < length the two end spheres stand for the cone.
bool meet(vec3 from, vec3 ray, float ra, float rb, out float t, out vec3 n, out float radius) {
  vec3 d = partB.xyz - partA.xyz, oa = from - partA.xyz, ob = from - partB.xyz;
  float len = length(d), s = (ra - rb) / max(len, 1e-6), c2 = 1. - s * s;
  if (len > 1e-5 && c2 > 1e-4) {
    vec3 u = d / len;
    float x0 = dot(oa, u), xd = dot(ray, u), e = ra - x0 * s;
    float k2 = c2 - xd * xd, k1 = c2 * dot(oa, ray) - x0 * xd + s * xd * ra, k0 = c2 * (dot(oa, oa) - x0 * x0) - e * e;
    float h = k1 * k1 - k0 * k2;
    if (h >= 0. && abs(k2) > 1e-9) {
      t = (-sqrt(h) - k1) / k2;
      float f = (x0 + t * xd - ra * s) / c2;
      if (f > 0. && f < len) { radius = ra - f * s; n = (oa + t * ray - f * u) / radius; return true; }
    }
  }
  float ma = dot(oa, ray), mb = dot(ob, ray), ha = ma * ma - dot(oa, oa) + ra * ra, hb = mb * mb - dot(ob, ob) + rb * rb;
  t = 1e20;
  if (ha > 0.) { t = -ma - sqrt(ha); n = (oa + t * ray) / ra; radius = ra; }
  if (hb > 0. && -mb - sqrt(hb) < t) { t = -mb - sqrt(hb); n = (ob + t * ray) / rb; radius = rb; }
  return t < 1e19;
}

vec3 shade(vec3 n, vec3 v, vec3 hit) {
  vec3 base = pow(tint.rgb, vec3(2.2));
  float key = smoothstep(-.6, 1., dot(n, light)), gloss = pow(max(dot(n, normalize(light + v)), 0.), 34.) * .10;
  vec3 sky = mix(vec3(.42, .40, .42), vec3(.66, .70, .76), n.y * .5 + .5);
  float near = .74 + .26 * smoothstep(0., .16 * body, hit.y);
  float rim = pow(1. - max(dot(n, v), 0.), 3.) * (.14 + .12 * n.y);
  vec3 lit = base * (sky * .66 * near + key * vec3(1., .97, .92) * .86) + rim * vec3(.75, .82, .9) * (.6 - .2 * dark) + gloss;
  return pow(lit, vec3(1. / 2.2));
}

void main() {
  vec3 hit = place; float alpha; vec3 colour = tint.rgb;
  vec3 ray = normalize(place - eye);
  float px = pixel * distance(place, eye);
  if (tint.w > .5 && tint.w < 1.5) {
    float r = distance(place, partA.xyz) / partA.w, soft = max(px / partA.w, .02) * 1.5;
    alpha = smoothstep(1., 1. - soft, r) * (.45 + .55 * smoothstep(.72 - soft, .72, r));
  } else {
    float t, radius; vec3 n;
    if (!meet(place, ray, partA.w + .5 * px, partB.w + .5 * px, t, n, radius)) discard;
    hit = place + ray * t;
    float facing = clamp(dot(n, -ray), 0., 1.);
    // How far inside the outline this line of sight passes, in pixels.
    alpha = clamp(radius * (1. - sqrt(1. - facing * facing)) / px, 0., 1.);
    if (tint.w < .5) colour = shade(n, -ray, hit);
    hit += ray * (1. - alpha) * 2. * radius; // a half-covered pixel must not hide what joins on behind it
  }
  if (alpha < .02) discard;
  vec4 clip = camera * vec4(hit, 1.);
  gl_FragDepth = clamp(clip.z / clip.w * .5 + .5, 0., 1.);
  paint = vec4(colour * alpha, alpha);
}`;

// Two shadows of each part, as soft two-dimensional cones on the floor. Red: what the light throws, softer the higher
// the part. Green: the dimness right under a part that is close to the floor.
const SHADOW_VERTEX = `#version 300 es
precision highp float;
${PART_TABLE}
uniform vec3 light; uniform vec3 centre; uniform float reach; uniform float body; uniform int under;
flat out vec2 a; flat out vec2 b; out vec2 at;
vec2 fall(vec3 p) { return under == 1 ? p.xz : p.xz - light.xz / light.y * max(p.y, 0.); }
void main() {
  vec2 c = corner();
  a = fall(partA.xyz); b = fall(partB.xyz);
  vec2 d = b - a; float len = length(d);
  vec2 along = len > 1e-5 ? d / len : vec2(1., 0.);
  float edge = max(partA.w, partB.w) + (under == 1 ? .11 : .02 + .05 * max(partA.y, partB.y) / body) * body;
  at = (a + b) * .5 + along * c.x * (len * .5 + edge) + vec2(-along.y, along.x) * c.y * edge;
  gl_Position = vec4((at - centre.xz) / reach, 0., 1.);
}`;

const SHADOW_FRAGMENT = `#version 300 es
precision highp float;
flat in vec4 partA; flat in vec4 partB; flat in vec4 tint; flat in vec2 a; flat in vec2 b;
in vec2 at;
uniform highp int under; uniform highp float body;
out vec4 paint;
void main() {
  vec2 d = b - a;
  float t = clamp(dot(at - a, d) / max(dot(d, d), 1e-9), 0., 1.);
  float gap = distance(at, a + d * t) - mix(partA.w, partB.w, t), high = max(mix(partA.y, partB.y, t), 0.) / body;
  if (under == 1) { paint = vec4(0., exp(-high * 7.) * smoothstep(.11, -.04, gap / body), 0., 1.); return; }
  float soft = .012 + .04 * high;
  paint = vec4((1. - .45 * min(high, 1.)) * smoothstep(soft, -soft, gap / body), 0., 0., 1.);
}`;

const FLOOR_VERTEX = `#version 300 es
precision highp float;
uniform mat4 camera; uniform vec3 centre; uniform float span;
out vec2 at;
void main() {
  at = centre.xz + span * vec2(gl_VertexID % 2 == 0 ? -1. : 1., gl_VertexID < 2 ? -1. : 1.);
  gl_Position = camera * vec4(at.x, 0., at.y, 1.);
}`;

const FLOOR_FRAGMENT = `#version 300 es
precision highp float;
in vec2 at;
uniform sampler2D image; uniform vec3 centre; uniform float reach; uniform float span; uniform float tile;
uniform vec3 tileA; uniform vec3 tileB; uniform vec4 dim; uniform vec3 eye;
out vec4 paint;
float checks(vec2 p, vec2 w) {  // a checker board filtered over the pixel's footprint
  vec2 i = 2. * (abs(fract((p - .5 * w) * .5) - .5) - abs(fract((p + .5 * w) * .5) - .5)) / w;
  return .5 - .5 * i.x * i.y;
}
void main() {
  float alpha = (1. - smoothstep(.3, .95, length(at - centre.xz) / span)) * smoothstep(.0, .05, eye.y);
  if (alpha <= 0.) discard;
  vec2 p = at / tile;
  vec3 ground = mix(tileA, tileB, checks(p, max(fwidth(p), vec2(1e-4))));
  vec2 s = (at - centre.xz) / reach * .5 + .5, cover = texture(image, clamp(s, 0., 1.)).rg;
  float inside = smoothstep(1., .9, max(abs(s.x * 2. - 1.), abs(s.y * 2. - 1.)));
  ground = mix(ground, dim.rgb, (1. - (1. - cover.r * .8) * (1. - cover.g * .7)) * dim.a * inside);
  paint = vec4(ground * alpha, alpha);
}`;
