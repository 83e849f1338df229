#version 330
// Rooms to train on. K is a whole pattern number plus a fraction that serves as its seed; T runs over the quad
// in metres.
in vec3 P, N, C;
in vec2 T;
flat in float K;
uniform vec3 light, ambient, lamp_at[3], lamp_colour[3], room;  // room: half sides and height, metres
uniform float joint;
uniform sampler3D fractal3;
out vec4 colour;
float fractal(vec3 p) { return texture(fractal3, p).r; }
void main() {
  int kind = int(K);
  float seed = fract(K) * 40.;
  vec3 a = C * (.85 + .3 * fractal(P * .9 + seed)) * (.94 + .12 * fractal(P * 7. + seed)), glow = vec3(0);
  if (kind == 1) { // tiles or boards
    vec2 t = abs(fract(T / vec2(joint, joint * (seed > 20. ? 4. : 1.))) - .5);
    a *= max(t.x, t.y) > .485 ? .72 : 1.;
    a *= .92 + .16 * fractal(vec3(floor(T / joint) * .37, seed));
  }
  if (kind == 2) a *= fract(T.y / .9) < .02 ? .75 : 1.; // panelling
  if (kind == 3) glow = C * (.75 + .5 * fractal(vec3(T * .4, seed))); // windows, lamps, screens
  if (kind == 4) a *= .55 + .45 * abs(sin(T.x * (20. + seed) + 2. * fractal(P * 2.))); // curtains
  if (kind == 5) { // blinds before a bright window
    float slat = fract(T.y * 18.);
    glow = slat < .35 ? C * .9 : vec3(0); a *= .7;
  }
  if (kind == 6) { // posters, screens, boards with writing
    float cell = fractal(vec3(floor(T * (6. + seed * .3)) * .173, seed));
    a = mix(C, vec3(fractal(vec3(T * .7, seed)), cell, fractal(vec3(T * 1.3, seed + 9.))), cell > .5 ? .8 : .15);
  }
  if (kind == 7) a *= .6 + .8 * fractal(vec3(T * vec2(9., 1.2), seed)); // wood
  if (kind == 8) a *= .5 + fractal(P * 23. + seed); // carpet, rough stuff
  vec3 n = normalize(N);
  vec3 lit = ambient * (.6 + .4 * n.z) + .35 * max(dot(n, light), 0.);
  for (int i = 0; i < 3; i++) {
    vec3 d = lamp_at[i] - P;
    lit += lamp_colour[i] * max(dot(n, normalize(d)) * .8 + .2, 0.) / (1. + .25 * dot(d, d));
  }
  vec3 gap = vec3(room.xy - abs(P.xy), min(P.z, room.z - P.z)); // darker towards corners
  float near = (smoothstep(0., .7, gap.x) + smoothstep(0., .7, gap.y) + smoothstep(0., .5, gap.z)) / 3.;
  colour = vec4(pow(clamp(a * lit * (.7 + .3 * near) + glow, 0., 1.), vec3(1. / 2.2)), 1);
}
