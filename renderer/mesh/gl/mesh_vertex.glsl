layout(location = 0) in vec3 position;
layout(location = 0) uniform vec4 place; // xz: scale, yw: offset, from mm at a distance of 1 mm to -1..1 over the tile
flat out uint number; // the triangle's, of its last vertex
#if CLIP
out vec3 at;
#endif

void main() {
  vec4 p = vec4(position, 1.0);
  float along = mesh.perspective != 0 ? dot(mesh.depth, p) + mesh.reference : 1.0;
  gl_Position = vec4(place.x * dot(mesh.right, p) + place.y * along, place.z * dot(mesh.down, p) + place.w * along,
                     dot(mesh.window, p), along);
  number = uint(gl_VertexID);
#if CLIP
  at = position;
#endif
}
