in vec3 N, P, Q;
in float arm, eye, head;
in vec4 light_position;
in vec3 sky_position;
uniform vec3 eye_world, light, light_colour, fill, fill_colour, ambient_up, ambient_down;
uniform vec3 skin, hair_colour, shoe_colour, sole_colour, sock_colour, hat_a, hat_b, cover_colour, glove_colour;
uniform vec3 shirt_a, shirt_b, shirt_c, trousers_a, trousers_b, trousers_c, skirt_a, skirt_b, item_colour;
uniform ivec3 pattern, fold_kind; // shirt, trousers, skirt; trunk, arms, legs
uniform vec3 pattern_size; // metres
uniform vec4 print_box; // centre x, z and half sizes on the chest
uniform int print_layer, print_back, shirt_style, trousers_style, straps, item_hair, covered, beard, sheen;
uniform vec4 bands; // sides of a watch and of a knee brace, 0 for none; the brace's lower and upper end
uniform float seed, fold_depth, bodily, gloss_cloth, hair_paint;
uniform sampler2D shadow_map, sky_map;
uniform sampler3D white3, fractal3;
uniform sampler2DArray patterns, prints, folds;
out vec4 colour;

float white(vec3 p) { return texture(white3, (p + .5) / 32.).r; }
float fractal(vec3 p) { return texture(fractal3, (p + .5) / 16.).r; }
float line(float d, float width) { return smoothstep(width, width * .4, abs(d)); }

// Where a fragment lies on its tube of cloth: turns round it, metres along it; and the tube's girth.
vec2 on_cloth(out float girth) {
  float side = Q.x < 0. ? -1. : 1.;
  if (part == SKIRT) { girth = 1.2; return vec2(atan(Q.x, -Q.y) / 6.2832, Q.z); }
  if (part == HAT || part == HAIR) { girth = .6; return vec2(atan(Q.x, -Q.y - .03) / 6.2832, Q.z); }
  if (arm > .5) {
    vec3 p = vec3(abs(Q.x), Q.yz);
    float a = arm_along(Q);
    vec3 along = a < UPPER_LENGTH ? UPPER : FORE, start = a < UPPER_LENGTH ? SHOULDER : ELBOW;
    vec3 e = normalize(cross(along, vec3(0, 1, 0))), d = p - start;
    girth = .32;
    return vec2(atan(dot(d, e), dot(d, cross(along, e))) / 6.2832, -a * side);
  }
  if (Q.z < -.03) {
    vec2 axis = mix(mix(vec2(.158, -.032), vec2(.11, -.013), (Q.z + .37) / .42), vec2(.22, 0.),
                    clamp(-(Q.z + .37) / .375, 0., 1.));
    girth = .52;
    return vec2(atan(abs(Q.x) - axis.x, -Q.y + axis.y) * side / 6.2832, Q.z);
  }
  girth = 1.;
  return vec2(atan(Q.x / 1.35, -Q.y - .02) / 6.2832, Q.z);
}

vec4 woven(sampler2DArray weave, int layer, vec2 at, float girth, float size, vec2 dx, vec2 dy) {
  float n = max(1., floor(girth / size + .5));
  vec2 k = vec2(n, n / girth);
  return textureGrad(weave, vec3(at * k + seed, layer), dx * k, dy * k);
}

vec3 dyed(vec4 t, vec3 a, vec3 b, vec3 c) { return mix(mix(a, b, t.r), c, t.b) * t.g * 2.; }

