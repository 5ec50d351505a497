// The visibility buffer: the triangle that is nearest.
flat in uint number;
#if CLIP
in vec3 at;
#endif
layout(location = 0) out uint triangle;

void main() {
#if CLIP
  for (int i = 0; i < mesh.n_planes; i++)
    if (dot(mesh.planes[i], vec4(at, 1.0)) < 0.0)
      discard;
#endif
  triangle = number;
}
