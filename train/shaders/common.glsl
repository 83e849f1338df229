#version 330
// Coordinates `Q` are those of the body at rest (A-pose, hips near the origin, metres), so that garments sit in
// the same place on every shape and pose.
uniform float sleeve, hem, neckline, cuff, skirt_length, hair_length, shoe_top;
uniform int part, has_shirt, has_trousers, has_skirt;
const int SKIN = 0, SHIRT = 1, TROUSERS = 2, SHOE = 3;

int zone(vec3 q, float arm) {
  float ax = abs(q.x);
  if (ax < .24 && q.z < shoe_top) return SHOE;
  if (arm > .5) return (has_shirt == 1 && ax < sleeve) ? SHIRT : SKIN;
  if (q.z > neckline - .25 * max(0., -q.y)) return SKIN;
  if (q.z > hem) return has_shirt == 1 ? SHIRT : SKIN;
  return (has_trousers == 1 && q.z > cuff) ? TROUSERS : SKIN;
}

// Whether a fragment of the shell `part` (0 body, 1 tights, 2 skirt, 3 hair) is not there: the body is dropped
// under cloth so that no skin pokes through.
bool absent(vec3 q, float arm) {
  int z = zone(q, arm);
  if (part == 0) return z == SHIRT || (z == TROUSERS && has_skirt == 0);
  if (part == 1) return z == SKIN || z == SHOE || (z == TROUSERS && has_skirt == 1);
  if (part == 2) return has_skirt == 0 || q.z < skirt_length || q.z > hem + .03;
  return q.z < hair_length || (q.y < -.055 && q.z < .765) || (q.y < -.03 && q.z < .70);
}
