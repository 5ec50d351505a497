// A frame's constants of mode mesh: mesh_block of mesh.c, same members, same order. Shared by its three shaders.
layout(std140, binding = 1) uniform Mesh {
  vec4 right, down, depth; // rows of view.h; depth is relative to the reference
  vec4 window;             // row: what is nearer has the larger depth in the buffer, 0..1, times the distance along the view
  vec4 behind;             // nearness (view.h) of depth 0, and from there to depth 1; tc_raster_frame.behind
  vec4 planes[12];         // what is kept has plane . (p, 1) >= 0
  vec4 offsets[64];        // xy: of a sample from its pixel's left upper corner
  vec2 centre;
  float reference, scale, inverse_scale;
  int perspective, n_planes, n_samples, n_clusters;
  int normals, several; // bool; several: surfaces
  int colors; // in pairs, where they begin behind the clusters (mesh_shade.glsl)
  vec4 channels[64]; // of the compositing space, for each number of a vertex colour's channel
  vec4 to_index[3]; // rows: from the mesh's coordinates to index positions of the volume
} mesh;
