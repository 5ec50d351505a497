layout(location = 0) in vec3 position;
layout(location = 0) uniform vec4 place; // xz: scale, yw: offset, from mm at a distance of 1 mm to -1..1 over the tile
flat out uint number; // the triangle's, of its last vertex
#if CLIP
out vec3 at;
#endif

void main() {
  vec4 p = vec4(position, 1.0);
  float along = mesh.perspective != 0 ? dot(mesh.depth, p) + mesh.reference : 1.0;
  vec2 across = vec2(place.x * dot(mesh.right, p) + place.y * along, place.z * dot(mesh.down, p) + place.w * along);
  // Rounded to a 256th of a pixel as the cpu's, and as the driver does for coverage: a driver that finds depths with other
  // corners extrapolates a needle's by far.
  vec2 grid = round(256.0 * mesh.scale / place.xz); // half the tile
  if (along > 0.0)
    across = round(across / along * grid) / grid * along;
  gl_Position = vec4(across, dot(mesh.window, p), along);
  number = uint(gl_VertexID);
#if CLIP
  at = position;
#endif
}
