// Ray casting of the field (field.ts) by a WebGL 2 shader. Colour, opacity and visibility of structures are a lookup
// table of 256 entries.

import type { Displacement } from "../drawing/displacement.js";
import { DisplacementTexture, MOVED, reachOf } from "../drawing/displacement.js";
import { BLOCK, TEXEL_BYTES, type Field } from "./field.js";
import { add, apply, dot, invert, length, scale, sub, turn, type Affine, type Vec3 } from "../base/geometry.js";
import { halfFloats } from "../base/half_floats.js";
import { inPieces, slicesOfPiece } from "../base/pieces.js";
import { isSoftware, usedProgram } from "../drawing/shader_program.js";
import { SHADING } from "./shading.gen.js";
import { BACKGROUND, type Cut, type View } from "./view.js";

/** Texture unit of the coverage; the displacement has unit 4. */
const COVERS = 5;
/**
 * Maximum number of texels whose coverage is recomputed on a change of appearances, which takes some milliseconds.
 * Fields without a graphics card are below it, except at full resolution.
 */
const QUICK_TEXELS = 2e6;
/** Number of samples of a surface's surroundings, and their distance. */
const OCCLUDERS = 5;
const SURROUNDINGS_MM = 4;
const MIN_SURROUNDINGS_TEXELS = 2.5;
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
const FRAGMENT = `precision highp float;
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

/** Variant of the shader: the switches described at FRAGMENT. */
interface Kind {
  scan?: boolean;
  thin?: boolean;
  eye?: boolean;
  cut?: boolean;
  grain?: boolean;
  fine?: boolean;
  rough?: boolean;
  displaced?: boolean;
}

export class Caster {
  readonly isSoftware: boolean;
  private readonly gl: WebGL2RenderingContext;
  private readonly programs = new Map<string, WebGLProgram>();
  private readonly drawn = new Set<string>(); // variants that have been drawn, hence compiled, as JSON
  private program: WebGLProgram | null = null;
  private field: Field | null = null;
  private texelFromPatient: Affine = [];
  private appearances = new Uint8Array(1024);
  private gloss = new Uint8Array(256);
  private skipsValid = false; // the texture of skips is valid for the current appearances and field
  private coversValid = false; // the texture of coverage is valid for the current appearances and field
  private window: Vec3 = [0, 1, 0];
  private target: WebGLFramebuffer | null = null; // framebuffer of colours and depths
  private readonly attached: WebGLRenderbuffer[] = [];
  private size = [0, 0]; // width and height of the target
  private range: [number, number] = [0, 1]; // depths of the current view: minimum and extent, mm
  private readonly pixel = new Uint8Array(4);
  private displacement: DisplacementTexture | null = null;

  /** @throws Error without WebGL 2 */
  constructor(readonly canvas: OffscreenCanvas | HTMLCanvasElement) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false }) as WebGL2RenderingContext | null;
    if (!gl) throw new Error("no WebGL 2");
    this.gl = gl;
    this.isSoftware = isSoftware(gl);
    this.setUp();
  }

  get isLost(): boolean {
    return this.gl.isContextLost();
  }

  /** Creates all context objects except the field's textures; also after a context loss. */
  setUp(): void {
    const gl = this.gl;
    this.programs.clear();
    this.drawn.clear();
    gl.disable(gl.DITHER);
    gl.enable(gl.SCISSOR_TEST);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, 256, 3);
    this.setAppearances(this.appearances, this.gloss);
    this.target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    this.attached.length = 0;
    for (const at of [gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]) {
      const buffer = gl.createRenderbuffer()!;
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, at, gl.RENDERBUFFER, buffer);
      this.attached.push(buffer);
    }
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    this.size = [0, 0];
    this.displacement?.setUp();
    this.use({});
  }

  /**
   * Uses a variant of the shader, compiled on first use.
   * @throws Error if the browser rejects the shader
   */
  private use(what: Kind): void {
    const gl = this.gl;
    const define = (name: string, isSo = false) => `#define ${name} ${isSo ? 1 : 0}\n`;
    const head =
      "#version 300 es\n" +
      define("SCAN", what.scan) +
      define("THIN", what.thin) +
      define("EYE", what.eye) +
      define("CUT", what.cut) +
      define("GRAIN", what.grain) +
      define("FINE", what.fine) +
      define("ROUGH", what.rough) +
      define("DISPLACED", what.displaced) +
      define("STRAIN");
    const made = this.programs.get(head);
    if (made) {
      this.program = made;
      return gl.useProgram(made);
    }
    this.program = usedProgram(gl, head + FRAGMENT);
    ["field", "skips", "haze", "appearances"].forEach((name, unit) => gl.uniform1i(this.at(name), unit));
    if (what.rough) gl.uniform1i(this.at("covers"), COVERS);
    gl.uniform3fv(this.at("ground"), BACKGROUND);
    this.programs.set(head, this.program);
  }

  private at(name: string): WebGLUniformLocation | null {
    return this.gl.getUniformLocation(this.program!, name);
  }

  private texture(unit: number, format: GLenum, size: Vec3, filter: GLenum): void {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.deleteTexture(gl.getParameter(gl.TEXTURE_BINDING_3D) as WebGLTexture | null);
    gl.bindTexture(gl.TEXTURE_3D, gl.createTexture());
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_3D, name, filter);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R])
      gl.texParameteri(gl.TEXTURE_3D, name, gl.CLAMP_TO_EDGE);
    gl.texStorage3D(gl.TEXTURE_3D, 1, format, ...size);
  }

  /**
   * Allocates textures for a field, whose contents are uploaded by `upload`.
   * @returns whether the graphics memory suffices
   */
  begin(field: Field, texelFromPatient: Affine): boolean {
    const gl = this.gl;
    this.field = field;
    this.texelFromPatient = texelFromPatient;
    while (gl.getError() !== gl.NO_ERROR && !gl.isContextLost());
    this.texture(0, gl.RGBA8UI, field.bordered, gl.NEAREST);
    this.texture(1, gl.R8UI, field.blocks, gl.NEAREST);
    this.texture(2, gl.R16F, field.haze ? field.dims : [1, 1, 1], gl.LINEAR);
    this.texture(COVERS, gl.RG8, this.isQuick ? field.bordered : [1, 1, 1], gl.LINEAR);
    this.skipsValid = this.coversValid = false;
    return gl.getError() === gl.NO_ERROR;
  }

  /** Whether coverage can be recomputed for each change of appearances. */
  private get isQuick(): boolean {
    return this.field!.texels.length <= TEXEL_BYTES * QUICK_TEXELS;
  }

  /** Uploads a box of the field's texels. */
  upload(lo: Vec3, size: Vec3): void {
    const gl = this.gl;
    const field = this.field!;
    if (this.coversValid) this.uploadCovers(lo, size);
    const box = (unit: number, stride: Vec3, border: number) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.pixelStorei(gl.UNPACK_ROW_LENGTH, stride[0]);
      gl.pixelStorei(gl.UNPACK_IMAGE_HEIGHT, stride[1]);
      gl.pixelStorei(gl.UNPACK_SKIP_PIXELS, lo[0] + border);
      gl.pixelStorei(gl.UNPACK_SKIP_ROWS, lo[1] + border);
    };
    // the view begins at the first slice of the box; memory after the last one is not read
    box(0, field.bordered, 1);
    gl.texSubImage3D(
      gl.TEXTURE_3D,
      0,
      lo[0] + 1,
      lo[1] + 1,
      lo[2] + 1,
      ...size,
      gl.RGBA_INTEGER,
      gl.UNSIGNED_BYTE,
      field.texels.subarray(4 * field.bordered[0] * field.bordered[1] * (lo[2] + 1)),
    );
    if (field.haze) {
      const slice = field.dims[0] * field.dims[1];
      box(2, field.dims, 0);
      gl.texSubImage3D(
        gl.TEXTURE_3D,
        0,
        ...lo,
        ...size,
        gl.RED,
        gl.HALF_FLOAT,
        halfFloats(field.haze.subarray(slice * lo[2], slice * (lo[2] + size[2]))),
      );
    }
    for (const name of [gl.UNPACK_ROW_LENGTH, gl.UNPACK_IMAGE_HEIGHT, gl.UNPACK_SKIP_PIXELS, gl.UNPACK_SKIP_ROWS])
      gl.pixelStorei(name, 0);
    this.skipsValid = false;
  }

  /** Uploads the coverage of a box of texels. */
  private uploadCovers(lo: Vec3, size: Vec3): void {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + COVERS);
    gl.texSubImage3D(
      gl.TEXTURE_3D,
      0,
      lo[0] + 1,
      lo[1] + 1,
      lo[2] + 1,
      ...size,
      gl.RG,
      gl.UNSIGNED_BYTE,
      this.field!.covers(lo, size, this.appearances),
    );
  }

  /** Restores everything after a context loss. */
  async restore(): Promise<void> {
    const field = this.field;
    this.setUp();
    if (!field) return;
    this.begin(field, this.texelFromPatient);
    await inPieces(field.dims[2], slicesOfPiece(field.dims), (from, to) =>
      this.upload([0, 0, from], [field.dims[0], field.dims[1], to - from]),
    );
  }

  /**
   * @param appearances  256 RGBA values: 0 for no structure, then the structures in order
   * @param gloss  256 values of glossOf() in the same order, 0 to 255
   */
  setAppearances(appearances: Uint8Array<ArrayBuffer>, gloss: Uint8Array<ArrayBuffer>): void {
    const gl = this.gl;
    const isSame = (as: (opacity: number) => unknown) =>
      appearances.every((value, n) => n % 4 !== 3 || as(value) === as(this.appearances[n]!));
    this.skipsValid &&= isSame((opacity) => opacity > 0);
    this.coversValid &&= isSame((opacity) => (opacity === 0 ? 0 : opacity === 255 ? 2 : 1));
    [this.appearances, this.gloss] = [appearances, gloss];
    const glossRow = Uint8Array.from({ length: 1024 }, (_, n) => (n % 4 === 0 ? gloss[n / 4]! : 0));
    gl.activeTexture(gl.TEXTURE3);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, appearances);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 2, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, glossRow);
  }

  /** Sets the deformation; null: none. */
  displace(displacement: Displacement | null): void {
    if (displacement && this.displacement?.show(displacement)) return;
    this.displacement?.delete();
    this.displacement = displacement && new DisplacementTexture(this.gl, 4, displacement);
  }
  /** @param mm  displacements of a box of nodes, from displayed positions to positions at rest, patient frame */
  putDisplacement(lo: Vec3, size: Vec3, mm: ArrayLike<number>): void {
    this.displacement?.displacement.write(lo, size, mm);
    this.displacement?.upload(lo, size);
  }

  /**
   * Sets the display of the scan around the structures.
   * @param window  lower and upper end, in stored values of the scan
   * @param strength  0 to 1; 0: none
   */
  setHaze(window: [number, number], strength: number): void {
    this.window = [window[0], 1 / Math.max(window[1] - window[0], 1e-6), strength];
  }

  private kindFor({ eye, cut, isFine }: View): Kind {
    const scan = this.field!.haze !== null && this.window[2] > 0;
    const thin = this.appearances.some((value, n) => n % 4 === 3 && value > 0 && value < 255);
    return {
      scan,
      thin,
      eye: eye !== null,
      cut: cut !== null,
      grain: cut !== null && this.field!.haze !== null,
      fine: isFine,
      rough: !isFine && !cut && this.isQuick,
      displaced: this.displacement !== null,
    };
  }
  /** Whether a view is drawn without compilation. Software WebGL compiles a variant when it is first drawn. */
  isCompiled(view: View): boolean {
    return !this.isSoftware || this.drawn.has(JSON.stringify(this.kindFor(view)));
  }

  /** Sets the view for the following calls of `band`. */
  aim(view: View): void {
    const gl = this.gl;
    const field = this.field!;
    const { eye, cut } = view;
    if (this.size[0] !== view.width || this.size[1] !== view.height) {
      this.size = [view.width, view.height];
      [this.canvas.width, this.canvas.height] = [view.width, view.height];
      for (const buffer of this.attached) {
        gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
        gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, view.width, view.height);
      }
    }
    gl.viewport(0, 0, view.width, view.height);
    if (!this.skipsValid) {
      gl.activeTexture(gl.TEXTURE1);
      const shown = Array.from({ length: 256 }, (_, position) => this.appearances[4 * position + 3]! > 0);
      gl.texSubImage3D(
        gl.TEXTURE_3D,
        0,
        0,
        0,
        0,
        ...field.blocks,
        gl.RED_INTEGER,
        gl.UNSIGNED_BYTE,
        field.skips(shown),
      );
      this.skipsValid = true;
    }
    const kind = this.kindFor(view);
    if (kind.rough && !this.coversValid) {
      this.uploadCovers([0, 0, 0], field.dims);
      this.coversValid = true;
    }
    this.use(kind);
    const m = this.texelFromPatient;
    if (this.displacement) {
      this.displacement.aim(this.program!, m);
      gl.uniform3fv(this.at("reach"), reachOf(this.displacement.displacement.max_mm, m));
    }
    const into = turn(m, view.into);
    gl.uniform3fv(this.at("dims"), field.dims);
    if (eye) {
      gl.uniform3fv(this.at("corner"), sub(view.corner, eye.at));
      gl.uniform3fv(this.at("across"), view.across);
      gl.uniform3fv(this.at("down"), view.down);
      gl.uniform3fv(this.at("eye"), apply(m, eye.at));
      gl.uniform1f(this.at("nearest_mm"), eye.nearest_mm);
      gl.uniform1f(this.at("light"), 1 / eye.reach_mm ** 2);
      gl.uniform1f(this.at("disc"), eye.isRound ? (view.height / 2) ** 2 : 0);
    } else {
      gl.uniform3fv(this.at("corner"), apply(m, view.corner));
      gl.uniform3fv(this.at("across"), turn(m, view.across));
      gl.uniform3fv(this.at("down"), turn(m, view.down));
      gl.uniform3fv(this.at("into"), into);
      gl.uniform3fv(this.at("inward"), view.into);
      // step along the ray, below one texel along each axis
      gl.uniform1f(this.at("pace"), 0.8 / Math.max(...into.map(Math.abs)));
    }
    // transpose of the linear part of texelFromPatient, in column-major order
    gl.uniformMatrix3fv(
      this.at("patient"),
      false,
      [0, 1, 2].flatMap((r) => [0, 1, 2].map((c) => m[r]![c]!)),
    );
    if (cut) this.setClipping(view, cut);
    this.range = this.depthRange(view);
    gl.uniform2f(this.at("range"), this.range[0], 1 / this.range[1]);
    gl.uniform1f(this.at("height"), view.height);
    gl.uniform3fv(this.at("window"), this.window);
    const [aside, above, towards] = SHADING.keyDirection;
    const key = [
      scale(view.across, aside / length(view.across)),
      scale(view.down, -above / length(view.down)),
      scale(view.into, -towards),
    ].reduce(add);
    // an arthroscope has its own light alone
    gl.uniform4f(this.at("lamp"), ...scale(key, 1 / length(key)), eye?.isRound ? 0 : 1);
    const texelsPerMm = Math.max(...m.map((row) => Math.hypot(row[0]!, row[1]!, row[2]!)));
    gl.uniform1f(this.at("surroundings"), Math.max(MIN_SURROUNDINGS_TEXELS, SURROUNDINGS_MM * texelsPerMm));
  }
  private setClipping({ corner, across, down, into, eye }: View, cut: Cut): void {
    const gl = this.gl;
    const from = sub(cut.at, eye ? eye.at : corner);
    const far = length(from);
    if (eye) gl.uniform4f(this.at("apex"), from[0] / far, from[1] / far, from[2] / far, far);
    else
      gl.uniform4f(
        this.at("apex"),
        dot(from, across) / dot(across, across),
        dot(from, down) / dot(down, down),
        dot(from, into),
        length(across),
      );
    gl.uniform2f(this.at("cone"), cut.radius_mm, 1 / cut.widening);
    const appearances = new Uint8Array(1024);
    appearances.set(this.appearances.subarray(4 * cut.unclipped, 4 * cut.unclipped + 4), 4 * cut.unclipped);
    gl.activeTexture(gl.TEXTURE3);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 1, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, appearances);
  }
  /** Depth range of the volume along a view's rays: minimum and extent, mm. */
  private depthRange({ corner, into, eye }: View): [number, number] {
    const patientFromTexel = invert(this.texelFromPatient);
    const depths = Array.from({ length: 8 }, (_, n) => {
      const end = apply(patientFromTexel, this.field!.dims.map((size, axis) => ((n >> axis) & 1 ? size : -1)) as Vec3);
      return eye ? length(sub(end, eye.at)) : dot(sub(end, corner), into);
    });
    const least = eye ? 0 : Math.min(...depths);
    return [least, Math.max(...depths) - least];
  }

  /**
   * Draws some rows of the picture from the top and waits for completion.
   * @returns duration, ms
   */
  band(view: View, from: number, to: number): number {
    const gl = this.gl;
    this.wait();
    const before = performance.now();
    this.drawn.add(JSON.stringify(this.kindFor(view)));
    gl.scissor(0, view.height - to, view.width, to - from);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.wait();
    return performance.now() - before;
  }
  /**
   * Completed picture, after all bands are drawn.
   * @returns bitmap, bytes of `Found`, and minimum and extent of their depths
   */
  async finish(
    view: View,
  ): Promise<{ bitmap: ImageBitmap; bytes: Uint8Array<ArrayBuffer>; min_mm: number; extent_mm: number }> {
    const gl = this.gl;
    const { width, height } = view;
    const read = (from: GLenum) => {
      const bytes = new Uint8Array(4 * width * height);
      gl.readBuffer(from);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
      return bytes;
    };
    const bytes = read(gl.COLOR_ATTACHMENT1);
    const [min_mm, extent_mm] = this.range;
    // asynchronous, because a blocking read would wait for the page's other pictures, too
    if (this.isSoftware) {
      const pixels = new ImageData(new Uint8ClampedArray(read(gl.COLOR_ATTACHMENT0).buffer), width, height);
      return { bitmap: await createImageBitmap(pixels, { imageOrientation: "flipY" }), bytes, min_mm, extent_mm };
    }
    gl.readBuffer(gl.COLOR_ATTACHMENT0);
    gl.scissor(0, 0, width, height);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.target);
    const { canvas } = this;
    const bitmap = "transferToImageBitmap" in canvas ? canvas.transferToImageBitmap() : await createImageBitmap(canvas);
    return { bitmap, bytes, min_mm, extent_mm };
  }
  /** Waits for all pending drawing, including the page's other pictures, by reading a pixel. */
  private wait(): void {
    const gl = this.gl;
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, this.pixel);
  }
}
