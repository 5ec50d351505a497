#include "server/session/samples.h"

#include <math.h>

/* A longer step would lose more than a smaller picture does. */
#define MOST_STEP 8.0
#define TRIES 8

/* Inputs of an estimate, and the limits. */
typedef struct bound {
  const tc_volume *volume;
  tc_mesh *const *meshes;
  const tcs_samples_limits *limits;
} bound;

/* The estimates of a scene as multiples of the limits. */
typedef struct load {
  double picture, ray;
} load;

static load load_of(const bound *b, const tc_scene *scene) {
  double ray, picture = tc_estimate_samples(b->volume, scene, b->meshes, scene->image.width, scene->image.height, &ray);
  return (load){picture / b->limits->picture, ray / b->limits->ray};
}

static bool passes(load l) { return l.picture <= 1 && l.ray <= 1; }

/* Rounds up to three digits, for readable messages. */
static double rounded_up(double value) {
  const double unit = pow(10, floor(log10(value)) - 2);
  return ceil(value / unit - 1e-9) * unit;
}

/* Reduces the samples of a scene to about this share. */
typedef void turn(tc_scene *to, const tc_scene *scene, double share);

static void turn_step(tc_scene *to, const tc_scene *scene, double share) {
  *to = *scene; /* borrows */
  to->sampling.step = rounded_up(scene->sampling.step / share);
}

static void turn_image(tc_scene *to, const tc_scene *scene, double share) {
  *to = *scene;
  to->image.width = (int)fmax(1, floor(scene->image.width * sqrt(share)));
  to->image.height = (int)fmax(1, floor(scene->image.height * sqrt(share)));
}

/* Where the limit lies on the line between two loads, 0..1. */
static double reach(double low, double high) { return high > 1 ? (1 - low) / (high - low) : 1; }

/* Finds the largest share that passes. False: even the least share does not. The load is almost linear in the share and
 * slightly concave, so the share at which its chord meets the limit is slightly too large at most; hence the
 * iterations. */
static bool turn_down(const bound *b, const tc_scene *scene, turn *by, double least, tc_scene *mended) {
  by(mended, scene, least);
  const load low = load_of(b, mended);
  if (least >= 1 || !passes(low)) return false;
  load high = load_of(b, scene);
  double share = 1;
  for (int i = 0; i < TRIES; i++) {
    share = least + (share - least) * fmin(reach(low.picture, high.picture), reach(low.ray, high.ray));
    by(mended, scene, share);
    high = load_of(b, mended);
    if (passes(high)) return true;
  }
  by(mended, scene, least);
  return true;
}

bool tcs_samples_shrink(const tc_volume *volume, tc_scene *scene, tc_mesh *const *meshes, const tcs_samples_limits *limits) {
  const bound b = {volume, meshes, limits};
  const tc_scene whole = *scene;
  return passes(load_of(&b, scene)) || turn_down(&b, &whole, turn_image, 0, scene);
}

/* Tries the smallest change first: longer steps, then a smaller picture, then one ray per pixel with either. */
static bool mend(const bound *b, const tc_scene *scene, tc_scene *mended) {
  tc_scene plain = *scene;
  const double least = scene->sampling.step / MOST_STEP, pixel = 0;
  plain.sampling.rays_per_pixel = 1;
  if (turn_down(b, scene, turn_step, least, mended) ||
      turn_down(b, scene, turn_image, pixel, mended) ||
      turn_down(b, &plain, turn_step, least, mended))
    return true;
  plain.sampling.step = fmax(scene->sampling.step, MOST_STEP);
  return turn_down(b, &plain, turn_image, pixel, mended);
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

bool tcs_samples_check(const tc_volume *volume, const tc_scene *scene, tc_mesh *const *meshes,
                       const tcs_samples_limits *limits, GError **error) {
  const bound b = {volume, meshes, limits};
  tc_scene mended;
  const load over = load_of(&b, scene);
  if (passes(over)) return true;
  const bool whole = over.picture >= over.ray;
  const double limit = whole ? limits->picture : limits->ray;
  const bool found = mend(&b, scene, &mended), steps = mended.sampling.step != scene->sampling.step;
  char *setting = found ? differences(scene, &mended) : g_strdup("nothing like it");
  tc_set_error(error, TC_ERROR_LIMIT, steps ? "/sampling/step" : "/image/width",
               "%s: %.3g samples estimated for the %s, the limit is %.3g; %s would pass",
               steps ? "sampling.step" : "image", limit * fmax(over.picture, over.ray), whole ? "picture" : "ray", limit,
               setting);
  g_free(setting);
  return false;
}
