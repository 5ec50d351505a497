#include "server/session/labels_check.h"

#include <math.h>
#include <string.h>

#include "renderer/volume/voxel.h"

/* Pairs of neighbours sampled: enough for an estimate, within a millisecond. */
#define SAMPLES 200000
#define VALUES 65536
/* Hardly any scan has fewer values. A whole-body segmentation has about a hundred. */
#define FEW 24
/* Brain atlases have some hundreds of values. */
#define MOST 1024
/* Least share of equal neighbours, among pairs that are not both background: almost 1 in labels, 0.1 in a noisy scan.
 */
#define ALIKE 0.5
#define SAME_DIRECTION 1e-3
#define SAME_SPACING 1e-3
#define SAME_PLACE 0.1 /* voxels */

/* Whether two positions in index space agree within x, y and z voxels. */
static bool near(const double a[3], const double b[3], double x, double y, double z) {
  return fabs(a[0] - b[0]) <= x && fabs(a[1] - b[1]) <= y && fabs(a[2] - b[2]) <= z;
}

static void corner(const tc_volume *from, const tc_volume *to, bool last, double index[3]) {
  double lo[3], hi[3], lps[3];
  tc_volume_index_box(from, lo, hi);
  tc_volume_index_to_lps(from, last ? hi : lo, lps);
  tc_volume_lps_to_index(to, lps, index);
}

/* The same grid, perhaps shifted by whole voxels. */
static bool same_grid(const tc_volume *volume, const tc_volume *labels) {
  const tc_volume_desc *a = tc_volume_describe(volume), *b = tc_volume_describe(labels);
  for (int k = 0; k < 9; k++)
    if (fabs(a->direction[k] - b->direction[k]) > SAME_DIRECTION) return false;
  for (int k = 0; k < 3; k++)
    if (fabs(a->spacing[k] - b->spacing[k]) > SAME_SPACING * a->spacing[k]) return false;
  double at[3];
  corner(labels, volume, false, at);
  const double whole[3] = {rint(at[0]), rint(at[1]), rint(at[2])};
  return near(at, whole, SAME_PLACE, SAME_PLACE, SAME_PLACE);
}

/* The same box with another number of voxels: the first and last voxels agree within one voxel of the coarser grid. */
static bool same_box(const tc_volume *volume, const tc_volume *labels) {
  const tc_volume_desc *a = tc_volume_describe(volume), *b = tc_volume_describe(labels);
  double slack[3], lo[3], hi[3], first[3], last[3];
  for (int k = 0; k < 3; k++) slack[k] = fmax(1, b->spacing[k] / a->spacing[k]);
  tc_volume_index_box(volume, lo, hi);
  corner(labels, volume, false, first);
  corner(labels, volume, true, last);
  return near(first, lo, slack[0], slack[1], slack[2]) && near(last, hi, slack[0], slack[1], slack[2]);
}

/* A voxel's value, shifted to start at 0; always 0 in a volume of floats. */
static int voxel_at(const tc_volume_desc *d, const void *voxels, size_t i) {
  const int least = d->type == TC_I8 ? INT8_MIN : d->type == TC_I16 ? INT16_MIN : 0;
  return d->type == TC_F32 ? 0 : (int)tc_voxel_at(d->type, voxels, i) - least;
}

/* Number of different values, and the share of equal neighbours along x among those not both background. Sampled. */
static int values_of(const tc_volume *labels, double *alike) {
  const tc_volume_desc *d = tc_volume_describe(labels);
  const void *voxels = tc_volume_data(labels);
  const size_t count = (size_t)d->dims[0] * (size_t)d->dims[1] * (size_t)d->dims[2];
  const size_t pairs = count > 1 ? count - 1 : 1, step = 1 + pairs / SAMPLES;
  const int nothing = voxel_at(d, voxels, 0);
  uint8_t *seen = g_malloc0(VALUES);
  size_t same = 0, something = 0;
  int values = 0;
  for (size_t i = 0; i < pairs; i += step) {
    const int a = voxel_at(d, voxels, i), b = voxel_at(d, voxels, MIN(i + 1, count - 1));
    values += !seen[a] + (a != b && !seen[b]);
    seen[a] = seen[b] = 1;
    if (a == nothing && b == nothing) continue;
    something++;
    same += a == b;
  }
  g_free(seen);
  *alike = something ? (double)same / (double)something : 1;
  return values;
}

bool tcs_labels_check(const tc_volume *volume, const tc_volume *labels, GError **error) {
  static const char pointer[] = "/labels/volume";
  if (tc_volume_sparse(labels)) return true; /* tc_labels_check() refuses it */
  size_t known;
  (void)tc_volume_segments(labels, &known);
  if (!same_grid(volume, labels) && !same_box(volume, labels)) {
    tc_set_error(
        error, TC_ERROR_CONFLICT, pointer,
        "labels/volume: its voxels are not on the volume's grid: choose labels made for this volume, or set "
        "labels.force");
    return false;
  }
  double alike;
  const int values = known ? 0 : values_of(labels, &alike); /* a segmentation lists its segments */
  if (values <= FEW || (values <= MOST && alike >= ALIKE)) return true;
  tc_set_error(
      error, TC_ERROR_CONFLICT, pointer,
      "labels/volume: it holds %d values or more, %.0f %% of neighbours alike, as a scan does and labels do not: "
      "choose a segmentation, or set labels.force",
      values, 100 * alike);
  return false;
}
