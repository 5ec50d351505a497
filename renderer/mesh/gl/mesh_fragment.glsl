// The visibility buffer: the triangle that is nearest.
flat in uint number;
#if CLIP
in vec3 at;
#endif
layout(location = 0) out uint triangle;
#if PEEL
layout(binding = 1) uniform sampler2DArray opaque; // depths of a layer for each sample
layout(binding = 2) uniform sampler2DArray before;
layout(binding = 3) uniform usampler2DArray number_before;
layout(location = 1) uniform ivec2 peel; // sample; whether there is a layer before
#endif

#if LABELS
layout(depth_less) out float gl_FragDepth;

// set_back() of raster_tmpl.h, of a back face.
float depth_of() {
  float near = fma(gl_FragCoord.z, mesh.behind.y, mesh.behind.x), more = mesh.behind.w * (near + 1.0);
  float back = ((near - (mesh.behind.z + more)) / (1.0 + more) - mesh.behind.x) / mesh.behind.y;
  return gl_FrontFacing ? gl_FragCoord.z : min(back, gl_FragCoord.z);
}
#else
float depth_of() { return gl_FragCoord.z; }
#endif

void main() {
  float depth = depth_of();
#if CLIP
  for (int i = 0; i < mesh.n_planes; i++)
    if (dot(mesh.planes[i], vec4(at, 1.0)) < 0.0)
      discard;
#endif
#if PEEL
  ivec3 at_sample = ivec3(gl_FragCoord.xy, peel.x);
  if (depth <= texelFetch(opaque, at_sample, 0).r)
    discard;
  if (peel.y != 0) { // of equal depths the lowest number comes first
    float near = texelFetch(before, at_sample, 0).r;
    if (depth > near || (depth == near && number <= texelFetch(number_before, at_sample, 0).r))
      discard;
  }
#endif
#if LABELS
  gl_FragDepth = depth;
#endif
  triangle = number;
}
