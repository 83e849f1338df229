in vec3 Q;
in float arm, head;
out vec4 colour;
void main() { if (absent(Q, arm, head)) discard; colour = vec4(1); }
