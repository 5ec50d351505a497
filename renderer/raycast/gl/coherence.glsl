// Several rays per pixel share empty-space skipping. The pixel's centre ray finds the stretch in which everything
// within the footprint (rays.h) around it is empty; all rays of the pixel skip that stretch.
vec2 clear_span;   // mm from the anchor: entry of the centre ray, and end of its empty stretch; y < x if there is none
float clear_margin; // voxels by which the empty cube around the entry exceeds the footprint on all sides
float skip_mm;     // mm that the current ray may skip after its entry

// Traverses the empty cubes of the distance map, each shrunk by the footprint, until a leap gains less than a segment.
// The margin of a hundredth of a voxel is far above the rounding of positions.
void find_clear_span(vec3 anchor, vec3 direction, vec2 span) {
  vec3 entry = fma(vec3(span.x), direction, anchor);
  float size = float(job.blocks.x), margin = job.rays.footprint + 0.01, t = 0.0, gain = 1e9;
  clear_span = vec2(span.x, span.x - 1.0);
  clear_margin = -1.0;
  while (gain > job.rays.step_mm && t < span.y - span.x) {
    vec3 p = clamp(fma(vec3(t), direction, entry), vec3(0.0), vec3(job.dims.xyz - 1));
    ivec3 block = ivec3((floor(min(p, max(vec3(job.dims.xyz - 2), 0.0))) + 0.5) / size);
    float distance = float(texelFetch(distances, block.x + block.y * job.blocks.y + block.z * job.blocks.z).r);
    float reach = (distance - 1.0) * size;
    vec3 low = vec3(block) * size - reach, high = vec3(block) * size + (reach + size);
    vec3 free = min(p - low, high - p) - margin;
    float around = min(free.x, min(free.y, free.z));
    if (reach < 0.0 || around < 0.0)
      break;
    if (t == 0.0)
      clear_margin = around;
    gain = 1e9;
    for (int k = 0; k < 3; k++) {
      float wall = direction[k] > 0.0 ? high[k] - margin : low[k] + margin;
      if (abs(direction[k]) >= 1e-12)
        gain = min(gain, (wall - p[k]) / direction[k]);
    }
    t += gain;
    clear_span.y = span.x + t;
  }
}

// Distance that a ray of the pixel may skip after its entry. If it enters before the centre ray, the cube around the
// centre ray's entry must contain that difference too.
float skip_of(vec3 direction, vec2 span) {
  vec3 speed = abs(direction);
  bool known = clear_span.x <= clear_span.y && (clear_span.x - span.x) * max(speed.x, max(speed.y, speed.z)) <= clear_margin;
  return known ? clear_span.y - span.x : 0.0;
}
