in vec3 Q;
in float arm, head;
void main() { if (absent(Q, arm, head)) discard; }
