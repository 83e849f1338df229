#version 330
in vec3 P, N, C;
flat in float K;
uniform vec3 light;
uniform sampler3D fractal3;
out vec4 colour;
void main() {
  vec3 a = C * (.85 + .3 * texture(fractal3, P * .9).r) * (.95 + .1 * texture(fractal3, P * 7.).r);
  if (K == 1.) { // tiles or boards with dark joints
    vec2 t = abs(fract(P.xy / vec2(.6, .6)) - .5);
    a *= max(t.x, t.y) > .487 ? .7 : 1.;
  }
  if (K == 2.) a *= fract(P.z / .9) < .02 ? .75 : 1.; // panelling
  vec3 n = normalize(N);
  float corner = .75 + .25 * smoothstep(0., .6, P.z) * (n.z > .5 ? 1. : smoothstep(0., .5, P.z));
  vec3 c = a * (.45 + .55 * max(dot(n, light), 0.)) * corner;
  colour = vec4(pow(clamp(c, 0., 1.), vec3(1. / 2.2)), 1);
}
