// How a normal and an albedo look under a light: one text for the picture and for the surface.
const MODES = ["lambert", "gloss", "matt", "specular", "raking"];

const SHADING = `
uniform int mode; // in the order of MODES
uniform vec3 light, eye; // unit vectors from the surface
uniform float exposure, gloss, sharpness;

vec3 shown(vec3 linear) { return pow(clamp(linear, 0.0, 1.0), vec3(1.0 / 2.2)); }

vec3 lit(vec3 n, vec3 encoded) {
  vec3 albedo = pow(encoded, vec3(2.2));
  float lambert = max(dot(n, light), 0.0);
  float glint = lambert > 0.0 ? pow(max(dot(n, normalize(light + eye)), 0.0), sharpness) : 0.0;
  vec3 c = albedo * lambert;
  if (mode == 1) c += gloss * glint;
  if (mode == 2) c = vec3(0.9 * lambert);
  if (mode == 3) c = 0.18 * albedo + (0.25 + 0.75 * albedo) * gloss * 1.6 * glint;
  if (mode == 4) c = albedo * lambert * 0.5 / (0.15 + 0.85 * light.z); // what lies flat stays visible
  return shown(exposure * c);
}`;

// The light that a mode uses: raking light keeps the direction and comes from low down.
function lightOf(look) {
  if (look.mode !== "raking") return look.light;
  const a = Math.atan2(look.light[1], look.light[0]),
    e = (look.raking * Math.PI) / 180;
  return [Math.cos(a) * Math.cos(e), Math.sin(a) * Math.cos(e), Math.sin(e)];
}

const shadingValues = (look, eye = [0, 0, 1]) => ({
  mode: { int: MODES.indexOf(look.mode) },
  light: lightOf(look),
  eye,
  exposure: look.exposure,
  gloss: look.gloss,
  sharpness: look.sharpness,
});
