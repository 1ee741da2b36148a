/**
 * Where grass grows: GLSL that the ground and the tufts share. Patterns come from the detail textures, turned and bent
 * against each other, so that no period shows from afar.
 */

export const GRASS_COVER_GLSL = /* glsl */ `
struct Cover {
  vec4 wider;
  vec4 wide;
  vec2 bent;    // position, bent by the wide pattern [m]
  float patches; // high where grass is dense and green
  float worn;   // the site is worn; around it grass is denser
};

Cover grassCover(vec2 xy) {
  Cover c;
  c.wider = textureLod(soilDetail, mat2(0.81, 0.59, -0.59, 0.81) * xy * 0.0057 + 0.41, 0.0);
  vec2 bent = xy + 9.0 * (vec2(c.wider.b, c.wider.a) - 0.5);
  c.wide = textureLod(grassDetail, mat2(0.93, -0.36, 0.36, 0.93) * bent * 0.0193 + 0.13, 1.0);
  c.bent = xy + 2.6 * (vec2(c.wide.b, c.wide.a) - 0.5);
  c.patches = c.wide.a * 0.62 + c.wider.a * 0.42;
  float inside = max(abs(xy.x) - halfSize.x, abs(xy.y) - halfSize.y);
  c.worn = mix(0.02, 0.13, smoothstep(-8.0, 14.0, inside));
  return c;
}
`;
