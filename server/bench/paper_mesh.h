/* tomocast bench --paper 003: its case, 106 slices of 512x512 voxels 2 mm apart, sampled from a volume: extraction and
 * frames of mode mesh by instruction set, threads and back end, beside the ray-cast isosurface of the same scene. */
#ifndef TCS_BENCH_PAPER_MESH_H
#define TCS_BENCH_PAPER_MESH_H

#include "server/bench/papers.h"

bool tcs_paper_mesh(const tcs_paper_run *run, tc_volume *volume, const char *name, const tc_scene *scene, cJSON *report,
                    GError **error);

#endif
