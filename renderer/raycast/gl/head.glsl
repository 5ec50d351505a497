#version 450 core
// What every variant shares: the work-group, the frame's numbers and where results go.
layout(local_size_x = 8, local_size_y = 8) in;

// Filled by job_block() in job.c: same members, same order.
layout(std140, binding = 0) uniform Job {
  vec4 anchor0, anchor_du, anchor_dv; // index coordinates: xyz
  vec4 view0, view_du, view_dv;       // LPS mm: xyz
  vec4 to_index[3];                   // rows: voxels per mm
  vec4 box_lo, box_hi;                // index box of the field
  ivec4 dims;                         // xyz: voxels; w: slices per texture layer
  vec4 texel;                         // xyz: 1 / texture size
  vec4 nodes;                         // x: lo, y: nodes per voxel unit, z: n - 1
  ivec4 table;                        // x: columns, y: where k = 0 begins, z: how many zooms, w: their columns;
                                      // of integrals x: entries of a level, y: where levels begin
  ivec4 blocks;                       // x: voxels a block is wide, yz: entries to the next block along y, z, w: interval
  vec4 background;                    // compositing space; w: termination
  vec4 march;                         // x: step mm, y: eye mm (orthographic), z: 1 / step, w: where rays end, mm
  vec4 planes[12];                    // clip planes over index positions, mm
  ivec4 clipping;                     // x: how many planes
  vec4 grey;                          // projections: x: turn, y: gain, z: offset (raycast/grey.h)
  vec4 reach;                         // x: floor, y: stop, z: levels per voxel unit
  vec4 window;                        // x: centre in nodes, y: greys per node; modes without a table
  vec4 gradient[3];                   // rows: from two samples' gradients to their scaled mean in LPS (shade.h)
  vec4 light;                         // xyz: to a fixed light; w: 1 for a head light
  vec4 reflection;                    // x: F0, y: F1, z: least q, w: flat
  vec4 glow[2];                       // xyz: G0, G1; w: specular, shininess
  vec4 zooms[7];                      // node of the zoom = (node - x) * y; z: where its k = 0 begins, w: its rim (classify.h)
  vec4 label_matrix[3];               // rows: index positions of the label volume from the volume's
  ivec4 label_dims;                   // xyz: voxels; w: slices per texture layer
  ivec4 label_numbers;                // x: voxel of the first entry; y: a voxel value that stands for what lies outside
  vec4 label_texel;                   // xy: 1 / texture size
  vec4 rays;                          // x: how many a pixel, y: footprint in voxels (rays.h)
  vec4 of_pixel[64];                  // subpixel.h: x, y, phase
  vec4 surface, surface_color;        // x: isosurface as a voxel, y: to w (surface.h); compositing space
} job;

// This dispatch's part of the picture: xy = first pixel, zw = size in pixels.
layout(location = 0) uniform ivec4 tile;

// Per cell: rays met, samples low and high word, leaps; gradients low and high word. Spread over 64 cells so that few
// work-groups share one.
layout(std430, binding = 0) buffer Counters { uvec4 counters[128]; };
layout(std430, binding = 1) writeonly buffer Picture { uint picture[]; }; // [h][w] RGBA8, R in the low byte

struct Counts { uint samples, leaps, gradients; }; // of one ray
