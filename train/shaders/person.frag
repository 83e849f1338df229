in vec3 N, P, Q;
in float arm, eye, head;
in vec4 light_position;
uniform vec3 eye_world, light, light_colour, ambient_up, ambient_down;
uniform vec3 skin, shirt_a, shirt_b, trousers_a, trousers_b, hair_colour, shoe_colour;
uniform ivec2 pattern;
uniform vec2 pattern_scale;
uniform float seed, hair_line, fold_depth;
uniform sampler2D shadow_map;
uniform sampler3D white3, fractal3;
out vec4 colour;

float white(vec3 p) { return texture(white3, (p + .5) / 32.).r; }
float fractal(vec3 p) { return texture(fractal3, (p + .5) / 16.).r; }

vec3 cloth(vec3 a, vec3 b, int kind, float s) {
  float around = atan(Q.y, Q.x) / 6.2832 * .9; // stripes run round the body, not through it
  vec3 q = Q * s + seed;
  if (kind == 0) return a * (.9 + .2 * fractal(q * 3.));
  if (kind == 1) return mix(a, b, step(.5, fract(Q.z * s)));
  if (kind == 2) return mix(a, b, step(.5, fract(around * s)));
  if (kind == 3) return mix(a, b, .5 * step(.5, fract(around * s)) + .5 * step(.5, fract(Q.z * s)));
  if (kind == 4) return mix(a, b, smoothstep(.42, .55, fractal(q)));
  if (kind == 5) return mix(b, a, step(.3, length(fract(Q * s) - .5)));
  return mix(a, b, step(0., Q.z - .2 + .1 * sin(seed)));
}

vec3 face(vec3 a) {
  float ax = abs(Q.x);
  vec2 brow = vec2(ax - .032, Q.z - .748 - .05 * (ax - .03));
  if (abs(brow.y) < .006 && abs(brow.x) < .021) a = mix(a, hair_colour, .75);
  vec2 lips = vec2(Q.x / .026, (Q.z - .647) / .011);
  if (dot(lips, lips) < 1. && Q.y < -.12) a = mix(a, vec3(.62, .28, .27) * (.4 + skin), .6);
  return a;
}

void main() {
  if (absent(Q, arm)) discard;
  int z = zone(Q, arm);
  vec3 n = normalize(N);
  if (!gl_FrontFacing) n = -n;
  vec3 a; float gloss = .1;
  if (part == 0) {
    a = skin * (.85 + .3 * fractal(Q * 14. + seed)) * (.93 + .14 * fractal(Q * 60. + seed));
    gloss = .2;
    if (z == SHOE) { a = shoe_colour * (.8 + .4 * fractal(Q * 30.)); gloss = .3; }
    if (eye > .5) {
      float r = length(vec2(abs(Q.x) - .0315, Q.z - .7225));
      a = r < .0055 ? vec3(.02) : (r < .0115 ? vec3(.25, .16, .09) : vec3(.85)); gloss = .8;
    } else if (head > .5 && Q.y < -.08) a = face(a);
    if (head > .5 && hair_line > 0. && Q.z > .62 && Q.z + 1.2 * (Q.y + .02) > hair_line + .015 * fractal(Q * 60.)
        && !(abs(Q.x) > .068 && Q.z < .73)) {
      a = hair_colour * (.7 + .6 * white(vec3(Q.x * 160., Q.y * 40., Q.z * 40.))); gloss = .3;
    }
  } else if (part == 3) {
    a = hair_colour * (.6 + .8 * white(vec3(Q.x * 180., Q.y * 180., Q.z * 20.))); gloss = .35;
  } else {
    a = (z == SHIRT && part == 1) ? cloth(shirt_a, shirt_b, pattern.x, pattern_scale.x)
                                  : cloth(trousers_a, trousers_b, pattern.y, pattern_scale.y);
    gloss = .05;
    vec3 q = Q * vec3(22., 22., 13.) + seed * 3.;
    vec3 slope = vec3(fractal(q + vec3(.3, 0, 0)), fractal(q + vec3(0, .3, 0)), fractal(q + vec3(0, 0, .3)));
    n = normalize(n + fold_depth * (slope - fractal(q)));
  }
  vec3 view = normalize(eye_world - P), halfway = normalize(light + view);
  vec3 lp = light_position.xyz / light_position.w * .5 + .5;
  float lit = 0.;
  for (int i = -1; i < 2; i++) for (int j = -1; j < 2; j++)
    lit += texture(shadow_map, lp.xy + vec2(i, j) / 512.).r < lp.z - .006 ? 0. : 1.;
  lit /= 9.;
  vec3 c = a * (light_colour * max(dot(n, light), 0.) * lit + mix(ambient_down, ambient_up, .5 + .5 * n.z))
         + light_colour * gloss * lit * pow(max(dot(n, halfway), 0.), 24.);
  colour = vec4(pow(clamp(c, 0., 1.), vec3(1. / 2.2)), 1);
}
