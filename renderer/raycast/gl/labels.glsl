// Labels (classify/labels.h): the interpolated entries of the eight voxels around a point.
layout(binding = 3) uniform LABELS labels; // usampler2DArray or isampler2DArray
layout(binding = 4) uniform samplerBuffer label_entries; // two texels per voxel value: tint and its opacity; visibility

struct Label { vec4 tint; float visible; };

Label find_label(int voxel) {
  int at = 2 * (voxel - job.label_numbers.x);
  return Label(texelFetch(label_entries, at), texelFetch(label_entries, at + 1).r);
}

Label mix_labels(Label a, Label b, float f) {
  return Label(a.tint + (b.tint - a.tint) * f, a.visible + (b.visible - a.visible) * f);
}

ivec4 label_corners(ivec2 cell, int z) {
  int layer = z / job.label_dims.w;
  cell.y += (z - layer * job.label_dims.w) * job.label_dims.y;
  return ivec4(textureGather(labels, vec3(vec2(cell + 1) * job.label_texel.xy, float(layer))));
}

// The labels at an index position of the main volume.
Label label_at(vec3 p) {
  float inside = 1.0;
  vec3 near;
  ivec3 flat_axis;
  for (int k = 0; k < 3; k++) {
    float at = dot(job.label_matrix[k].xyz, p) + job.label_matrix[k].w;
#if NEAREST
    at += 0.001; // NEAREST_UP of cpu/filter_tmpl.h
#endif
    flat_axis[k] = int(job.label_dims[k] == 1);
    near[k] = clamp(at, 0.0, float(job.label_dims[k] - 1));
    float beyond = abs(at - near[k]);
#if NEAREST
    near[k] = floor(near[k] + 0.5);
    inside *= beyond <= 0.5 ? 1.0 : 0.0;
#else
    inside *= flat_axis[k] == 0 ? max(1.0 - beyond, 0.0) : beyond <= 0.5 ? 1.0 : 0.0;
#endif
  }
  ivec3 cell = min(ivec3(near), max(job.label_dims.xyz - 2, 0));
  vec3 f = near - vec3(cell);
  ivec4 a = label_corners(cell.xy, cell.z); // textureGather's order in (x, y): (0,1) (1,1) (1,0) (0,0)
  ivec4 b = flat_axis.z != 0 ? a : label_corners(cell.xy, cell.z + 1);
  if (flat_axis.x != 0) a.yz = a.xw, b.yz = b.xw; // texels beyond a flat axis are ignored
  if (flat_axis.y != 0) a.xy = a.wz, b.xy = b.wz;
  Label m = find_label(a.w);
  if (any(notEqual(a, ivec4(a.w))) || any(notEqual(b, ivec4(a.w)))) {
    Label low = mix_labels(mix_labels(m, find_label(a.z), f.x), mix_labels(find_label(a.x), find_label(a.y), f.x), f.y);
    Label high = mix_labels(mix_labels(find_label(b.w), find_label(b.z), f.x),
                            mix_labels(find_label(b.x), find_label(b.y), f.x), f.y);
    m = mix_labels(low, high, f.z);
  }
  if (inside < 1.0) m = mix_labels(find_label(job.label_numbers.y), m, inside);
  return m;
}

// True if the position has a value, outside the volume's gaps.
bool has_value(vec3 p) {
  return label_at(p).visible >= 0.5;
}

// Tints the segment around index position p, and scales its extinction by the visibility there.
vec4 label_segment(vec4 segment, vec3 p) {
  Label m = label_at(p);
  float seen = max(m.visible, 1e-6);
  segment.rgb = min(segment.rgb * max(1.0 - m.tint.a / seen, 0.0) + segment.a / seen * m.tint.rgb, vec3(segment.a));
  return m.visible < 1.0 ? shorten(segment, m.visible) : segment;
}

// The labels' tint over a slice's grey.
vec3 label_slice(float grey, vec3 p) {
  Label m = label_at(p);
  return min(grey * (1.0 - m.tint.a) + m.tint.rgb, vec3(1.0));
}