vec3 shirt(vec4 t) {
  vec3 a = dyed(t, shirt_a, shirt_b, shirt_c);
  float edge = in_shirt(Q, arm), ax = abs(Q.x);
  bool front = Q.y < -.02 && arm < .5;
  if ((shirt_style & 4) != 0 && arm > .5) a = shirt_b * (.9 + .2 * fractal(Q * 9.));
  if ((shirt_style & 32) != 0 && Q.z > .2 + .15 * sin(seed) && arm < .5) a = shirt_c;
  bool faces = print_back == 1 ? Q.y > .0 : front;
  vec2 at = (vec2(print_back == 1 ? -Q.x : Q.x, Q.z) - print_box.xy) / (2. * print_box.zw);
  if (print_layer >= 0 && faces && arm < .5 && max(abs(at.x), abs(at.y)) < .5) {
    vec4 ink = textureLod(prints, vec3(at + .5, print_layer), 1.);
    a = mix(a, mix(shirt_b, shirt_c, clamp(ink.g * 2., 0., 1.)), ink.r);
  }
  if (front) {
    if ((shirt_style & 1) != 0) a *= 1. - .25 * line(ax - .014, .003) - .5 * step(length(vec2(Q.x, fract(Q.z * 11.) / 11. - .045)), .006);
    if ((shirt_style & 2) != 0) a = mix(a, vec3(.12), .7 * line(ax, .006));
    if ((shirt_style & 8) != 0) { // an open jacket over something else
      float opening = .03 + .16 * (neckline - Q.z) * (.5 + .3 * sin(seed * 3.));
      if (ax < opening) a = shirt_c * (.75 + .25 * smoothstep(0., .04, opening - ax));
      a *= 1. - .5 * line(ax - opening, .008);
    }
  }
  if ((shirt_style & 16) != 0 && edge < .022 && Q.z > .4 && arm < .5) a = shirt_b;
  if ((shirt_style & 64) != 0 && edge < .05 && (arm > .5 || Q.z < .3)) a *= .82;
  a *= 1. - .3 * line(edge - .018, .004); // the hem's seam
  if (arm < .5 && (straps & 1) != 0) { // of a backpack
    float band = abs(ax - .095 - .1 * max(0., .45 - Q.z) * (Q.y < 0. ? 1. : 0.));
    if (band < .024 && Q.z > .22) a = item_colour * (.8 + .2 * line(band, .02));
  }
  if (arm < .5 && (straps & 2) != 0) { // across the body
    float band = abs(dot(Q, normalize(vec3(seed > 25. ? .62 : -.62, 0., .78))) - .27);
    if (band < .018) a = item_colour;
  }
  return a;
}

vec3 trousers(vec4 t) {
  vec3 a = dyed(t, trousers_a, trousers_b, trousers_c);
  float ax = abs(Q.x), edge = min(waist - Q.z, Q.z - cuff);
  float outer = ax - mix(.125, .19, clamp((.05 - Q.z) / .45, 0., 1.));
  if ((trousers_style & 1) != 0 && outer > .035 && abs(Q.y + .005) < .022) a = trousers_b; // side stripe
  if ((trousers_style & 2) != 0 && Q.z > -.08 && Q.y < -.03) {
    a *= 1. - .35 * line(ax - .06 - .6 * (Q.z - .02), .005) * step(.05, ax) - .3 * line(ax, .004);
  }
  if ((trousers_style & 4) != 0 && waist - Q.z < .03) a = trousers_c * .4; // belt
  if ((trousers_style & 8) != 0) { // worn thighs and knees
    float worn = smoothstep(.07, .01, abs(ax - .15)) * step(Q.y, -.02) * smoothstep(.05, -.1, Q.z);
    a = mix(a, a * 1.6 + .03, .5 * worn * fractal(Q * 6. + seed));
  }
  if ((trousers_style & 16) != 0) a *= 1. - .25 * line(outer - .04, .003); // seam
  return a * (1. - .3 * line(edge - .02, .004));
}

vec3 face(vec3 a) {
  float ax = abs(Q.x);
  vec2 brow = vec2(ax - .032, Q.z - .748 - .05 * (ax - .03));
  if (abs(brow.y) < .006 && abs(brow.x) < .021) a = mix(a, hair_colour, .75);
  vec2 socket = vec2((ax - .031) / .026, (Q.z - .733) / .018);
  a *= 1. - .25 * smoothstep(1., .3, length(socket));
  vec2 lips = vec2(Q.x / .026, (Q.z - .647) / .011);
  if (dot(lips, lips) < 1. && Q.y < -.12) a = mix(a, vec3(.62, .28, .27) * (.4 + skin), .6);
  return a;
}

