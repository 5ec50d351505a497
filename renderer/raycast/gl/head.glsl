#version 450 core
// Shared by all variants: the work-group, the frame's constants and the output buffers.
layout(local_size_x = 8, local_size_y = 8) in;

struct Rays { // tc_rays_single (rays.h)
  vec4 anchor0, anchor_du, anchor_dv; // index coordinates: xyz
  vec4 view0, view_du, view_dv;       // LPS mm: xyz
  vec4 to_index[3];                   // rows: voxels per mm
  vec4 lo, hi;                        // index box of the field
  float step_mm, inverse_step, eye_mm, far_mm;
  vec4 planes[12];                    // clip planes over index positions, mm
  vec4 of_pixel[64];                  // subpixel.h: x, y, phase
  int n_planes, count, perspective;
  float footprint;                    // voxels
};
struct Shade { // tc_shade (shading.h)
  vec4 gradient[3];
  vec3 light;
  int head_light;
  vec4 glow[2];
  vec2 factor;
  float least, low, inverse_steep, specular, shininess, least_mirror; // low: tc_shade.flat
};
struct Grey { float sign, gain, offset, low, stop; }; // tc_grey (projection.h); low: its floor

// tc_gl_job_block (job.h): same members, same order.
layout(std140, binding = 0) uniform Job {
  Rays rays;
  Shade shade;
  Grey grey;
  vec4 level_scale;                   // x: levels per unit of projection.h's w
  ivec4 dims;                         // xyz: voxels; w: slices per texture layer
  vec4 texel;                         // xyz: 1 / texture size
  vec4 nodes;                         // x: lo, y: nodes per voxel unit, z: n - 1
  ivec4 table;                        // pre-integration table: x: columns, y: start of row k = 0, z: number of subtables, w: their columns;
                                      // integrals: x: entries per level, y: start of the levels
  ivec4 blocks;                       // x: width of a block in voxels, yz: entries to the next block along y, z, w: samples per interval, 0: no skipping
  vec4 background;                    // compositing space; w: threshold of early ray termination
  vec4 window;                        // mpr: x: centre in nodes, y: grey per node
  vec4 subtables[7];                      // node of the subtable = (node - x) * y; z: start of its row k = 0, w: its rim (preintegration.h)
  vec4 label_matrix[3];               // rows: from the volume's index positions to the label volume's
  ivec4 label_dims;                   // xyz: voxels; w: slices per texture layer
  ivec4 label_numbers;                // x: voxel of the first entry; y: voxel value that stands for outside
  vec4 label_texel;                   // xy: 1 / texture size
  vec4 surface, surface_color;        // surface: x: iso, y: scale (isosurface.h); surface_color: compositing space
} job;

// The tile of this dispatch: xy = first pixel, zw = size in pixels.
layout(location = 0) uniform ivec4 tile;

// Counters per cell: rays, samples (low and high word), leaps; gradients (low and high word), triangles shaded. 64
// cells, so that few work-groups contend for one.
layout(std430, binding = 0) buffer Counters { uvec4 counters[128]; };
layout(std430, binding = 1) writeonly buffer Picture { uint picture[]; }; // [h][w] RGBA8, R in the low byte

struct Counts { uint samples, leaps, gradients; }; // of one ray
