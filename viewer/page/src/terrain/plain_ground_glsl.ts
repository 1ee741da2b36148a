/**
 * GLSL of the natural ground with few texture reads, for computers that draw in software. It has the colours of
 * `surface_glsl.ts` without triplanar projection, bumps and ragged borders.
 */

export const PLAIN_GROUND_GLSL = /* glsl */ `
Ground naturalGround(vec3 p, vec3 normal, vec4 shape, vec4 surface, vec4 state, float outside) {
  Ground g;
  float pixel = length(fwidth(p.xy)); // [m]
  vec4 fine = texture2D(soilDetail, p.xy * 0.31);
  // From afar its period would show.
  fine = mix(fine, textureLod(soilDetail, p.xy * 0.047, 1.0), 0.8 * smoothstep(0.02, 0.12, pixel));
  vec4 turf = texture2D(grassDetail, p.xy * 0.171);
  float pattern = texture2D(grassDetail, p.xy * 0.0193).a;
  float lump = fine.b;
  float disturbed = surface.a * (1.0 - smoothstep(0.0, 0.5, outside));
  vec3 soil = saturated(surface.rgb * surface.rgb, 0.72);
  float luminance = dot(soil, vec3(0.3, 0.59, 0.11));
  float depth = max(-shape.a, 0.0);
  float topsoil = (1.0 - smoothstep(0.18, 0.42, depth + 0.2 * (fine.a - 0.5))) * step(shape.a, 0.0);
  vec3 dirt = soil * mix(1.0, 0.62, topsoil) * (0.28 + 1.5 * lump);
  vec3 straw = mix(vec3(0.22, 0.175, 0.095), vec3(0.42, 0.35, 0.21), turf.b);
  vec3 green = mix(vec3(0.075, 0.080, 0.030), vec3(0.205, 0.205, 0.092), turf.b);
  vec3 grass = mix(straw, green, smoothstep(0.50, 0.78, 1.04 * pattern + 0.25 * (turf.b - 0.5)));
  float bare = smoothstep(0.60, 0.47, 1.04 * pattern + 0.4 * (turf.b - 0.5));
  vec3 dry = mix(soil, vec3(luminance) * vec3(1.18, 1.05, 0.86), 0.35) * (0.62 + 0.75 * lump);
  vec3 turfColor = mix(grass, dry, 0.85 * bare);
  turfColor = mix(turfColor, vec3(0.045, 0.062, 0.028), smoothstep(120.0, 420.0, outside) * smoothstep(0.4, 0.6, pattern));
  float fresh = smoothstep(0.30, 0.62, disturbed);
  fresh = max(fresh, smoothstep(0.22, 0.36, 1.0 - normal.z) * (1.0 - smoothstep(0.0, 1.0, outside)));
  float wet = smoothstep(0.15, 0.95, state.x) * (1.0 - smoothstep(0.0, 4.0, outside));
  g.color = mix(turfColor, dirt, fresh) * mix(1.08, 0.50, wet);
  g.roughness = 1.0;
  g.normal = normal;
  g.openness = shape.b * mix(0.62, 1.0, smoothstep(0.12, 0.55, mix(turf.b, lump, max(fresh, bare))));
  return g;
}
`;
