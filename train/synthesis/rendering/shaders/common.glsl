#version 330
// Coordinates `q` are those of the body at rest (A-pose, hips near the origin, metres), so that garments sit in
// the same place on every shape and pose.
uniform float sleeve, hem, neckline, v_neck, waist, cuff, skirt_top, skirt_length, hair_length, hair_line, hair_low;
uniform float bald, shoe_top, sock_top, glove, hat_line, hat_slope, tank;
uniform int has_shirt, has_trousers, has_skirt, has_hat, ears_out, hooded;
const int part = PART_NUMBER;
const int BODY = 0, TROUSERS = 1, SHIRT = 2, SHOES = 3, SKIRT = 4, LONG_HAIR = 5, HAIR = 6, HAT = 7, ACCESSORY = 8;
const vec3 SHOULDER = vec3(.167, -.015, .525), ELBOW = vec3(.313, -.013, .350);
const vec3 UPPER = vec3(.6407, .0088, -.7678), FORE = vec3(.5182, -.7170, -.4663);
const float UPPER_LENGTH = .2279;

// Metres along the arm from the shoulder; the wrist is at .45.
float arm_along(vec3 q) {
  vec3 p = vec3(abs(q.x), q.yz);
  float fore = dot(p - ELBOW, FORE);
  return fore > 0. ? UPPER_LENGTH + fore : min(dot(p - SHOULDER, UPPER), UPPER_LENGTH);
}

// Metres that `q` lies inside of a garment's edge; negative outside.
float in_shirt(vec3 q, float arm) {
  if (has_shirt == 0) return -1.;
  if (arm > .5) return tank > 0. ? -1. : sleeve - arm_along(q);
  float ax = abs(q.x), front = max(0., -q.y - .02);
  float neck = neckline - .3 * front - q.z - (q.y < 0. ? v_neck * max(0., 1. - ax / (.035 + .3 * v_neck)) : 0.);
  if (tank > 0.) neck = min(max(neck, min(ax - .6 * tank, tank - ax)), max(.41 - q.z, tank - ax)); // straps
  else neck += .6 * max(0., ax - .05);
  return min(neck, q.z - hem);
}
float in_trousers(vec3 q, float arm) {
  if (has_trousers == 0 || arm > .5) return -1.;
  return min(min(waist - q.z, q.z - cuff), q.z < -.72 ? q.y + .075 : 9.); // the foot is out of them
}
float in_skirt(vec3 q) { return has_skirt == 0 ? -1. : min(skirt_top - q.z, q.z - skirt_length); }
float in_shoe(vec3 q) { return abs(q.x) < .34 ? shoe_top - q.z - .12 * max(0., -q.y - .03) : -1.; }
float in_hat(vec3 q) {
  if (has_hat == 0) return -1.;
  if (hooded == 1) {
    vec2 face = vec2(q.x / .075, (q.z - .70) / .105);
    return q.y < -.04 ? (length(face) - 1.) * .08 : .1;
  }
  return q.z + hat_slope * (q.y + .02) - hat_line;
}
float in_hair(vec3 q) {
  float front = q.z + 1.2 * (q.y + .02) - hair_line, ax = abs(q.x);
  float inside = min(front, q.z - hair_low - .5 * max(0., -q.y));
  if (ears_out == 1) inside = min(inside, max(max(.062 - ax, q.z - .742), q.y - .022));
  if (bald > 0.) inside = min(inside, max(.775 - q.z, length(q.xy - vec2(0, -.03)) - bald));
  return inside;
}

// Whether a fragment of a shell is not there: the body is dropped under cloth so that no skin pokes through.
bool absent(vec3 q, float arm, float head) {
  if (part == BODY) {
    if (in_shoe(q) > .012 || in_shirt(q, arm) > .012) return true;
    if (arm < .5 && head < .5 && (in_trousers(q, arm) > .012 || in_skirt(q) > .05)) return true;
    return head > .5 && in_hat(q) > .012;
  }
  if (part == TROUSERS) {
    if (hem < waist - .06 && in_shirt(q, arm) > .015) return true; // the shirt hangs over them
    return in_trousers(q, arm) < 0. || in_shoe(q) > .05 || in_skirt(q) > .05;
  }
  if (part == SHIRT) return in_shirt(q, arm) < 0. || (hem > skirt_top - .06 && has_skirt == 1 && in_skirt(q) > .03);
  if (part == SHOES) return in_shoe(q) < 0.;
  if (part == SKIRT) return in_skirt(q) < 0. || (hem < skirt_top - .06 && in_shirt(q, arm) > .03);
  if (part == LONG_HAIR)
    return q.z < hair_length || (q.y < -.055 && q.z < .765) || (q.y < -.03 && q.z < .70) || in_hat(q) > -.005;
  if (part == HAIR) return in_hair(q) < 0. || in_hat(q) > .012;
  if (part == HAT) return in_hat(q) < 0.;
  return false;
}
