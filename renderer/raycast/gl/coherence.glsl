// What a pixel's middle knows of empty space serves all of its rays: as far as everything within the footprint (rays.h) of the
// middle's ray is known to be empty, none of them sees anything.
vec2 way;   // mm from the anchor: where the middle's ray enters, and how far its way is clear; y < x where nothing is known
float room; // voxels by which the empty cube around the entry exceeds the footprint on all sides
float head; // mm that the ray that is marched may begin after its entry

// Walks through the cubes that the distance map knows to be empty, each less the footprint. A step that gains less than
// a segment is the last. The margin of a hundredth of a voxel is far above the rounding of positions.
void look_ahead(vec3 anchor, vec3 direction, vec2 span) {
  vec3 entry = fma(vec3(span.x), direction, anchor);
  float size = float(job.blocks.x), margin = job.rays.footprint + 0.01, t = 0.0, gain = 1e9;
  way = vec2(span.x, span.x - 1.0);
  room = -1.0;
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
      room = around;
    gain = 1e9;
    for (int k = 0; k < 3; k++) {
      float wall = direction[k] > 0.0 ? high[k] - margin : low[k] + margin;
      if (abs(direction[k]) >= 1e-12)
        gain = min(gain, (wall - p[k]) / direction[k]);
    }
    t += gain;
    way.y = span.x + t;
  }
}

// Where a ray of the pixel may begin. One that enters before the middle's needs the cube around that place to hold
// this stretch as well.
float head_of(vec3 direction, vec2 span) {
  vec3 speed = abs(direction);
  bool known = way.x <= way.y && (way.x - span.x) * max(speed.x, max(speed.y, speed.z)) <= room;
  return known ? way.y - span.x : 0.0;
}