vec3 body(out float gloss) {
  vec3 a = skin * (.85 + .3 * fractal(Q * 14. + seed)) * (.93 + .14 * fractal(Q * 60. + seed));
  gloss = .2;
  float ax = abs(Q.x);
  if (head > .5 && eye < .5) {
    a = mix(a, a * vec3(1.06, .84, .8), smoothstep(.05, .0, abs(Q.z - .69)) * step(Q.y, -.06) * .7);
    if (Q.y < -.08) a = face(a);
    bool jaw = Q.y < -.05 && Q.z < .652 + .3 * max(0., ax - .035) + .012 * fractal(Q * 90.) && length(vec2(Q.x / .024, (Q.z - .647) / .01)) > 1.;
    if (beard > 0 && jaw) a = mix(a, hair_colour * (.6 + .6 * white(Q * 200.)), beard == 1 ? .35 : .85);
    float bare = in_hair(Q);
    if (bare > .012 * (fractal(Q * 60.) - .5)) {
      a = mix(a, hair_colour * (.7 + .6 * white(vec3(Q.x * 160., Q.y * 40., Q.z * 40.))), hair_paint);
      gloss = .3;
    }
    if (covered == 1 && Q.z < .70 && Q.y < -.085) { a = cover_colour * (.9 + .15 * sin(Q.z * 260.)); gloss = .03; }
  } else if (eye > .5) {
    float r = length(vec2(ax - .0315, Q.z - .7225));
    a = r < .0055 ? vec3(.02) : (r < .0115 ? vec3(.25, .16, .09) : vec3(.8));
    gloss = .6;
  } else if (arm > .5) {
    float along = arm_along(Q);
    if (bands.x * Q.x > 0. && abs(along - .425) < .013) { a = hat_b * .6; gloss = .3; }
    if (along > glove) { a = glove_colour; gloss = .05; }
  } else if (bodily > .5 && Q.y < -.06) {
    a = mix(a, a * vec3(.55, .4, .38), step(length(vec2(ax - .082, Q.z - .395)), .013));
    a *= 1. - .6 * smoothstep(.012, .004, length(vec2(Q.x, Q.z - .155)));
  }
  if (head < .5 && arm < .5) {
    if (in_shoe(Q) < .02 && Q.z < sock_top && ax < .34) {
      a = sock_colour * (Q.z > sock_top - .03 ? .8 : .9 + .1 * sin(Q.z * 900.)); gloss = .03;
    }
    if (bands.y * Q.x > 0. && Q.z > bands.z && Q.z < bands.w) { a = hat_b * (.8 + .2 * fractal(Q * 50.)); gloss = .03; }
    a *= 1. - .3 * smoothstep(.05, .0, abs(Q.z - .575)) * step(Q.y, -.02); // under the chin
  }
  return a;
}

vec3 shoe(out float gloss) {
  gloss = .15;
  if (Q.z < -.798) return sole_colour * (.75 + .3 * fractal(Q * 40.));
  vec3 a = shoe_colour * (.8 + .4 * fractal(Q * 24. + seed));
  float x = abs(Q.x) - .22 + .12 * (Q.y + .1);
  if (Q.y < -.04 && Q.y > -.13 && abs(x) < .022) a = mix(a, sole_colour, .7 * step(.5, fract(Q.y * 55.)));
  if (seed > 30. && abs(Q.y + .06) < .02 && abs(x) > .028) a = sole_colour;
  return a * (1. - .35 * line(Q.z + .796, .004));
}

vec3 strands(vec3 q, float coarse) {
  float grain = white(vec3(q.x * 170., q.y * 170., q.z * 25.)), locks = fractal(q * vec3(40., 40., 9.) + seed);
  return hair_colour * (.5 + .5 * grain + .4 * locks * coarse);
}

