in vec3 Q;
in float arm;
void main() { if (absent(Q, arm)) discard; }
