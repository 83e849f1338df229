#version 330
uniform float light;
out vec4 colour;
void main() {
  vec2 at = gl_PointCoord * 2. - 1.;
  float r = dot(at, at);
  if (r > 1.) discard;
  colour = vec4(vec3(pow(clamp((.30 + .25 * sqrt(1. - r)) * light, .12, 1.), 1. / 2.2)), 1);
}
