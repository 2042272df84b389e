// Fragment shader of the ray casting (volume_caster.ts).

import { MOVED } from "../drawing/displacement.js";
import { BLOCK } from "./field.js";
import { SHADING } from "./shading.gen.js";

/** Number of samples of a surface's surroundings, and their distance. */
const OCCLUDERS = 5;
export const SURROUNDINGS_MM = 4;
export const MIN_SURROUNDINGS_TEXELS = 2.5;
/** A number as a GLSL literal. */
const glsl = (x: number): string => (Number.isInteger(x) ? `${x}.0` : String(x));
// Software WebGL executes both branches of every `if`, but skips loops without iterations. Expensive parts are
// therefore in loops that rarely run, from the outside in: surfaces, samples near a surface, steps to the next surface.
// It also inlines every call, and many copies take seconds to compile, so that neighbours are visited in loops, too.
//
// Variants. SCAN: the scan around the structures. THIN: translucent structures. EYE: perspective. FINE: smooth
// surfaces, in 1.5 times the time. CUT: clipping. GRAIN: the scan on cut faces. DISPLACED: deformation. ROUGH: pictures
// that are replaced soon, in 1/8 of the time: coverage is one lookup in a filtered texture for the current
// appearances (`covers`), and a surface has the colour of one texel.
export const FRAGMENT = `precision highp float;
precision highp int;
precision highp sampler3D;
precision highp usampler3D;
uniform usampler3D field;    // two structures and their shares, with a border of one empty texel
uniform usampler3D skips;    // per block: distance to the nearest non-empty block, in blocks
#if ROUGH
uniform sampler3D covers;    // solid and translucent coverage per texel, with the field's border
#endif
uniform sampler3D haze;      // scan
// RGBA of 256 structures; 0 is nothing; second row: where clipped; third row: red is the gloss
uniform sampler2D appearances;
uniform mat3 patient;        // gradient per texel to gradient per mm
uniform vec3 corner;         // origin and steps of pixels in texels; perspective: relative to the eye, mm
uniform vec3 across;
uniform vec3 down;
#if EYE
uniform vec3 eye;
uniform float nearest_mm;
uniform float light;         // attenuation, 1 / mm^2
uniform float disc;          // squared radius of the picture, pixels
vec3 into, inward;
float pace;
#else
uniform vec3 into;           // viewing direction, texels per mm
uniform vec3 inward;         // viewing direction, patient, unit
uniform float pace;          // sampling step, mm
#endif
#if CUT
uniform vec4 apex;           // clipping apex: pixel, depth, mm per pixel; perspective: direction, distance
uniform vec2 cone;           // radius at the apex, mm; axial mm per radial mm
#endif
uniform vec3 dims;
uniform float height;
uniform vec2 range;          // of depths: minimum, mm; 1 / extent
uniform vec3 window;         // of the scan: lower end, 1 / width, opacity
uniform vec3 ground;
uniform vec4 lamp;           // key light: direction towards it, patient, unit; strength
uniform float surroundings;  // distance at which surroundings occlude, texels
#if DISPLACED
uniform vec3 reach;          // maximum displacement per axis, texels
#endif
layout(location = 0) out vec4 colour;
layout(location = 1) out vec4 found;
${MOVED}

// isosurface at one half, less a margin for sheets of one texel
const float SURFACE = 0.45;
const float FAINT = 0.02;
const vec2 SOLID = vec2(1.0, 0.0);

#if CUT
int row = 0;                 // row of appearances
#else
const int row = 0;
#endif

// lookup position, clamped to the border
vec3 mappedVoxel(vec3 at) {
#if DISPLACED
  return clamp(moved(at), vec3(-1.0), dims - 0.001);
#else
  return at;
#endif
}

vec4 appearanceOf(uint structure) {
  return texelFetch(appearances, ivec2(int(structure), row), 0);
}

// solid and translucent coverage
vec2 kinds(float opacity) {
#if THIN
  return vec2(opacity == 1.0, opacity > 0.0 && opacity < 1.0);
#else
  return vec2(opacity, 0.0);
#endif
}

vec2 coverageOf(uvec4 texel) {
  return (float(texel.b) * kinds(appearanceOf(texel.r).a) + float(texel.a) * kinds(appearanceOf(texel.g).a)) / 255.0;
}

#if ROUGH
vec2 coverage(vec3 position) {
  return texture(covers, (mappedVoxel(position) + 1.5) / (dims + 2.0)).rg;
}

vec4 paint(vec3 position, vec2 kind) {
  uvec4 texel = texelFetch(field, ivec3(floor(mappedVoxel(position) + 0.5)) + 1, 0);
  vec4 a = appearanceOf(texel.r), b = appearanceOf(texel.g);
  return float(texel.b) * dot(kind, kinds(a.a)) >= float(texel.a) * dot(kind, kinds(b.a)) ? a : b;
}
#else
vec2 coverage(vec3 position) {
  vec3 at = mappedVoxel(position);
  vec3 low = floor(at);
  vec3 w = at - low;
  ivec3 first = ivec3(low) + 1;
  vec2 sum = vec2(0.0);
  for (int c = 0; c < 8; c++) {
    ivec3 o = ivec3(c & 1, (c >> 1) & 1, c >> 2);
    vec3 f = mix(1.0 - w, w, vec3(o));
    sum += f.x * f.y * f.z * coverageOf(texelFetch(field, first + o, 0));
  }
  return sum;
}

// mixed colour and opacity of one kind
vec4 paint(vec3 position, vec2 kind) {
  vec3 at = mappedVoxel(position);
  vec3 low = floor(at);
  vec3 w = at - low;
  ivec3 first = ivec3(low) + 1;
  vec4 sum = vec4(0.0);
  float weight = 1e-6;
  for (int c = 0; c < 8; c++) {
    ivec3 o = ivec3(c & 1, (c >> 1) & 1, c >> 2);
    vec3 f = mix(1.0 - w, w, vec3(o));
    uvec4 texel = texelFetch(field, first + o, 0);
    vec4 a = appearanceOf(texel.r), b = appearanceOf(texel.g);
    float fa = float(texel.b) * dot(kind, kinds(a.a)), fb = float(texel.a) * dot(kind, kinds(b.a));
    vec2 fraction = f.x * f.y * f.z * vec2(fa, fb);
    sum += fraction.x * a + fraction.y * b;
    weight += fraction.x + fraction.y;
  }
  return sum / weight;
}
#endif

// position of the isosurface between two samples
float surface(vec3 origin, float outside, float inside, float before, float after, vec2 kind) {
  float t = inside;
  for (int n = 0; n < 2; n++) {
    t = mix(outside, inside, clamp((SURFACE - before) / (after - before), 0.05, 0.95));
    float there = dot(kind, coverage(origin + t * into));
    bool isAfter = (there >= SURFACE) == (after >= SURFACE);
    inside = isAfter ? t : inside;
    after = isAfter ? there : after;
    outside = isAfter ? outside : t;
    before = isAfter ? before : there;
  }
  return t;
}

// Shading by SHADING. Alpha: cosine of the viewing angle.
// gloss: of the structure; occlusion: darkening of a surface whose surroundings are covered
vec4 lit(vec3 at, vec2 kind, vec3 base, float gloss, float occlusion) {
  // six neighbours, close enough that a sheet of one texel has sides
#if FINE
  const int places = 14;
  const float near = 1.5;
#else
  const int places = 6;
  const float near = 1.0;
#endif
  vec3 gradient = vec3(0.0), slope = vec3(0.0);
  float covered = 0.0;
  for (int c = 0; c < places + ${OCCLUDERS}; c++) {
    vec3 direction = vec3(c >> 1 == 0, c >> 1 == 1, c >> 1 == 2) * (c % 2 == 0 ? 1.0 : -1.0);
    vec3 up = gradient / max(length(gradient), 1e-6);
    vec3 tangent = cross(up, abs(up.x) < 0.6 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0));
    tangent /= max(length(tangent), 1e-6);
    float reach = near;
#if FINE
    // then eight in the tangent plane, wide enough to smooth the steps of voxels
    float angle = 0.785398 * float(c);
    direction = c < 6 ? direction : cos(angle) * tangent + sin(angle) * cross(up, tangent);
    reach = c < 6 ? near : 3.5;
#endif
    // at last the surroundings in front, on a cone about the normal
    bool isAway = c >= places;
    float around = ${((2 * Math.PI) / OCCLUDERS).toFixed(6)} * float(c);
    vec3 sky = 0.816497 * (cos(around) * tangent + sin(around) * cross(up, tangent)) - 0.577350 * up;
    direction = isAway ? sky : direction;
    reach = isAway ? surroundings : reach;
    float cover = dot(kind, coverage(clamp(at + reach * direction, vec3(-1.0), dims - 0.001)));
    covered += isAway ? cover : 0.0;
    vec3 rise = isAway ? vec3(0.0) : direction * cover;
    gradient += c < 6 ? rise / (2.0 * near) : vec3(0.0);
    slope += c < 6 ? vec3(0.0) : rise / (4.0 * reach);
  }
#if FINE
  // these eight determine the tangent components, the six the normal one
  gradient += slope;
#endif
  // outward; a surface without a normal faces the viewer
  vec3 normal = patient * gradient;
  float size = length(normal);
  normal = size > 0.0 ? -normal / size : -inward;
  float facing = abs(dot(normal, inward));
  float key = max(dot(normal, lamp.xyz), 0.0);
  float mirrored = max(dot(normal, normalize(lamp.xyz - inward)), 0.0);
  float open = 1.0 - occlusion * covered / ${OCCLUDERS}.0;
  float dull = ${glsl(SHADING.ambient)} + (${glsl(SHADING.diffuse)} + ${glsl(SHADING.key)} * (1.0 - lamp.w)) * facing;
  dull += ${glsl(SHADING.key)} * lamp.w * key;
  // a broad sheen and a small highlight
  float wet = 0.12 * pow(mirrored, 8.0) + 0.35 * pow(mirrored, 60.0);
  float white = ${glsl(SHADING.specular)} * pow(facing, ${glsl(SHADING.shininess)}) + gloss * lamp.w * wet;
  return vec4(open * (base * dull + white), facing);
}

// dominant structure of one kind
uint dominantAt(vec3 at, vec2 kind) {
  uvec4 texel = texelFetch(field, clamp(ivec3(floor(mappedVoxel(at) + 0.5)), ivec3(0), ivec3(dims) - 1) + 1, 0);
  float first = dot(kind, kinds(appearanceOf(texel.r).a)) * float(texel.b);
  float second = dot(kind, kinds(appearanceOf(texel.g).a)) * float(texel.a);
  return second > first ? texel.g : texel.r;
}

void main() {
  vec2 pixel = vec2(gl_FragCoord.x, height - gl_FragCoord.y);
  vec3 origin = corner + pixel.x * across + pixel.y * down;
#if EYE
  inward = normalize(origin);
  into = inward * patient;
  pace = 0.8 / max(abs(into.x), max(abs(into.y), abs(into.z)));
  origin = eye;
#endif
  vec3 going = mix(into, vec3(1e-9), lessThan(abs(into), vec3(1e-9)));
  vec3 a = (vec3(-1.0) - origin) / going, b = (dims - origin) / going;
  vec3 near = min(a, b), far = max(a, b);
  float t = max(near.x, max(near.y, near.z));
  float end = min(far.x, min(far.y, far.z));
#if EYE
  vec2 fromMiddle = pixel - 0.5 * vec2(height);
  t = max(t, nearest_mm);
  end = disc > 0.0 && dot(fromMiddle, fromMiddle) > disc ? t : end;
#endif
#if CUT
#if EYE
  float cosine = dot(inward, apex.xyz), sine = sqrt(max(0.0, 1.0 - cosine * cosine));
  float cut = min(apex.w / max(cosine, 0.01), (apex.w + cone.x * cone.y) / max(sine * cone.y + cosine, 0.01));
#else
  float cut = apex.z - cone.y * max(0.0, apex.w * length(pixel - apex.xy) - cone.x);
#endif
#endif
  vec3 shown = vec3(0.0);
  float clear = 1.0;                  // transmittance so far
  float passed = t < end ? 0.0 : 1.0; // 0: the ray continues
  vec2 before = vec2(0.0), now = vec2(0.0);
  float last = t;
  float met = -1.0;                   // depth of the solid surface from the start of range, mm; negative: none

  for (int layer = 0; layer < 64 && passed == 0.0; layer++) {
    // next surface
    bool isSurface = false;
    while (!isSurface && t < end && clear > 0.02) {
      // next sample near a surface
      bool isNearSurface = false;
      vec3 at = vec3(0.0);
      uvec4 texel = uvec4(0u);
      before = now;
      while (!isNearSurface && t < end) {
        at = origin + t * into;
#if CUT
        row = t < cut ? 1 : 0;
        last = t < cut ? last : max(last, cut);
#endif
        ivec3 nearest = clamp(ivec3(floor(at + 0.5)), ivec3(0), ivec3(dims) - 1);
        ivec3 block = nearest / ${BLOCK};
        float skip = float(texelFetch(skips, block, 0).r);
#if DISPLACED
        ivec3 here = ivec3(floor(mappedVoxel(at) + 0.5)) + 1;
#else
        ivec3 here = nearest + 1;
#endif
        // after smoothing, no surface lies nearest to a texel without a share of it
#if ROUGH
        vec2 rough = texelFetch(covers, here, 0).rg;
#else
        texel = texelFetch(field, here, 0);
        vec2 rough = coverageOf(texel);
#endif
        isNearSurface = rough.x + rough.y > FAINT;
        float step = pace;
        // to the end of the empty cube of blocks
        vec3 least = (vec3(block) - (skip - 1.0)) * ${BLOCK}.0 - 0.5, most = (vec3(block) + skip) * ${BLOCK}.0 - 0.5;
#if DISPLACED
        // beyond the reach of smoothing
        least += reach;
        most -= reach;
#endif
        vec3 leaves = (mix(least, most, greaterThan(going, vec3(0.0))) - at) / going;
        if (skip > 0.0) step = max(min(leaves.x, min(leaves.y, leaves.z)) + 0.01 * pace, pace);
#if CUT
        step = t < cut ? min(step, cut - t + 0.01 * pace) : step;
#endif
#if SCAN
        step = min(step, 2.0 * pace);
        float value = clamp((texture(haze, (mappedVoxel(at) + 0.5) / dims).r - window.x) * window.y, 0.0, 1.0);
        float dense = 0.03 * clamp((36.0 * value * window.z - 3.0) / 33.0, 0.0, 1.0);
        dense *= 1.0 - clamp(2.0 * (rough.x + rough.y), 0.0, 1.0);
        dense = min(dense * step, 1.0);
        shown += clear * dense * 0.8 * value;
        clear *= 1.0 - dense;
#endif
        before = isNearSurface ? before : vec2(0.0);
        last = isNearSurface ? last : t;
        t = isNearSurface ? t : t + step;
      }
      // nothing between empty space and this sample
      now = isNearSurface ? coverage(at) : vec2(0.0);
      isSurface = now.x >= SURFACE;
#if THIN
      isSurface = isSurface || (before.y < SURFACE && now.y >= SURFACE);
      isSurface = isSurface || (before.y >= SURFACE && now.x + now.y < SURFACE);
      // absorption within translucent structures
#if ROUGH
      texel = texelFetch(field, ivec3(floor(mappedVoxel(at) + 0.5)) + 1, 0);
#endif
      vec4 first = appearanceOf(texel.r), second = appearanceOf(texel.g);
      vec4 within = float(texel.b) * kinds(first.a).y * first + float(texel.a) * kinds(second.a).y * second;
      within /= 255.0;
      float dense = min(0.006 * within.a * pace, 1.0);
      shown += clear * dense * 0.8 * within.rgb;
      clear *= 1.0 - dense;
#endif
      last = isSurface ? last : t;
      t = isSurface ? t : t + pace;
    }

    // a solid surface ends the ray; translucent ones are denser at grazing angles
    vec2 kind = now.x >= SURFACE ? SOLID : 1.0 - SOLID;
    float path = surface(origin, last, t, dot(kind, before), dot(kind, now), kind);
    vec3 hit = origin + path * into;
    vec4 base = paint(hit, kind);
    float gloss = texelFetch(appearances, ivec2(int(dominantAt(hit, kind)), 2), 0).r, occlusion = 0.55;
#if CUT
    // a cut face lies within its structure
    bool isFace = abs(path - cut) < pace;
    occlusion = isFace ? 0.0 : occlusion;
    gloss = isFace ? 0.0 : gloss;
#if GRAIN
    float grain = clamp((texture(haze, (mappedVoxel(hit) + 0.5) / dims).r - window.x) * window.y, 0.0, 1.0);
    base.rgb *= isFace ? 0.4 + 1.1 * grain : 1.0;
#endif
#endif
    vec4 shade = lit(hit, kind, base.rgb, gloss, occlusion);
    float dense = kind.x > 0.5 ? 1.0 : 1.0 - pow(1.0 - 0.6 * base.a, 1.0 / max(shade.a, 0.3));
    dense = isSurface ? dense : 0.0;
#if EYE
    shade.rgb /= 1.0 + light * path * path;
#endif
    met = isSurface && kind.x > 0.5 ? path - range.x : met;
    shown += clear * dense * shade.rgb;
    clear *= 1.0 - dense;
    passed = isSurface && clear > 0.02 ? 0.0 : 1.0;
    last = t;
    t += pace;
  }
  colour = vec4(shown + clear * ground, 1.0);
#if CUT
  row = met + range.x < cut ? 1 : 0;
#endif
  float steps = floor(65535.0 * clamp(met * range.y, 0.0, 1.0) + 0.5);
  float solid = met < 0.0 ? 0.0 : float(dominantAt(origin + (met + range.x) * into, SOLID)) / 255.0;
  found = vec4(floor(steps / 256.0) / 255.0, mod(steps, 256.0) / 255.0, solid, 1.0);
}`;
