in vec3 Q;
in float arm;
out vec4 colour;
void main() { if (absent(Q, arm)) discard; colour = vec4(1); }
