/** GLSL of the ground's look: colour, roughness, slope and occlusion at a point. */

import { NATURAL_GROUND_GLSL } from "./natural_ground_glsl";
import { PLAIN_GROUND_GLSL } from "./plain_ground_glsl";

export const SURFACE_GLSL = /* glsl */ `
uniform sampler2D shapeMap;
uniform sampler2D surfaceMap;
uniform sampler2D stateMap;
uniform highp sampler2D cellMap;
uniform highp sampler2D designMap;
uniform sampler2D soilDetail;
uniform sampler2D grassDetail;
uniform sampler2D scaleMap;
uniform vec3 soilColors[MAX_SOILS];
uniform vec4 coloring;       // index, low end, high end, whether there is a design
uniform float contourStep;   // [m], 0 for none
uniform float commonSoil;   // id of the soil of the surroundings
uniform float detailAmount;  // 0 to 1
uniform vec4 contacts[MAX_CONTACTS]; // bodies close to the ground: x, y, half length, half width [m]
uniform vec2 contactAxes[MAX_CONTACTS];
uniform int contactCount;

varying vec3 vGround;        // position [m]
varying vec3 vGroundNormal;  // normal of the coarse surface

struct Ground {
  vec3 color;
  float roughness;
  vec3 normal;
  float openness;
};

// Share of the sky that bodies standing on the ground hide.
float contactShade(vec2 xy) {
  float open = 1.0;
  for (int i = 0; i < MAX_CONTACTS; i++) {
    if (i >= contactCount) break;
    vec2 d = xy - contacts[i].xy;
    vec2 axis = contactAxes[i];
    vec2 local = abs(vec2(dot(d, axis), dot(d, vec2(-axis.y, axis.x)))) - contacts[i].zw;
    float outside = length(max(local, 0.0)) + min(max(local.x, local.y), 0.0);
    open *= 1.0 - 0.62 * (1.0 - smoothstep(-0.5, 0.9, outside));
  }
  return open;
}

vec3 saturated(vec3 color, float amount) {
  return max(mix(vec3(dot(color, vec3(0.3, 0.59, 0.11))), color, amount), 0.0);
}

#ifdef PLAIN
${PLAIN_GROUND_GLSL}
#else
${NATURAL_GROUND_GLSL}
#endif

vec3 scaleColor(float value) {
  float t = clamp((value - coloring.y) / (coloring.z - coloring.y), 0.0, 1.0);
  return texture2D(scaleMap, vec2((t * 63.0 + 0.5) / 64.0, (coloring.x + 0.5) / COLORING_COUNT)).rgb;
}

float looseAt(ivec2 i) {
  vec4 cell = texelFetch(cellMap, clamp(i, ivec2(0), ivec2(grid.yx) - 1), 0) * 255.0;
  return (cell.z + 256.0 * cell.w) * 0.001;
}

float designHeight(vec2 xy) {
  return texelFetch(designMap, clamp(ivec2(round(gridPosition(xy))), ivec2(0), ivec2(grid.yx) - 1), 0).r;
}

vec3 thematicColor(vec3 p, vec4 shape, vec4 state, vec3 natural) {
  int kind = int(coloring.x + 0.5);
  if (kind == 1) return scaleColor(p.z);
  if (kind == 2) {
    float change = shape.a;
    if (coloring.w > 0.5) {
      float design = designHeight(p.xy);
      if (isnan(design)) return vec3(dot(natural, vec3(0.33)));
      change = p.z - design;
    }
    return scaleColor(change);
  }
  if (kind == 3) {
    ivec2 at = clamp(ivec2(round(gridPosition(p.xy))), ivec2(0), ivec2(grid.yx) - 1);
    return soilColors[min(int(texelFetch(cellMap, at, 0).r * 255.0 + 0.5), MAX_SOILS - 1)];
  }
  if (kind == 4) return scaleColor(100.0 * state.x);
  return scaleColor(state.y);
}

float contourLine(float z) {
  float width = fwidth(z / contourStep);
  float at = z / contourStep;
  float line = 1.0 - smoothstep(0.6, 1.5, abs(fract(at - 0.5) - 0.5) / max(width, 1e-6));
  float major = 1.0 - smoothstep(0.9, 2.0, abs(fract(at * 0.2 - 0.5) - 0.5) / max(width * 0.2, 1e-6));
  return max(0.45 * line, 0.75 * major) * (1.0 - smoothstep(0.25, 0.6, width));
}

Ground groundAt() {
  vec3 p = vGround;
  vec2 at = (gridPosition(p.xy) + 0.5) / grid.yx;
  float outside = outsideDistance(p.xy);
  vec4 shape = texture2D(shapeMap, at);
#ifdef PLAIN
  vec4 ragged = vec4(0.5);
#else
  // Borders between soils and of diggings are ragged, not those of cells.
  vec4 ragged = texture2D(soilDetail, p.xy * 0.43);
#endif
  vec2 shifted = at + (ragged.ba - 0.5) * vec2(0.9, 0.7) * 0.4 / (grid.z * grid.yx);
  vec4 surface = texture2D(surfaceMap, shifted);
  vec3 surrounding = soilColors[int(commonSoil)];
  surface.rgb = mix(surface.rgb, sqrt(surrounding), smoothstep(0.0, 14.0, outside + 6.0 * (ragged.a - 0.5)) * step(0.01, outside));
  vec4 state = texture2D(stateMap, at);
  vec3 normal = normalize(mix(vec3(-shape.xy, 1.0), vGroundNormal / vGroundNormal.z, smoothstep(0.0, 2.0, outside)));
  if (outside > 0.0) shape = mix(shape, vec4(0.0, 0.0, 1.0, 0.0), smoothstep(0.0, 3.0, outside));
  Ground g = naturalGround(p, normal, shape, surface, state, outside);
  if (coloring.x > 0.5 && outside == 0.0) {
    float shade = dot(g.color, vec3(0.3, 0.59, 0.11));
    // Dimmed, so that the lit ground has the colours of the legend.
    g.color = thematicColor(p, shape, state, g.color) * (0.46 + 0.30 * smoothstep(0.0, 0.3, shade));
    g.normal = normalize(mix(normal, g.normal, 0.5));
    g.roughness = 0.95;
  }
  if (contourStep > 0.0 && outside == 0.0) g.color = mix(g.color, vec3(0.02), contourLine(p.z));
  g.openness *= contactShade(p.xy);
  return g;
}
`;
