// The visibility buffer: the triangle that is nearest.
flat in uint number;
#if CLIP
in vec3 at;
#endif
layout(location = 0) out uint triangle;
#if PEEL
layout(binding = 1) uniform sampler2DArray opaque; // depths of a layer for each sample
layout(binding = 2) uniform sampler2DArray before;
layout(location = 1) uniform ivec2 peel; // sample; whether there is a layer before
#endif

void main() {
#if CLIP
  for (int i = 0; i < mesh.n_planes; i++)
    if (dot(mesh.planes[i], vec4(at, 1.0)) < 0.0)
      discard;
#endif
#if PEEL
  ivec3 at_sample = ivec3(gl_FragCoord.xy, peel.x);
  if (gl_FragCoord.z <= texelFetch(opaque, at_sample, 0).r || (peel.y != 0 && gl_FragCoord.z >= texelFetch(before, at_sample, 0).r))
    discard;
#endif
  triangle = number;
}
