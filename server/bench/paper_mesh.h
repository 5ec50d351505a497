/* tomocast bench --paper 003: the paper's case of 106 slices of 512x512 voxels 2 mm apart, resampled from a volume.
 * Extraction and frames of mode mesh by instruction set, threads and back end, compared with the ray-cast isosurface of
 * the same scene. */
#ifndef TCS_BENCH_PAPER_MESH_H
#define TCS_BENCH_PAPER_MESH_H

#include "server/bench/papers.h"

bool tcs_paper_mesh(const tcs_paper_run *run, tc_volume *volume, const char *name, const tc_scene *scene, cJSON *report,
                    GError **error);

#endif
