/** GLSL of the natural ground: soil in layers, fresh dirt, dry and green grass, moisture. */

import { GRASS_COVER_GLSL } from "./grass_cover";

export const NATURAL_GROUND_GLSL = /* glsl */ `
${GRASS_COVER_GLSL}

vec4 soilTexture(vec3 p, vec3 weights, float scale) {
  vec4 t = weights.z * texture2D(soilDetail, p.xy * scale);
  if (weights.x > 0.02) t += weights.x * texture2D(soilDetail, p.yz * scale + 0.31);
  if (weights.y > 0.02) t += weights.y * texture2D(soilDetail, p.xz * scale + 0.67);
  return t;
}

Ground naturalGround(vec3 p, vec3 normal, vec4 shape, vec4 surface, vec4 state, float outside) {
  Ground g;
  vec3 weights = pow(abs(normal), vec3(5.0));
  weights /= weights.x + weights.y + weights.z;
  // Two scales that share no period; the finer one fades out before it aliases.
  float pixel = max(length(dFdx(p)), length(dFdy(p))); // [m]
  vec4 fine = soilTexture(p, weights, 0.62);
  fine = mix(fine, textureLod(soilDetail, vec2(0.5), 9.0), 0.85 * smoothstep(0.012, 0.07, pixel));
  Cover cover = grassCover(p.xy);
  vec4 wide = cover.wide;
  vec4 wider = cover.wider;
  vec2 bent = cover.bent;
  vec4 coarse = soilTexture(p + vec3(0.7 * (bent - p.xy), 3.7), weights, 0.131);
  vec4 turf = texture2D(grassDetail, p.xy * 0.83);
  turf = mix(turf, textureLod(grassDetail, vec2(0.5), 9.0), 0.85 * smoothstep(0.01, 0.06, pixel));
  vec4 turf2 = texture2D(grassDetail, mat2(0.74, 0.67, -0.67, 0.74) * bent * 0.171 + 0.5);

  float disturbed = surface.a * (1.0 - smoothstep(0.0, 0.5, outside));
  vec3 soil = saturated(surface.rgb * surface.rgb, 0.72);
  float luminance = dot(soil, vec3(0.3, 0.59, 0.11));

  // Soil: dark topsoil near the original surface, layers below it.
  float depth = max(-shape.a, 0.0);
  float wobble = 0.25 * (coarse.a - 0.5) + 0.1 * (fine.b - 0.5);
  float topsoil = (1.0 - smoothstep(0.18, 0.42, depth + wobble)) * step(shape.a, 0.0);
  float steep = smoothstep(0.25, 0.75, 1.0 - normal.z);
  float layer = sin((p.z + 0.5 * wobble) * 21.0) + 0.6 * sin((p.z + 0.8 * wobble) * 47.0 + 1.7);
  vec3 bank = soil * mix(1.0, 0.62, topsoil);
  bank *= 1.0 + steep * smoothstep(0.05, 0.3, depth) * 0.085 * layer;
  float lump = fine.b * 0.65 + coarse.b * 0.35;
  vec3 dirt = bank * (0.28 + 1.5 * lump);
  dirt = mix(dirt, dirt * vec3(1.14, 1.02, 0.86), smoothstep(0.4, 0.75, coarse.a));
  dirt = mix(dirt, vec3(luminance) * vec3(1.32, 1.25, 1.12), 0.42 * smoothstep(0.6, 0.82, fine.b)); // dry, pale lumps
  dirt *= 0.82 + 0.36 * wide.b;

  // Untouched ground: dry grass, green tufts and bare spots.
  float patches = cover.patches + turf2.a * 0.14;
  vec3 straw = mix(vec3(0.22, 0.175, 0.095), vec3(0.42, 0.35, 0.21), turf.b);
  vec3 green = mix(vec3(0.075, 0.080, 0.030), vec3(0.205, 0.205, 0.092), turf.b);
  vec3 grass = mix(straw, green, smoothstep(0.50, 0.78, patches + 0.25 * (turf.b - 0.5)));
  grass *= 0.72 + 0.55 * turf2.b;
  float bare = smoothstep(0.60, 0.47, patches + 0.16 * (turf2.b - 0.5) + 0.26 * (turf.b - 0.5) + cover.worn);
  vec3 dry = mix(soil * 0.95, vec3(luminance) * vec3(1.18, 1.05, 0.86), 0.35) * (0.62 + 0.75 * lump);
  vec3 turfColor = mix(grass, dry, bare * 0.85);
  // Woods on the far hills.
  turfColor = mix(turfColor, vec3(0.045, 0.062, 0.028) * (0.6 + 0.9 * wide.b), smoothstep(120.0, 420.0, outside) * smoothstep(0.36, 0.56, wider.a + 0.15 * wide.b));

  // The edge of a cut is ragged: lumps rise through the grass first.
  float fresh = smoothstep(0.30, 0.62, disturbed + 0.35 * (lump - 0.5) * step(0.02, disturbed) * step(disturbed, 0.98));
  fresh = max(fresh, smoothstep(0.22, 0.36, 1.0 - normal.z) * (1.0 - smoothstep(0.0, 1.0, outside)));
  g.color = mix(turfColor, dirt, fresh);

  float wet = smoothstep(0.15, 0.95, state.x) * (1.0 - smoothstep(0.0, 4.0, outside));
  g.color = saturated(g.color, 1.0 + 0.25 * wet) * mix(1.08, 0.50, wet);
  g.roughness = mix(0.98, 0.62, smoothstep(0.55, 1.0, state.x) * fresh);

  // Slopes of the textures, on the plane that each was projected onto.
  float loose = smoothstep(0.01, 0.12, state.y);
  vec2 slope = ((fine.rg - 0.5) * 1.5 + (coarse.rg - 0.5) * 1.1) * mix(0.75, 1.3, loose);
  vec2 turfSlope = (turf.rg - 0.5) * 1.5 + (turf2.rg - 0.5) * 0.5;
  vec2 bump = mix(turfSlope, slope, max(fresh, bare)) * detailAmount;
  vec3 t = normalize(vec3(normal.z, 0.0, -normal.x));
  vec3 b = cross(normal, t);
  g.normal = normalize(normal - t * bump.x * -1.0 - b * bump.y * -1.0);
  float cavity = mix(turf.b, lump, max(fresh, bare));
  g.openness = shape.b * mix(0.62, 1.0, smoothstep(0.12, 0.55, cavity));
  return g;
}
`;
