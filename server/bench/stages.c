#include "server/bench/stages.h"

#include <math.h>
#include <stdio.h>

#include "server/bench/timing.h"

enum { ROUNDS = 5, KERNELS = TCS_STAGE_SHADE + 1 };

static const char *const names[TCS_STAGES] = {"set-up and resolve",     "traversal", "fetch",
                                              "classify and composite", "shade",     "tables",
                                              "skip structure",         "encode"};

/* The scene with all stages up to this one. nothing: an invisible knot, so that samples are fetched but not classified.
 */
static tc_scene scene_up_to(tcs_stage stage, const tc_scene *scene, tc_knot nothing[1]) {
  tc_scene s = *scene; /* borrows the lists of *scene */
  s.sampling.termination = 0;
  s.filter = stage == TCS_STAGE_TRAVERSAL ? TC_FILTER_NEAREST : TC_FILTER_LINEAR;
  if (stage < TCS_STAGE_SHADE)
    s.shading.model = TC_SHADING_NONE;
  else if (s.shading.model == TC_SHADING_NONE)
    s.shading.model = TC_SHADING_BLINN_PHONG;
  s.skipping.mode = stage == TCS_STAGE_RESOLVE ? TC_SKIPPING_AUTO : TC_SKIPPING_OFF;
  if (stage < TCS_STAGE_CLASSIFY) s.transfer_function.points = nothing, s.transfer_function.count = 1;
  return s;
}

bool tcs_stages_measure(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, tcs_stages *stages,
                        GError **error) {
  tc_frame frame = {0};
  double least[KERNELS];
  bool good = true;
  tc_knot nothing[1] = {scene->transfer_function.points[0]};
  nothing->amount = 0;
  for (int i = 0; i < KERNELS; i++) least[i] = INFINITY;
  for (int round = 0; round < ROUNDS; round++)
    for (int i = 0; i < KERNELS && good; i++) {
      const tc_scene s = scene_up_to((tcs_stage)i, scene, nothing);
      good = tc_render(renderer, volume, &s, NULL, &frame, error);
      least[i] = fmin(least[i], frame.stats.render_ms);
      stages->samples = (double)frame.stats.samples;
    }
  tc_frame_finish(&frame);
  for (int i = 0; i < KERNELS; i++) stages->ms[i] = i ? fmax(least[i] - least[i - 1], 0) : least[0];
  return good;
}

void tcs_stages_print(const tcs_stages *stages, double cycles) {
  double all = 0;
  for (int i = 0; i < TCS_STAGES; i++) all += stages->ms[i];
  printf("  %-24s %9s %9s %9s   (a lit frame without leaping, its tables new)\n", "stage", "ms", "share %", "cycles");
  for (int i = 0; i < TCS_STAGES; i++)
    printf("  %-24s %9.2f %9.1f %9.1f\n", names[i], stages->ms[i], 100 * stages->ms[i] / all,
           stages->ms[i] * cycles / stages->samples);
}

cJSON *tcs_stages_as_json(const tcs_stages *stages) {
  cJSON *o = cJSON_CreateObject();
  for (int i = 0; i < TCS_STAGES; i++) cJSON_AddNumberToObject(o, names[i], stages->ms[i]);
  return o;
}
