#version 330
uniform mat4 clip_from_world, light_clip_from_world, sky_clip_from_world;
in vec3 position, normal, colour;
in vec2 surface; // pattern, gloss
out vec3 N, P, C;
out vec4 light_position;
out vec3 sky_position;
flat out vec2 S;
void main() {
  gl_Position = PROJECTION * vec4(position, 1);
  light_position = light_clip_from_world * vec4(position, 1);
  sky_position = (sky_clip_from_world * vec4(position, 1)).xyz * .5 + .5;
  N = normal; P = position; C = colour; S = surface;
}
