// Mean of the splats at a pixel, shaded.
#if DEPTH
layout(std430, binding = 3) writeonly buffer Depth { float depths[]; }; // [h][w] mm from the eye
#endif

void main() {
  ivec2 place = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(place, tile.zw)))
    return;
  uint at = uint(place.y * tile.z + place.x);
  if (splat.opaque == 0) {
    uint of = at * uint(splat.stride) + 4u;
    float opacity = intBitsToFloat(sums[of + 3u]);
    vec3 light = intBitsToFloat(ivec3(sums[of], sums[of + 1u], sums[of + 2u]));
    write_result(at, vec4(min(light, vec3(opacity)), opacity));
#if DEPTH
    depths[at] = depth_of(FAR);
#endif
    return;
  }
  uint sum = at * uint(splat.stride);
  float weight = float(sums[sum]), alpha = nearest[at] == FAR ? min(weight * (1.0 / splat.full_weight), 1.0) : 1.0;
  vec2 p = vec2(tile.xy + place) + 0.5;
  vec4 color = vec4(splat.color.rgb, 1.0);
  if (splat.stride > 4)
    color.rgb = vec3(sums[sum + 4u], sums[sum + 5u], sums[sum + 6u]) * (1.0 / max(weight, 1.0)) * (1.0 / 255.0);
#if SHADED
  if (weight > 0.0) {
    vec3 n = vec3(sums[sum + 1u], sums[sum + 2u], sums[sum + 3u]) / max(weight, 1.0);
    vec3 eye = -normalize(splat.direction0.xyz + p.x * splat.direction_du.xyz + p.y * splat.direction_dv.xyz);
    n -= min(dot(n, eye), 0.0) * eye; // normals that face away become perpendicular to the view
    color = shade(color, n, n, eye);
  }
#endif
  write_result(at, vec4(color.rgb * alpha, alpha));
#if DEPTH
  vec2 across = (p - 0.5 * splat.size) / splat.scale;
  depths[at] = depth_of(nearest[at]) * (splat.perspective != 0 ? sqrt(1.0 + dot(across, across)) : 1.0);
#endif
}
