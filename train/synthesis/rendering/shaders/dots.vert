#version 330
uniform mat4 clip_from_world;
uniform float reach_px; // diameter times focal length
in vec3 position;
void main() {
  gl_Position = clip_from_world * vec4(position, 1);
  gl_PointSize = clamp(reach_px / gl_Position.w, 1., 40.);
}
