#version 330
// Lit like people, see person.frag.
in vec3 N, P, C;
in vec4 light_position;
in vec3 sky_position;
flat in vec2 S;
uniform vec3 eye_world, light, light_colour, fill, fill_colour, ambient_up, ambient_down;
uniform float seed;
uniform sampler2D shadow_map, sky_map;
uniform sampler3D white3, fractal3;
out vec4 colour;

float white(vec3 p) { return texture(white3, (p + .5) / 32.).r; }
float fractal(vec3 p) { return texture(fractal3, (p + .5) / 16.).r; }

void main() {
  vec3 n = normalize(N), a = C, q = P + seed;
  float gloss = S.y, power = mix(8., 60., gloss), dust = fractal(q * 9.);
  int pattern = int(S.x + .5);
  if (pattern == 0) a *= .92 + .16 * dust;
  else if (pattern == 1) a *= .55 + .6 * fractal(q * 14.) + .3 * fractal(q * 50.); // mottled
  else if (pattern == 2) { // wood: rings of a trunk along x
    float rings = fract(length(q.yz + .04 * fractal(q * vec3(2., 8., 8.))) * 22. + 2. * fractal(q * vec3(3., 20., 20.)));
    a *= mix(.78, 1.05, smoothstep(0., .35, rings) * smoothstep(1., .7, rings)) * (.9 + .2 * fractal(q * vec3(4., 40., 40.)));
  } else if (pattern == 3) { // woven
    vec3 t = sin(q * 320.);
    a *= (.9 + .06 * (t.x * t.y + t.y * t.z + t.z * t.x)) * (.85 + .3 * dust);
  } else if (pattern == 4) { // brushed metal
    a *= .8 + .35 * fractal(q * vec3(3., 45., 45.));
    n = normalize(n + .12 * (vec3(fractal(q * 60.), fractal(q * 60. + 3.), fractal(q * 60. + 7.)) - .45));
  } else { // fur
    a *= .45 + .5 * white(q * vec3(150., 150., 50.)) + .45 * fractal(q * 10.);
    n = normalize(n + .9 * (vec3(fractal(q * 45.), fractal(q * 45. + 3.), fractal(q * 45. + 7.)) - .45));
  }
  vec3 view = normalize(eye_world - P), halfway = normalize(light + view);
  if (dot(n, view) < 0.) n = -n;
  vec3 lp = light_position.xyz / light_position.w * .5 + .5;
  float lit = 0., open = 0.;
  for (int i = -1; i < 2; i++) for (int j = -1; j < 2; j++) {
    lit += texture(shadow_map, lp.xy + vec2(i, j) / 400.).r < lp.z - .008 ? 0. : 1.;
    open += clamp(1. - (sky_position.z - .012 - texture(sky_map, sky_position.xy + vec2(i, j) / 60.).r) * 9., 0., 1.);
  }
  lit /= 9.;
  open = mix(.42, 1., open / 9.);
  float key = max((dot(n, light) + .12) / 1.12, 0.) * lit;
  vec3 c = a * (light_colour * key + fill_colour * max(dot(n, fill), 0.) + mix(ambient_down * (.5 + .5 * open), ambient_up * open, .5 + .5 * n.z));
  float mirror = gloss * gloss * (.5 + .5 * smoothstep(-.2, .3, reflect(-view, n).z)); // a room without detail
  c = mix(c, mix(vec3(1), C, pattern == 4 ? .8 : .2) * mix(ambient_down, ambient_up, .5 + .5 * reflect(-view, n).z), .5 * mirror);
  c += light_colour * gloss * (lit + .15) * (pow(max(dot(n, halfway), 0.), power) + .25 * pow(1. - max(dot(n, view), 0.), 4.));
  c = mix(c, 1. - exp(-c * 1.15), smoothstep(.45, 1.1, max(c.r, max(c.g, c.b)))); // a film's shoulder
  colour = vec4(pow(clamp(c, 0., 1.), vec3(1. / 2.2)), 1);
}
