uniform mat4 clip_from_world, light_clip_from_world;
uniform float puff_shirt, puff_trousers;
in vec3 position, normal, rest;
in vec3 traits; // head, eye, arm
out float arm, eye, head;
out vec3 N, P, Q;
out vec4 light_position;
void main() {
  int z = zone(rest, traits.z);
  float offset = 0.;
  if (part == 1) offset = z == SHIRT ? puff_shirt : puff_trousers;
  if (part == 2) offset = puff_trousers;
  if (part == 0 && z == SHOE && rest.z < shoe_top - .01) offset = .008;
  vec3 w = position + normal * offset;
  gl_Position = PROJECTION * vec4(w, 1);
  light_position = light_clip_from_world * vec4(w, 1);
  N = normal; P = w; Q = rest; head = traits.x; eye = traits.y; arm = traits.z;
}
