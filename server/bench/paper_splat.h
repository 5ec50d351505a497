/* tomocast bench --paper 004: its tables 1 and 2 (sizes of voxel models, gain of culling) for objects of volumes
 * (values from the scene's splat.threshold on), with the published figures. */
#ifndef TCS_BENCH_PAPER_SPLAT_H
#define TCS_BENCH_PAPER_SPLAT_H

#include "server/bench/papers.h"

void tcs_paper_splat_begin(const tcs_paper_run *run);
bool tcs_paper_splat(const tcs_paper_run *run, tc_volume *volume, const char *name, const tc_scene *scene,
                     cJSON *report, GError **error);

#endif
