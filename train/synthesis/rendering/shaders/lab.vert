#version 330
uniform mat4 clip_from_world;
in vec3 position, normal, colour;
in vec2 uv;
in float pattern;
out vec3 P, N, C;
out vec2 T;
flat out float K;
void main() {
  gl_Position = clip_from_world * vec4(position, 1);
  P = position; N = normal; C = colour; T = uv; K = pattern;
}