void main() {
  float girth;
  vec2 at = on_cloth(girth);
  vec2 dx = dFdx(at), dy = dFdy(at);
  vec3 px = dFdx(P), py = dFdy(P);
  dx.x -= round(dx.x); dy.x -= round(dy.x);
  if (absent(Q, arm, head)) discard;
  vec3 n = normalize(N), a;
  float gloss = gloss_cloth, shade = 1., power = 24.;
  bool cloth = part == TROUSERS || part == SHIRT || part == SKIRT || (part == HAT && hooded == 1);
  if (part == BODY) a = body(gloss);
  else if (part == SHOES) a = shoe(gloss);
  else if (part == TROUSERS) a = trousers(woven(patterns, pattern.y, at, girth, pattern_size.y, dx, dy));
  else if (part == SHIRT) a = shirt(woven(patterns, pattern.x, at, girth, pattern_size.x, dx, dy));
  else if (part == SKIRT) a = dyed(woven(patterns, pattern.z, at, girth, pattern_size.z, dx, dy), skirt_a, skirt_b, trousers_c);
  else if (part == HAT) {
    a = hooded == 1 ? hat_a : (abs(fract(at.x * 6.) - .5) < .49 ? hat_a : hat_a * .7);
    float edge = in_hat(Q);
    if (edge < .03 && sin(seed * 7.) > .3 && hooded == 0) a = hat_b;
    if (hooded == 0 && Q.y < -.08 && length(vec2(Q.x, edge - .05)) < .025 && sin(seed * 5.) > 0.) a = hat_b;
    a *= .9 + .2 * fractal(Q * 40.);
    gloss = sheen == 1 ? .5 : .05;
  } else if (part == ACCESSORY) {
    a = item_colour; gloss = .12;
    if (item_hair == 1) { a = strands(P, 1.); gloss = .3; }
  } else {
    a = strands(Q, 1.);
    vec3 q = Q * vec3(60., 60., 14.) + seed;
    n = normalize(n + 1.3 * (vec3(fractal(q), fractal(q + 3.), fractal(q + 7.)) - .45));
    gloss = .14; power = 12.;
  }
  if (cloth) {
    int kind = arm > .5 ? fold_kind.y : (part == SKIRT ? 3 : (Q.z < -.03 ? fold_kind.z : fold_kind.x));
    vec4 t = woven(folds, kind, at, girth, .34, dx, dy);
    float a_along = arm_along(Q);
    float joint = arm > .5 ? smoothstep(.13, .0, abs(a_along - .22)) + smoothstep(.1, -.05, a_along)
                           : smoothstep(.12, 0., abs(Q.z + .39)) + smoothstep(.12, 0., abs(Q.z - .02))
                             + smoothstep(.14, 0., abs(Q.z + .74)) + smoothstep(.1, .0, abs(Q.z - hem)) * .5;
    float depth = fold_depth * (.45 + .75 * joint);
    vec2 slope = (t.rg - .5) * 2. * depth;
    vec3 r1 = cross(py, n), r2 = cross(n, px);
    vec3 tangent = r1 * dx.x * girth + r2 * dy.x * girth, other = r1 * dx.y + r2 * dy.y;
    float size = inversesqrt(max(max(dot(tangent, tangent), dot(other, other)), 1e-20));
    n = normalize(n - (slope.y * tangent + slope.x * other) * size);
    shade *= mix(1., .45 + 1.1 * t.a, clamp(depth * .6, 0., .8));
    if (part == TROUSERS && has_shirt == 1) shade *= 1. - .45 * smoothstep(.05, 0., abs(Q.z - hem + .02));
  }
  if (!gl_FrontFacing && part != ACCESSORY) { n = -n; shade *= .45; }
  if (part == ACCESSORY && dot(n, eye_world - P) < 0.) n = -n;
  vec3 view = normalize(eye_world - P), halfway = normalize(light + view);
  vec3 lp = light_position.xyz / light_position.w * .5 + .5;
  float lit = 0., open = 0.;
  for (int i = -1; i < 2; i++) for (int j = -1; j < 2; j++) {
    lit += texture(shadow_map, lp.xy + vec2(i, j) / 400.).r < lp.z - .008 ? 0. : 1.;
    open += clamp(1. - (sky_position.z - .012 - texture(sky_map, sky_position.xy + vec2(i, j) / 60.).r) * 9., 0., 1.);
  }
  lit /= 9.;
  open = mix(.42, 1., open / 9.); // how much of the sky is seen
  float key = max((dot(n, light) + .12) / 1.12, 0.) * lit;
  vec3 c = a * shade * (light_colour * key + fill_colour * max(dot(n, fill), 0.) + mix(ambient_down * (.5 + .5 * open), ambient_up * open, .5 + .5 * n.z))
         + light_colour * gloss * (lit + .15) * (pow(max(dot(n, halfway), 0.), power) + .25 * pow(1. - max(dot(n, view), 0.), 4.));
  c = mix(c, 1. - exp(-c * 1.15), smoothstep(.45, 1.1, max(c.r, max(c.g, c.b)))); // a film's shoulder
  colour = vec4(pow(clamp(c, 0., 1.), vec3(1. / 2.2)), 1);
}
