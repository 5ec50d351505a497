#include "server/session/samples.h"

#include <math.h>

/* Beyond it the picture shows nothing that a smaller one would not. */
#define MOST_STEP 8.0
#define TRIES 40

/* How many times over its limits the scene is; <= 1: it passes. */
static double excess(const tc_volume *volume, const tc_scene *scene, const tcs_samples_limits *limits, double *samples,
                     double *ray) {
  *samples = tc_estimate_samples(volume, scene, scene->image.width, scene->image.height, ray);
  return fmax(*samples / limits->picture, *ray / limits->ray);
}

static double passes(const tc_volume *volume, const tc_scene *scene, const tcs_samples_limits *limits) {
  double samples, ray;
  return excess(volume, scene, limits, &samples, &ray);
}

/* Three digits, so that it is read easily, and not less than asked. */
static double rounded_up(double value) {
  const double unit = pow(10, floor(log10(value)) - 2);
  return ceil(value / unit - 1e-9) * unit;
}

/* The shortest step that passes. Samples go down in proportion to steps, but for a ray's ends. */
static bool lengthen(const tc_volume *volume, tc_scene *scene, const tcs_samples_limits *limits) {
  for (int i = 0; i < TRIES && scene->sampling.step <= MOST_STEP; i++) {
    const double over = passes(volume, scene, limits);
    if (over <= 1) return true;
    scene->sampling.step = rounded_up(scene->sampling.step * fmax(over, 1.01));
  }
  return false;
}

bool tcs_samples_shrink(const tc_volume *volume, tc_scene *scene, const tcs_samples_limits *limits) {
  for (int i = 0; i < TRIES; i++) {
    const double over = passes(volume, scene, limits), side = sqrt(fmax(over, 1.02));
    if (over <= 1) return true;
    scene->image.width = (int)fmax(1, floor(scene->image.width / side));
    scene->image.height = (int)fmax(1, floor(scene->image.height / side));
  }
  return false;
}

/* The least change first: longer steps, or a smaller picture where steps do not count, or fewer rays and both. */
static bool mend(const tc_volume *volume, const tc_scene *scene, const tcs_samples_limits *limits, tc_scene *mended) {
  *mended = *scene; /* borrows */
  if (lengthen(volume, mended, limits)) return true;
  *mended = *scene;
  if (tcs_samples_shrink(volume, mended, limits)) return true;
  *mended = *scene;
  mended->sampling.rays_per_pixel = 1;
  if (lengthen(volume, mended, limits)) return true;
  mended->sampling.step = fmax(scene->sampling.step, MOST_STEP);
  return tcs_samples_shrink(volume, mended, limits);
}

static char *differences(const tc_scene *scene, const tc_scene *mended) {
  GString *text = g_string_new(NULL);
  if (mended->sampling.step != scene->sampling.step) g_string_append_printf(text, "a step of %.3g", mended->sampling.step);
  if (mended->sampling.rays_per_pixel != scene->sampling.rays_per_pixel)
    g_string_append_printf(text, "%s1 ray per pixel", text->len ? " with " : "");
  if (mended->image.width != scene->image.width || mended->image.height != scene->image.height)
    g_string_append_printf(text, "%s%d x %d pixels", text->len ? " and " : "", mended->image.width, mended->image.height);
  return g_string_free(text, FALSE);
}

bool tcs_samples_check(const tc_volume *volume, const tc_scene *scene, const tcs_samples_limits *limits,
                       GError **error) {
  double samples, ray;
  tc_scene mended;
  if (excess(volume, scene, limits, &samples, &ray) <= 1) return true;
  const bool whole = samples / limits->picture >= ray / limits->ray;
  const bool found = mend(volume, scene, limits, &mended), steps = mended.sampling.step != scene->sampling.step;
  char *setting = found ? differences(scene, &mended) : g_strdup("nothing like it");
  tc_set_error(error, TC_ERROR_LIMIT, steps ? "/sampling/step" : "/image/width",
               "%s: %.3g samples estimated for the %s, the limit is %.3g; %s would pass",
               steps ? "sampling.step" : "image", whole ? samples : ray, whole ? "picture" : "ray",
               whole ? limits->picture : limits->ray, setting);
  g_free(setting);
  return false;
}
