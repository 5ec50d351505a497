/* The job of a rasteriser (cpu or gl) for a frame of mode mesh: camera, light, colours, clipping and samples of the scene. */
#ifndef TC_FRAME_MESH_JOB_H
#define TC_FRAME_MESH_JOB_H

#include "renderer/frame/backend.h"
#include "renderer/mesh/raster.h"
#include "renderer/mesh/surfaces.h"

typedef struct tc_mesh_job {
  tc_raster_job raster; /* points to the members below; the caller sets kernels, finished, emit, user and pool */
  tc_mesh_view view;
  double samples[TC_RASTER_SAMPLES][2];
  tc_raster_surface *surfaces;
  tc_raster_look *looks; /* [n_looks] */
  int n_looks;
  uint8_t *levels; /* level of detail of each group, [have.mesh->n_groups]; NULL: the mesh has one level */
  tc_slice_window window; /* for the greys of slices */
  float channels[256];    /* 8-bit channels of vertex colours -> compositing space; filled if a surface has such
                             colours */
  const tc_frame_job *job;
} tc_mesh_job;

/* Limit on the layers of all pixels together in a picture with surfaces in a volume (TC_ERROR_LIMIT). Tests lower
 * it. */
extern unsigned tc_mesh_most_layers;

/* Sources of the visible surfaces of the scene's list, in its order: fills of[TC_MAX_SURFACES], returns their number. */
size_t tc_mesh_sources(const tc_frame_job *job, tc_mesh_source *of);

/* Whether a surface may be in the picture: false if the box of the volume and of its labels is outside the view or clipped, and
 * so is the box, or are the vertices, of each mesh that the scene shows. Counts the vertices it looks at in the frame's stats; once
 * a frame is enough (job->mesh_in_view). */
bool tc_mesh_in_view(const tc_frame_job *job);

bool tc_mesh_job_begin(tc_mesh_job *m, const tc_frame_job *job, GError **error); /* TC_ERROR_MEMORY */
void tc_mesh_job_end(tc_mesh_job *m);

/* Counts, without drawing, what the plan draws of a mesh: triangles and triangles_in_full (0 without levels of detail),
 * clusters, outside and facing_away. All are 0 if out of memory. */
void tc_mesh_count(const tc_clusters *mesh, const tc_plan *plan, const tc_scene *scene, tc_facts *facts);

/* Picks the mesh at pick->at of a picture of the job's size. TC_ERROR_MEMORY. */
bool tc_mesh_job_pick(const tc_frame_job *job, tc_pick *pick, GError **error);

#endif
