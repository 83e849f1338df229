#version 330
uniform mat4 clip_from_world;
in vec3 position, normal, colour;
in float pattern;
out vec3 P, N, C;
flat out float K;
void main() { gl_Position = clip_from_world * vec4(position, 1); P = position; N = normal; C = colour; K = pattern; }
