/* What a rasteriser of any back end draws for a frame of mode mesh: the scene's camera, light, colours, clipping and
 * samples. */
#ifndef TC_FRAME_MESH_JOB_H
#define TC_FRAME_MESH_JOB_H

#include "renderer/frame/backend.h"
#include "renderer/mesh/raster.h"
#include "renderer/mesh/surfaces.h"

typedef struct tc_mesh_job {
  tc_raster_job raster; /* refers to what follows; kernels, finished, emit, user and pool are the caller's */
  tc_mesh_view view;
  double samples[TC_RASTER_SAMPLES][2];
  tc_raster_surface *surfaces;
  uint8_t *levels; /* of detail, [have.mesh->n_groups]; NULL: there are none */
  tc_slice_window window; /* of slices, with what they are of */
  const tc_frame_job *job;
} tc_mesh_job;

/* Layers of all pixels of a picture with surfaces in a volume: more are refused, whatever file they are from. Tests set less. */
extern unsigned tc_mesh_most_layers;

/* The scene's list of surfaces as far as it is drawn: what they are made from, in order. of[TC_MAX_SURFACES]. */
size_t tc_mesh_sources(const tc_frame_job *job, tc_mesh_source *of);

bool tc_mesh_job_begin(tc_mesh_job *m, const tc_frame_job *job, GError **error); /* TC_ERROR_MEMORY */
void tc_mesh_job_end(tc_mesh_job *m);

/* Triangles of a mesh of levels of detail that its plan draws in a picture of so many pixels; 0: no memory. */
size_t tc_mesh_triangles(const tc_clusters *mesh, const tc_plan *plan, const tc_scene *scene);

/* What pixel position (x, y) of a picture of the job's size shows of its mesh. TC_ERROR_MEMORY. */
bool tc_mesh_job_pick(const tc_frame_job *job, double x, double y, tc_pick *pick, GError **error);

#endif
