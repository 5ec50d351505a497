/* Labels: colours and visibility of a segmentation, and its positions in another volume's index space.
 *
 * A label volume holds integers (any integer voxel type; label = slope * voxel + intercept) on a separate grid anywhere
 * in the same patient space. 0, negative numbers and positions outside the grid mean "no label". At a point, the table
 * entries (tc_labels below) of the eight surrounding voxels are interpolated trilinearly, instead of the label numbers,
 * so the faces of a segment are smooth at any zoom. Beyond the last voxel centres the weight passes to "outside" within
 * one voxel; along an axis of one voxel, labels are constant over its thickness. Filter "nearest" takes the nearest
 * voxel alone.
 *   S, A, V = interpolated tint colour (premultiplied), tint opacity and visibility
 *   dvr: extinction * V; colour C becomes C (1 - A/V) + S/V   (a hidden label does not tint its neighbours)
 *   mpr: grey G becomes G (1 - A) + S                          (anatomy is never hidden)
 *   mesh, splat: a label's surface or voxels have its colour, whatever the opacity of tints; translucent splats have
 *                opacity A in each millimetre
 * A volume's own gaps (tc_volume_gaps) are treated as labels that only hide, in scenes without a label volume: in dvr
 * as above; in slices and projections, samples with V < 0.5 are ignored. */
#ifndef TC_CLASSIFY_LABELS_H
#define TC_CLASSIFY_LABELS_H

#include "renderer/base/error.h"
#include "renderer/base/halt.h"
#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_labels {
  uint64_t serial;     /* unique in the process */
  int base, n;         /* entries of the stored voxels base .. base + n - 1; entry n stands for outside */
  float (*entries)[8]; /* [n + 1]: S r, g, b, A, V, and the label's colour r, g, b */
  GBytes *key;         /* tc_labels_key() */
  size_t bytes;
  double build_ms;
} tc_labels;

/* The scene for tc_labels_build() over a volume's gaps (tc_volume_gaps): gaps are hidden, nothing is tinted. Static. */
const tc_scene *tc_labels_of_gaps(void);
/* True if the scene draws a volume's own colours (tc_volume_colors): single slices, without other labels. */
bool tc_labels_in_color(const tc_volume *volume, const tc_scene *scene);
/* The scene for tc_labels_build() over a volume's own colours. Static. */
const tc_scene *tc_labels_of_colors(void);

/* The key of the entries, all their inputs: label volume, opacity, colours, visible labels, compositing space. The
 * caller unrefs. */
GBytes *tc_labels_key(const tc_volume *labels, const tc_scene *scene);

/* Builds the entries; the caller frees. Takes ownership of `key`. The label volume was checked (tc_labels_check). NULL
 * with TC_ERROR_MEMORY or the error of the halt (NULL: none). */
tc_labels *tc_labels_build(const tc_volume *labels, const tc_scene *scene, GBytes *key, const tc_halt *halt,
                           GError **error);
void tc_labels_free(tc_labels *labels); /* NULL is fine */

/* The affine map from index positions of `volume` to those of `labels`: rows of 3 factors and an offset. */
void tc_labels_matrix(const tc_volume *volume, const tc_volume *labels, double matrix[3][4]);

/* True for modes that read labels; others ignore scene.labels. */
bool tc_mode_has_labels(tc_mode mode);

/* Checks that the scene's labels can be drawn from `labels` (NULL: no such volume) over `volume`; true for a scene
 * without labels. TC_ERROR_INVALID with the pointer /labels/volume if there is no such volume, its labels are not
 * integers (f32 voxels, or a fractional slope or intercept), or the two volumes do not overlap in patient space.
 * Pure. */
bool tc_labels_check(const tc_volume *volume, const tc_volume *labels, const tc_scene *scene, GError **error);

/* The check of the label volume itself, over a volume. The error begins with `name`. */
bool tc_labels_fit(const tc_volume *volume, const tc_volume *labels, const char *name, GError **error);

/* True if the label is visible: scene->labels.visible is NULL or contains it. */
bool tc_labels_show(const tc_scene *scene, uint32_t label);

#endif
